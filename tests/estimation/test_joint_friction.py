"""Friction in the arm's own joints, from its motions through free air."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.estimation.joint_friction import (
    ENCODER_PLAY,
    LEFT,
    PRESLIDING,
    RUBBING_ROWS,
    TURNED,
    dahl_states,
    joint_friction,
    joint_friction_force,
)
from palpate.estimation.wrench_observation import observation_of_torques
from palpate.trace.recording import Chain, NominalHand
from palpate.trace.samples import Samples, Trace

FRICTION = np.array([0.3, 0.1, 0.0, 0.5, 0.05, 0.2, 0.1])
"""N m."""
PERIOD = 0.005


def swinging(seconds: float, noise: float = 0.02) -> tuple[Samples, np.ndarray]:
    """Joints that turn to and fro, at different rates, with gravity and inertia that the arm's model
    leaves; and which way they were turned last."""
    random = np.random.default_rng(0)
    t = PERIOD * np.arange(round(seconds / PERIOD))
    rates = 0.5 + 0.1 * np.arange(7)
    q = 0.2 * np.sin(np.outer(t, rates))
    ways = dahl_states(q)[:, :, TURNED]
    tau = (
        FRICTION * ways
        + 0.4 * q
        - 0.3 * q**2
        + 0.8 * np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    )
    tau += noise * random.standard_normal(tau.shape)
    pose = np.tile([0.5, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0], (len(t), 1))
    zeros = np.zeros((len(t), 6))
    rates_of_q = np.gradient(q, t, axis=0)
    return Samples(t, q, rates_of_q, tau, zeros, pose, zeros, pose, np.full(len(t), 0.08)), ways


def empty(samples: Samples) -> np.ndarray:
    return np.ones(len(samples), dtype=bool)


def test_only_torque_that_reverses_with_a_joint_is_friction():
    samples, ways = swinging(20.0)
    found, std = joint_friction(samples, ways, empty(samples), 0.3)
    assert found == pytest.approx(FRICTION, abs=0.03)
    assert (std < 0.05).all()


def test_a_hand_that_is_low_or_moves_too_shortly_shows_none():
    samples, ways = swinging(20.0)
    for shown, height in ((samples, 0.5), (samples.between(0.0, 1.0), 0.3)):
        found, std = joint_friction(shown, ways[: len(shown)], empty(shown), height)
        assert not found.any()
        assert std == pytest.approx(0.3)


UNTOLD = NominalHand(0.0, 0.1, 0.0, 1e-4)
"""Of an arm whose joints nobody told."""
Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
CHAIN = Chain(
    axes=(Z, Y, Z, Y, Z, Y, Z),
    anchors=tuple((0.1 * i * (i % 2), 0.0, 0.15 * i) for i in range(7)),
    tcp=(0.5, 0.0, 0.4),
    tool=((1.0, 0.0, 0.0), Y, Z),
)


def test_the_friction_of_reversing_joints_in_a_force_is_predicted():
    samples, ways = swinging(20.0)
    observed = observation_of_torques(samples.tau_ext, CHAIN, np.eye(3))
    seen = np.linalg.pinv(observed.maps(samples.q))
    wrench = np.einsum("nij,nj->ni", seen, samples.tau_ext)
    samples = replace(samples, wrench=wrench)
    trace = Trace(samples, (), (), (), replace(UNTOLD, chain=CHAIN))
    rows, free = slice(0, 800), np.arange(800) < 100
    found = joint_friction_force(trace, rows, free, empty(samples), 0.3)
    made = -np.einsum("nj,nj->n", seen[:, 2], FRICTION * ways)[rows]
    made -= np.median(made[free])
    assert np.std(made) > 0.5
    assert np.std(found - made) < 0.2 * np.std(made)
    assert not joint_friction_force(
        replace(trace, hand=UNTOLD), rows, free, empty(samples), 0.3
    ).any()


def turned(*ways: float) -> np.ndarray:
    """(n, 1) rad: a joint that turns at an even speed by each of `ways` in 100 rows, 0 for a rest."""
    steps = np.concatenate([np.full(100, way / 100) for way in ways])
    return np.cumsum(steps)[:, None]


def test_a_joint_that_turns_rubs_against_its_way() -> None:
    states = dahl_states(turned(0.1, -0.1, 0.0))[:, 0, TURNED]
    assert states[99] == pytest.approx(1.0, abs=0.01)
    assert states[199] == pytest.approx(-1.0, abs=0.01)
    assert states[299] == states[210]


def test_friction_changes_over_as_the_joint_reverses() -> None:
    way = PRESLIDING
    state = dahl_states(turned(0.1, -way, 0.0))[-1, 0, TURNED]
    assert state == pytest.approx(-1.0 + 2.0 / np.e, abs=0.04)


def test_a_joint_that_does_not_turn_keeps_what_it_had() -> None:
    states = dahl_states(np.hstack([turned(0.1, 0.0), turned(0.0, 0.0)]))
    assert states[-1, :, LEFT] == pytest.approx([0.0, 1.0], abs=0.01)
    assert states[-1, 1, TURNED] == 0.0


def test_noise_of_the_encoders_is_no_motion() -> None:
    noise = 2e-6 * np.random.default_rng(0).standard_normal((4000, 3))
    states = dahl_states(noise)
    assert (states[-1, :, LEFT] > 0.95).all()


def test_dahl_states_follow_dahls_model_row_by_row() -> None:
    draws = np.random.default_rng(1)
    pace = np.repeat(draws.choice([0.0, 1e-4, -1e-4], size=(20, 3)), 40, axis=0)
    q = np.cumsum(pace + 3e-6 * draws.standard_normal(pace.shape), axis=0)
    coarse = q.reshape(-1, RUBBING_ROWS, 3).mean(axis=1)
    play, state = coarse[0], np.array([[0.0] * 3, [1.0] * 3])
    found = dahl_states(q)[::RUBBING_ROWS]
    for row, angles in zip(found, coarse, strict=True):
        step = angles - play
        step = step - np.clip(step, -ENCODER_PLAY, ENCODER_PLAY)
        play = play + step
        keep = np.exp(-np.abs(step) / PRESLIDING)
        state = keep * state + [np.copysign(1.0 - keep, step), np.zeros(3)]
        assert row == pytest.approx(np.stack([state[TURNED], state[LEFT]], axis=1), abs=1e-12)
