"""Friction in the arm's own joints, from its motions through free air."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimation.friction.joints import joint_friction
from palpate.estimation.load.rubbing import TURNED, rubbing
from palpate.estimation.windows import Load
from palpate.trace.samples import Samples

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
    ways = rubbing(q)[:, :, TURNED]
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


def empty(samples: Samples) -> Load:
    rows = np.ones(len(samples), dtype=bool)
    return Load(~rows, rows, ())


def test_what_turns_round_with_a_joint_is_friction_and_nothing_else_is():
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
