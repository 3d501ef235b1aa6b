"""The friction in joints, from how they were turned."""

import numpy as np
import pytest

from palpate.estimation import tuning
from palpate.estimation.load.dahl import LEFT, TURNED, dahl_states


def turned(*ways):
    """(n, 1) rad: a joint that turns at an even speed by each of `ways` in 100 rows, 0 for a rest."""
    steps = np.concatenate([np.full(100, way / 100) for way in ways])
    return np.cumsum(steps)[:, None]


def test_a_joint_that_turns_rubs_against_its_way():
    states = dahl_states(turned(0.1, -0.1, 0.0))[:, 0, TURNED]
    assert states[99] == pytest.approx(1.0, abs=0.01)
    assert states[199] == pytest.approx(-1.0, abs=0.01)
    assert states[299] == states[210]


def test_it_goes_over_as_the_joint_turns():
    way = tuning.PRESLIDING
    state = dahl_states(turned(0.1, -way, 0.0))[-1, 0, TURNED]
    assert state == pytest.approx(-1.0 + 2.0 / np.e, abs=0.04)


def test_a_joint_that_does_not_turn_keeps_what_it_had():
    states = dahl_states(np.hstack([turned(0.1, 0.0), turned(0.0, 0.0)]))
    assert states[-1, :, LEFT] == pytest.approx([0.0, 1.0], abs=0.01)
    assert states[-1, 1, TURNED] == 0.0


def test_noise_of_the_encoders_is_no_motion():
    noise = 2e-6 * np.random.default_rng(0).standard_normal((4000, 3))
    states = dahl_states(noise)
    assert (states[-1, :, LEFT] > 0.95).all()


def test_it_is_what_dahls_model_says_row_by_row():
    draws = np.random.default_rng(1)
    pace = np.repeat(draws.choice([0.0, 1e-4, -1e-4], size=(20, 3)), 40, axis=0)
    q = np.cumsum(pace + 3e-6 * draws.standard_normal(pace.shape), axis=0)
    coarse = q.reshape(-1, tuning.RUBBING_ROWS, 3).mean(axis=1)
    play, state = coarse[0], np.array([[0.0] * 3, [1.0] * 3])
    found = dahl_states(q)[:: tuning.RUBBING_ROWS]
    for row, angles in zip(found, coarse, strict=True):
        step = angles - play
        step = step - np.clip(step, -tuning.ENCODER_PLAY, tuning.ENCODER_PLAY)
        play = play + step
        keep = np.exp(-np.abs(step) / tuning.PRESLIDING)
        state = keep * state + [np.copysign(1.0 - keep, step), np.zeros(3)]
        assert row == pytest.approx(np.stack([state[TURNED], state[LEFT]], axis=1), abs=1e-12)
