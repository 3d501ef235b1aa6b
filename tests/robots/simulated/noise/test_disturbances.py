"""Disturbances of the link-side torque: joint friction, sticking and position errors at rest."""

from __future__ import annotations

import numpy as np
import pytest
from noises import JACOBIAN, model, moving

from palpate.robots.nominal import wrench
from palpate.robots.simulated.noise.disturbances import JointFriction, Rests
from palpate.robots.simulated.noise.model import Streams

PERIOD = 0.005


def friction(seed: int = 0, **figures: object) -> JointFriction:
    return JointFriction(model(friction=figures).friction, PERIOD, Streams(seed))


def felt(found: JointFriction, rate: float, count: int = 400, torque: float = 0.0) -> np.ndarray:
    out = np.full((count, 7), torque)
    found.add(out, moving(count, rate))
    return out - torque


def test_friction_opposes_motion_and_turns_round_within_the_presliding_distance() -> None:
    found = friction(coulomb=0.1, presliding=2e-3)
    forth, back = felt(found, 0.1), felt(found, -0.1)
    assert forth[-1] == pytest.approx(np.full(7, 0.1), rel=1e-6)
    assert back[-1] == pytest.approx(np.full(7, -0.1), rel=1e-6)
    slid = 0.1 * PERIOD * np.arange(1, 401)
    assert back[:, 0] == pytest.approx(-0.1 + 0.2 * np.exp(-slid / 2e-3), abs=1e-6)
    held = felt(found, 0.0)
    assert held == pytest.approx(np.tile(back[-1], (400, 1))), "it stays where motion stopped"


def test_a_small_cycle_does_not_close() -> None:
    found = friction(coulomb=0.1, presliding=2e-3)
    felt(found, 0.1)
    felt(found, -0.02, count=10)
    assert felt(found, 0.02, count=10)[-1] == pytest.approx(np.full(7, 0.0523), rel=0.01)


def test_breaking_away_takes_more_than_sliding() -> None:
    level = [float(felt(friction(coulomb=0.2, static=1.5, stribeck_speed=0.01), rate)[-1, 0])
             for rate in (0.002, 0.01, 0.2)]  # fmt: skip
    assert level[0] == pytest.approx(0.2 * (1 + 0.5 * np.exp(-0.04)), rel=0.2)
    assert level[1] == pytest.approx(0.2 * (1 + 0.5 * np.exp(-1)), rel=1e-3)
    assert level[2] == pytest.approx(0.2, rel=1e-6)


def test_viscous_friction_grows_with_speed() -> None:
    assert felt(friction(viscous=0.5), 0.3)[-1] == pytest.approx(np.full(7, 0.15))


def test_friction_grows_with_the_load() -> None:
    assert felt(friction(load=0.01), 0.5, torque=-30.0)[-1] == pytest.approx(np.full(7, 0.3))


def test_robots_differ_by_the_spread() -> None:
    levels = [felt(friction(seed, coulomb=1.0, spread=0.2), 0.5)[-1] for seed in range(100)]
    assert np.std(levels) == pytest.approx(0.2, rel=0.1)


def test_friction_varies_around_a_turn() -> None:
    out = felt(friction(coulomb=1.0, position=0.1), 0.5, count=int(2 * np.pi / 0.5 / PERIOD))
    assert out[20:, 0].std() == pytest.approx(0.1, rel=0.03)


def test_compensated_friction_flips_sign_with_the_motion() -> None:
    found = friction(coulomb=0.3, compensated=1.0)
    assert felt(found, 0.2)[-1] == pytest.approx(np.zeros(7), abs=1e-9)
    assert felt(found, -0.2, count=1)[0] == pytest.approx(np.full(7, 0.6), rel=0.5)


def test_friction_starts_anywhere_within_its_level() -> None:
    starts = [friction(seed, coulomb=0.1).torque for seed in range(100)]
    assert np.abs(starts).max() <= 0.1
    assert np.std(starts) == pytest.approx(0.1 / np.sqrt(3), rel=0.1)


def rests(**sections: object) -> Rests:
    noise = model(**sections)
    return Rests(noise.sticking, noise.pose, 0.005, Streams(0))


def after(found: Rests, count: int, rate: float = 0.0) -> np.ndarray:
    out = np.zeros((count, 7))
    found.add(out, moving(count, rate))
    return out


def series(found: Rests, count: int = 400, seconds: int = 200) -> np.ndarray:
    """What sticks at the end of each of many rests, with motion between them."""
    ends: list[np.ndarray] = []
    for _ in range(count):
        after(found, 20, 0.3)
        ends.append(after(found, seconds)[-1])
    return np.array(ends)


def test_each_rest_is_a_new_force_of_the_stated_size() -> None:
    found = rests(sticking={"force": 0.15})
    after(found, 20, 0.3)
    assert np.ptp(after(found, 300)[-10:], axis=0).max() < 1e-6, "constant while the arm rests"
    forces = np.array([wrench(JACOBIAN, torque) for torque in series(found)])
    assert forces[:, :3].std(0) == pytest.approx(np.full(3, 0.15), rel=0.12)
    assert np.abs(forces[:, 3:]).max() < 1e-6
    assert abs(np.corrcoef(forces[:-1, 0], forces[1:, 0])[0, 1]) < 0.15


def test_a_torque_of_each_joint_adds_to_the_sticking_force() -> None:
    assert series(rests(sticking={"torque": 0.1})).std(0) == pytest.approx(
        np.full(7, 0.1), rel=0.12
    )


def test_sticking_builds_up_in_the_time_of_settling() -> None:
    found = rests(sticking={"force": {"fixed": [0, 0, 1.0]}, "settling": 0.1})
    after(found, 20, 0.3)
    built = np.array([wrench(JACOBIAN, torque)[2] for torque in after(found, 100)])
    assert built[19] == pytest.approx(1 - np.exp(-1), abs=0.03)


def test_motion_releases_sticking_within_the_release() -> None:
    found = rests(sticking={"force": 0.15, "release": 1.5e-3})
    rest = after(found, 400)[-1]
    step = 0.02 * 0.005 * np.sqrt(7)
    left = after(found, 40, 0.02)
    assert left[-1] == pytest.approx(rest * np.exp(-40 * step / 1.5e-3), rel=1e-6)


def test_sticking_without_a_release_lasts_until_the_next_rest() -> None:
    found = rests(sticking={"force": 0.15, "release": float("inf")})
    first = after(found, 400)[-1]
    assert after(found, 200, 0.3)[-1] == pytest.approx(first)
    assert after(found, 400)[-1] != pytest.approx(first)


def test_sticking_relaxes_while_the_arm_rests() -> None:
    found = rests(sticking={"force": 0.15, "relaxation": 2.0})
    early = after(found, 200)[-1]
    assert after(found, 400)[-1] == pytest.approx(early * np.exp(-1.0), rel=0.1)


def test_the_next_rest_remembers_the_last() -> None:
    torques = series(rests(sticking={"force": 0.15, "memory": 0.8}), count=1500, seconds=100)
    joint = torques[:, 1]
    assert np.corrcoef(joint[:-1], joint[1:])[0, 1] == pytest.approx(0.8, abs=0.06)
    plain = series(rests(sticking={"force": 0.15}), count=800, seconds=100)[:, 1]
    assert joint.std() == pytest.approx(plain.std(), rel=0.12), "as large as without memory"


def test_the_reported_pose_changes_only_with_motion() -> None:
    found = rests(pose={"repeatability": 1e-4})
    after(found, 200)
    before = found.pose_error.copy()
    after(found, 200)
    assert (found.pose_error == before).all()
    errors: list[np.ndarray] = []
    for _ in range(300):
        after(found, 100, 0.3)
        after(found, 100)
        errors.append(found.pose_error.copy())
    assert np.std(errors, axis=0) == pytest.approx(np.full(3, 1e-4), rel=0.15)
