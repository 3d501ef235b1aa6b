"""The friction in joints, from how they were turned."""

import numpy as np
import pytest

from palpate.estimation import tuning
from palpate.estimation.load.rubbing import LEFT, TURNED, rubbing


def turned(*ways):
    """(n, 1) rad: a joint that turns at an even speed by each of `ways` in 100 rows, 0 for a rest."""
    steps = np.concatenate([np.full(100, way / 100) for way in ways])
    return np.cumsum(steps)[:, None]


def test_a_joint_that_turns_rubs_against_its_way():
    states = rubbing(turned(0.1, -0.1, 0.0))[:, 0, TURNED]
    assert states[99] == pytest.approx(1.0, abs=0.01)
    assert states[199] == pytest.approx(-1.0, abs=0.01)
    assert states[299] == states[210]


def test_it_goes_over_as_the_joint_turns():
    way = tuning.PRESLIDING
    state = rubbing(turned(0.1, -way, 0.0))[-1, 0, TURNED]
    assert state == pytest.approx(-1.0 + 2.0 / np.e, abs=0.04)


def test_a_joint_that_does_not_turn_keeps_what_it_had():
    states = rubbing(np.hstack([turned(0.1, 0.0), turned(0.0, 0.0)]))
    assert states[-1, :, LEFT] == pytest.approx([0.0, 1.0], abs=0.01)
    assert states[-1, 1, TURNED] == 0.0


def test_noise_of_the_encoders_is_no_motion():
    noise = 2e-6 * np.random.default_rng(0).standard_normal((4000, 3))
    states = rubbing(noise)
    assert (states[-1, :, LEFT] > 0.95).all()
