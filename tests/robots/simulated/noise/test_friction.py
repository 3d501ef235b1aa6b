"""Friction behind the sensors: Coulomb with presliding, Stribeck, viscous, with load and angle."""

from __future__ import annotations

import numpy as np
import pytest
from noises import model, moving

from palpate.robots.simulated.noise.friction import JointFriction
from palpate.robots.simulated.noise.values import Streams

PERIOD = 0.005


def friction(seed: int = 0, **figures: object) -> JointFriction:
    return JointFriction(model(friction=figures).friction, PERIOD, Streams(seed))


def felt(found: JointFriction, rate: float, count: int = 400, torque: float = 0.0) -> np.ndarray:
    out = np.full((count, 7), torque)
    found.add(out, moving(count, rate))
    return out - torque


def test_it_opposes_motion_and_turns_round_within_the_presliding_distance() -> None:
    found = friction(coulomb=0.1, presliding=2e-3)
    forth, back = felt(found, 0.1), felt(found, -0.1)
    assert forth[-1] == pytest.approx(np.full(7, 0.1), rel=1e-6)
    assert back[-1] == pytest.approx(np.full(7, -0.1), rel=1e-6)
    slid = 0.1 * PERIOD * np.arange(1, 401)
    assert back[:, 0] == pytest.approx(-0.1 + 0.2 * np.exp(-slid / 2e-3), abs=1e-6)
    held = felt(found, 0.0)
    assert held == pytest.approx(np.tile(back[-1], (400, 1))), "it stays where motion stopped"


def test_breaking_away_takes_more_than_sliding() -> None:
    level = [float(felt(friction(coulomb=0.2, static=1.5, stribeck_speed=0.01), rate)[-1, 0])
             for rate in (0.002, 0.01, 0.2)]  # fmt: skip
    assert level[0] == pytest.approx(0.2 * (1 + 0.5 * np.exp(-0.04)), rel=0.2)
    assert level[1] == pytest.approx(0.2 * (1 + 0.5 * np.exp(-1)), rel=1e-3)
    assert level[2] == pytest.approx(0.2, rel=1e-6)


def test_viscous_friction_grows_with_speed() -> None:
    assert felt(friction(viscous=0.5), 0.3)[-1] == pytest.approx(np.full(7, 0.15))


def test_it_grows_with_the_load() -> None:
    assert felt(friction(load=0.01), 0.5, torque=-30.0)[-1] == pytest.approx(np.full(7, 0.3))


def test_robots_differ_by_the_spread() -> None:
    levels = [felt(friction(seed, coulomb=1.0, spread=0.2), 0.5)[-1] for seed in range(100)]
    assert np.std(levels) == pytest.approx(0.2, rel=0.1)


def test_it_varies_around_a_turn() -> None:
    out = felt(friction(coulomb=1.0, position=0.1), 0.5, count=int(2 * np.pi / 0.5 / PERIOD))
    assert out[20:, 0].std() == pytest.approx(0.1, rel=0.03)


def test_what_the_driver_compensates_flips_sign_with_the_motion() -> None:
    found = friction(coulomb=0.3, compensated=1.0)
    assert felt(found, 0.2)[-1] == pytest.approx(np.zeros(7), abs=1e-9)
    assert felt(found, -0.2, count=1)[0] == pytest.approx(np.full(7, 0.6), rel=0.5)


def test_it_starts_anywhere_within_its_level() -> None:
    starts = [friction(seed, coulomb=0.1).torque for seed in range(100)]
    assert np.abs(starts).max() <= 0.1
    assert np.std(starts) == pytest.approx(0.1 / np.sqrt(3), rel=0.1)
