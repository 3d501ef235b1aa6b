"""An arm explains its own recording, and no other: the message names the likely mistake."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from moving_arm import inverse, recorded
from mujoco import MjModel

from bench.recorded import free_motion, real
from palpate.common.errors import InputError
from palpate.estimation.recording_check import Claim, explained, explained_upright
from palpate.robots.description import RobotDescription
from palpate.robots.owner import load_description
from palpate.trace.recording import ArmLog

FR3, IIWA = load_description("fr3"), load_description("iiwa14")
REAL = Path(__file__).parents[4] / "shared" / "real"
HAND = 0.76
CONSTANTS = np.array([24.0, 24.0, 12.0, 8.0, 4.0, 4.0, 4.0])
"""N m of a joint for each ampere of its motor."""


@cache
def upright(name: str = "fr3", hand: float = HAND, seconds: float = 8.0) -> ArmLog:
    return recorded(load_description(name), hand, seconds)


def part(log: ArmLog, start: int, end: int) -> ArmLog:
    rows = slice(start, end)
    return ArmLog(log.t[rows], log.q[rows], log.dq[rows], log.tau[rows], None, "part")


def reachable(log: ArmLog) -> ArmLog:
    """Rows at angles that an iiwa, too, can have; an FR3's joint 4 bends further."""
    rows = log.q[:, 3] > IIWA.limits.q_min[3]
    return ArmLog(log.t[rows], log.q[rows], log.dq[rows], log.tau[rows], None, log.source)


def without_weight(log: ArmLog) -> ArmLog:
    model, still = MjModel.from_xml_path(str(FR3.mjcf)), np.zeros_like(log.q)
    return replace(log, tau=log.tau - inverse(model, log.q, still, still))


def at_rest(log: ArmLog, rows: tuple[int, ...]) -> ArmLog:
    """Rests of a second each at the angles of some rows, with the weight of the arm and an offset."""
    q = np.repeat(log.q[list(rows)], 100, axis=0)
    model, still = MjModel.from_xml_path(str(FR3.mjcf)), np.zeros_like(q)
    tau = inverse(model, q, still, still) + 0.2
    return ArmLog(np.arange(len(q)) / 100.0, q, still, tau, None, "rests")


@pytest.mark.parametrize("hand", [1e-6, HAND, HAND + 3.0])
def test_an_arm_explains_its_recording_with_any_hand_up_to_its_payload(hand: float) -> None:
    whole = upright(hand=hand)
    assert explained_upright(whole, FR3).statistic < 0.25
    assert explained_upright(part(whole, 500, 750), FR3).statistic < 0.35
    assert explained_upright(part(whole, 500, 520), FR3).passed
    assert explained_upright(part(whole, 500, 501), FR3).passed


def test_an_arm_at_rest_explains_its_recording() -> None:
    log = upright()
    assert explained_upright(at_rest(log, (0,)), FR3).passed
    assert explained_upright(at_rest(log, (0, 500, 1000, 1500)), FR3).passed


@pytest.mark.parametrize("noise", ["none", "lab", "datasheet", "hardware", "measured"])
def test_the_simulated_arm_explains_its_recording(noise: str) -> None:
    assert explained_upright(free_motion(noise, 2, 4.0), FR3).statistic < 0.5


def test_another_arm_explains_its_own_recording() -> None:
    assert explained_upright(reachable(upright("iiwa14")), IIWA).statistic < 0.25


WRONG: dict[str, tuple[Callable[[], ArmLog], str]] = {
    "sign": (lambda: replace(upright(), tau=-upright().tau), "have the opposite sign"),
    "mN m": (
        lambda: replace(upright(), tau=1e3 * upright().tau),
        "e+03 times what holds the arm up",
    ),
    "A": (lambda: replace(upright(), tau=upright().tau / 11.0), "torques are 0.09"),
    "A of several motors": (
        lambda: replace(upright(), tau=upright().tau / CONSTANTS),
        "before the gears",
    ),
    "without gravity": (lambda: without_weight(upright()), "own weight is not in the torques"),
    "noise": (
        lambda: replace(upright(), tau=np.random.default_rng(0).normal(size=(2000, 7))),
        "own weight is not in the torques",
    ),
    "ceiling": (
        lambda: recorded(FR3, HAND, 8.0, gravity=(0.0, 0.0, 9.81)),
        "on a ceiling",
    ),
    "wall": (
        lambda: recorded(FR3, HAND, 8.0, gravity=(9.81, 0.0, 0.0)),
        "on a wall, or tilted): gravity acts along (1.0",
    ),
    "tilted": (
        lambda: recorded(FR3, HAND, 8.0, gravity=(0.0, 4.9, -8.5)),
        "gravity acts along (-0.00, 0.50, -0.87)",
    ),
    "payload": (lambda: upright(hand=HAND + 6.0), "more than the arm's payload of 3 kg"),
    "order of joints": (
        lambda: replace(upright(), tau=upright().tau[:, ::-1]),
        "joints are in another order",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_recording_fails_with_its_cause(wrong: str) -> None:
    made, cause = WRONG[wrong]
    found = explained_upright(made(), FR3)
    assert found.statistic > 2.0
    assert cause in found.finding
    assert "another arm (arm=NAME" in found.finding


def of_joint(log: ArmLog, joint: int, torques: np.ndarray) -> ArmLog:
    """A recording with other torques (n,) of one joint."""
    return replace(log, tau=np.where(np.arange(7) == joint - 1, torques[:, None], log.tau))


def exchanged(log: ArmLog, order: list[int], *signals: str) -> ArmLog:
    """A recording with the columns of some signals in another order."""
    columns = np.array(order) - 1
    return replace(log, **{name: getattr(log, name)[:, columns] for name in signals})


FREEZES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "zero": lambda tau: 0.0 * tau,
    "constant": lambda tau: 0.0 * tau + 0.7,
    "from the middle on": lambda tau: np.where(np.arange(len(tau)) < 1000, tau, tau[1000]),
}


@pytest.mark.parametrize("joint", [2, 5, 7])
@pytest.mark.parametrize("kind", FREEZES)
def test_a_frozen_torque_is_refused(kind: str, joint: int) -> None:
    log = upright()
    frozen = of_joint(log, joint, FREEZES[kind](log.tau[:, joint - 1]))
    with pytest.raises(InputError, match=f"the torque of joint {joint} stays at .* is dead"):
        explained_upright(frozen, FR3)


@pytest.mark.parametrize("joint", [2, 5, 7])
def test_a_torque_of_mere_noise_fails(joint: int) -> None:
    noise = 0.02 * np.random.default_rng(0).normal(size=2000)
    found = explained_upright(of_joint(upright(), joint, noise), FR3)
    assert found.statistic > 2.0
    assert f"the torque of joint {joint} varies by" in found.finding


ORDERS: dict[str, tuple[list[int], tuple[str, ...], str]] = {
    "torques of 5 and 7": ([1, 2, 3, 4, 7, 6, 5], ("tau",), "torques logged for joints 5, 7"),
    "torques of 6 and 7": ([1, 2, 3, 4, 5, 7, 6], ("tau",), "torques logged for joints 6, 7"),
    "torques of three": ([1, 2, 3, 4, 7, 5, 6], ("tau",), "5, 6, 7 are those of joints 7, 5, 6"),
    "angles of 5 and 7": ([1, 2, 3, 4, 7, 6, 5], ("q", "dq"), "angles logged for joints 5, 7"),
}


@pytest.mark.parametrize("case", ORDERS)
def test_exchanged_joints_fail(case: str) -> None:
    order, signals, named = ORDERS[case]
    found = explained_upright(exchanged(upright(), order, *signals), FR3)
    assert found.statistic > 1.5
    assert named in found.finding


def test_angles_without_their_velocities_are_refused() -> None:
    log = exchanged(upright(), [1, 2, 3, 4, 7, 6, 5], "q")
    with pytest.raises(InputError, match=r"the velocities of joint 5 are .* the change of the"):
        explained_upright(log, FR3)


@pytest.mark.parametrize("joint", [2, 5])
def test_a_joint_of_the_opposite_sign_fails(joint: int) -> None:
    log = upright(seconds=16.0)
    found = explained_upright(of_joint(log, joint, -log.tau[:, joint - 1]), FR3)
    assert f"torques of joint {joint} have the opposite sign" in found.finding


@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_a_load_in_a_part_of_the_recording_fails(mass: float) -> None:
    empty, loaded = upright(), upright(hand=HAND + mass)
    later = (empty.t > 4.0)[:, None]
    found = explained_upright(replace(empty, tau=np.where(later, loaded.tau, empty.tau)), FR3)
    assert not found.passed
    masses = re.search(r"in 4 equal parts (.*) kg", found.finding)
    assert masses is not None
    expected = np.array([0.0, 0.0, mass, mass])
    assert np.array(masses[1].split(", "), dtype=float) == pytest.approx(
        expected, rel=0.1, abs=0.05
    )


def test_a_hanging_arm_explains_its_recording_where_that_is_stated() -> None:
    log, up = recorded(FR3, HAND, 8.0, gravity=(0.0, 0.0, 9.81)), np.array([0.0, 0.0, 9.81])
    every = np.ones(len(log), dtype=bool)
    assert explained(Claim.of(log, FR3.nominal, up, ~every, every)).statistic < 0.25
    found = explained(Claim.of(upright(), FR3.nominal, up, ~every, every))
    assert "upright, or tilted" in found.finding


@pytest.mark.parametrize(("name", "other"), [("iiwa14", FR3), ("fr3", IIWA)])
def test_a_recording_of_another_arm_fails(name: str, other: RobotDescription) -> None:
    found = explained_upright(reachable(upright(name)), other)
    assert found.statistic > 1.5
    assert "another arm (arm=NAME" in found.finding


def test_angles_and_velocities_that_the_arm_cannot_have_are_refused() -> None:
    log = upright()
    with pytest.raises(InputError, match=r"joint 6 is at 0\.02 to 0\.03 rad, and 'fr3' turns it"):
        explained_upright(replace(log, q=np.radians(log.q)), FR3)
    with pytest.raises(
        InputError, match=r"joint 1 turns at .* rad/s, and .* at most at 2\.62: state"
    ):
        explained_upright(replace(log, dq=1e3 * log.dq), FR3)


@pytest.mark.parametrize("factor", [0.0, -1.0, 1.0 / 0.6])
def test_velocities_that_do_not_follow_from_the_angles_are_refused(factor: float) -> None:
    log = upright()
    with pytest.raises(
        InputError, match=r"velocities are .* times the change of the angles: state"
    ):
        explained_upright(replace(log, dq=factor * log.dq), FR3)


@pytest.mark.skipif(not REAL.is_dir(), reason="recordings of real arms are not here")
@pytest.mark.parametrize("name", ["fr3_free_1", "panda_free"])
def test_real_arms_explain_their_recordings(name: str) -> None:
    """A real FR3, and a real Panda without a hand by the description of an FR3; an iiwa is neither."""
    log = real(REAL / f"{name}.npz")
    assert explained_upright(log, FR3).statistic < 0.2
    seconds = round(len(log) / log.t[-1])
    for start in (0, 3 * seconds, 6 * seconds):
        assert explained_upright(part(log, start, start + 3 * seconds), FR3).statistic < 0.2
    # Exchanged torques and a dead column of its wrist are named.
    swapped = exchanged(log, [1, 2, 3, 4, 5, 7, 6], "tau")
    assert "torques logged for joints 6, 7" in explained_upright(swapped, FR3).finding
    with pytest.raises(InputError, match="the torque of joint 7 stays at"):
        explained_upright(of_joint(log, 7, 0.0 * log.t), FR3)
    # Its wrist bends further than an iiwa's.
    with pytest.raises(InputError, match="'iiwa14' turns it from"):
        explained_upright(log, IIWA)
