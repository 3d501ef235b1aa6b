"""Signals tested for sense: each fault is found in time and called by its name, and a sound robot
is believed. The faults are injected behind the protocol, into an arm that moves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from faulty import Faulty, stuck

from palpate.common.pose import Pose
from palpate.robots.owner import load_description
from palpate.robots.robot import RobotState
from palpate.robots.safety import Expectation, violation
from palpate.robots.signals import Spikes
from palpate.robots.simulated.robot import MujocoRobot
from palpate.robots.watched import Watched
from palpate.trace.samples import Samples

ARM = load_description()
MOMENT = 0.8
"""s: while the arm moves."""
IN_TIME = 0.2
FORCES = ("wrench", "contact", "tau", "tau_ext")


def arm(noise: str = "none", seed: int = 0) -> MujocoRobot:
    spec = mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
    return MujocoRobot(spec, Pose.of((0, 0, 0)), ARM, noise=noise, seed=seed)


def ticked(robot: Watched, seconds: float) -> Iterator[RobotState]:
    """As the runner does it."""
    for _ in range(round(seconds / 0.02)):
        robot.advance(0.02)
        robot.drain()
        yield robot.state


def moving(faulty: Any, seconds: float = 2.0) -> Watched:
    """The robot after a straight motion, at the first fault or in the end."""
    watched = Watched(faulty, ARM)
    list(ticked(watched, 0.3))
    ahead = watched.state.pose_world_tcp.translate(np.array([0.05, 0.05, -0.1]))
    watched.move_pose(ahead, 0.1)
    for state in ticked(watched, seconds):
        if state.fault:
            return watched
    return watched


def every(change: Any) -> dict[str, Any]:
    """A change of every state."""
    return {"state": lambda _, now: change(now)}


def logged(change: Any) -> dict[str, Any]:
    """A change of every sample."""
    return {"samples": lambda samples, _: change(samples)}


def alternating(first: RobotState, now: RobotState) -> RobotState:
    high = round((now.t - first.t) / 0.02) % 2 == 0
    return replace(now, contact=now.contact + np.array([0, 0, 30.0 * high, 0, 0, 0]))


def jumped(samples: Samples) -> Samples:
    q = samples.q.copy()
    q[-1, 3] += 0.05
    return replace(samples, q=q)


def nan(samples: Samples) -> Samples:
    wrench = samples.wrench.copy()
    wrench[-1, 2] = np.nan
    return replace(samples, wrench=wrench)


FAULTS = {
    "frozen (wrench|contact|torques)": stuck(*FORCES),
    "frozen wrench": stuck("wrench"),
    "frozen contact": stuck("contact"),
    "frozen torques": stuck("tau", "tau_ext"),
    "frozen encoders": stuck("q", "dq"),
    "frozen (encoders|wrench)": stuck(*FORCES, "q", "dq", "pose_world_tcp", "twist", "width"),
    "not a number .*1 of .* samples of wrench": logged(nan),
    "spikes": {"state": alternating},
    "encoders jump .*joint 4": logged(jumped),
    "speeds against encoders": logged(lambda samples: replace(samples, dq=-5 * samples.dq)),
    "impossible torque": logged(lambda samples: replace(samples, tau_ext=samples.tau_ext + 500)),
    "time goes back": every(lambda now: replace(now, t=now.t - 5, stamp=now.stamp - 5)),
    "time goes back .*a sample": logged(lambda samples: replace(samples, t=samples.t - 5)),
    "time leaps .*passed": every(lambda now: replace(now, t=now.t + 5, stamp=now.stamp + 5)),
    "time leaps .*ahead": every(lambda now: replace(now, stamp=now.stamp + 5)),
    "time (stands|leaps)": {"state": lambda first, now: replace(now, t=first.t, stamp=first.stamp)},
    "the pose jumps": every(
        lambda now: replace(
            now, pose_world_tcp=now.pose_world_tcp.translate(np.array([0.0, 0.1, 0.0]))
        )
    ),
    "impossible width": every(lambda now: replace(now, width=0.2)),
    "the width jumps": every(lambda now: replace(now, width=0.0)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_found_in_time_and_called_by_its_name(name: str) -> None:
    robot = arm()
    watched = moving(Faulty(robot, MOMENT, **FAULTS[name]))
    assert watched.fault is not None
    assert robot.state.t - MOMENT <= IN_TIME + 1e-9
    assert MOMENT - 0.021 <= watched.fault.since <= robot.state.t
    reason = violation(watched.state, ARM.limits, Expectation())
    assert reason == watched.state.fault == str(watched.fault)
    assert re.match(name, reason), reason


@pytest.mark.parametrize(
    ("noise", "seed"),
    [("none", 0), ("lab", 0), ("datasheet", 0), *(("hardware", s) for s in range(6))],
)
def test_a_sound_robot_is_believed(noise: str, seed: int) -> None:
    watched = moving(arm(noise, seed), 1.5)
    watched.move_joints(ARM.home)
    watched.close_gripper()
    states = list(ticked(watched, 2.0))
    assert watched.fault is None
    assert states[-1].fault is None


def test_a_perfect_sensor_may_rest_and_a_noisy_one_may_not() -> None:
    for noise, found in (("none", None), ("lab", "frozen torques")):
        watched = Watched(Faulty(arm(noise), 1.2, **stuck(*FORCES)), ARM)
        list(ticked(watched, 1.2 + IN_TIME))
        assert (watched.fault is None) == (found is None)


def test_a_single_frozen_torque_sensor_is_detected() -> None:
    def one(samples: Samples, first: RobotState) -> Samples:
        torques = samples.tau_ext.copy()
        torques[:, 2] = first.tau_ext[2]
        return replace(samples, tau_ext=torques)

    watched = Watched(Faulty(arm("lab"), 1.2, samples=one), ARM)
    list(ticked(watched, 1.2 + IN_TIME))
    assert watched.fault is not None
    assert "frozen torques" in str(watched.fault)
    assert "in column 3" in str(watched.fault)


def test_signals_that_are_sound_are_not_tested_for_freezing_but_filtered() -> None:
    """A simulated robot without noise is believed as a real one, and judged by its forces."""
    for sound in (False, True):
        watched = Watched(Faulty(arm("lab"), 1.2, **stuck(*FORCES)), ARM, sound)
        list(ticked(watched, 1.2 + IN_TIME))
        assert (watched.fault is None) == sound
    for change, found in (
        (biased(12.0), "a force out of nothing"),
        ({"state": alternating}, "spikes"),
    ):
        watched = Watched(Faulty(arm(), 0.4, **change), ARM, sound=True)
        list(ticked(watched, 2.0))
        assert found in str(watched.fault)


def test_a_spike_of_one_state_is_filtered_and_no_fault() -> None:
    def once(first: RobotState, now: RobotState) -> RobotState:
        if now.t > first.t:
            return now
        return replace(now, contact=now.contact + 50.0, tau=now.tau + 100.0)

    watched = Watched(Faulty(arm(), MOMENT, state=once), ARM)
    states = list(ticked(watched, 1.5))
    assert watched.fault is None
    assert max(float(np.abs(state.contact).max()) for state in states) < 2.0
    assert max(float(np.abs(state.tau).max()) for state in states) < 87.0


def test_a_force_that_stays_is_reported_one_state_later() -> None:
    pushed = every(lambda now: replace(now, contact=now.contact + np.array([0, 0, 20.0, 0, 0, 0])))
    watched = Watched(Faulty(arm(), MOMENT, **pushed), ARM)
    felt = [state for state in ticked(watched, 0.95) if state.contact[2] > 15.0]
    assert MOMENT < felt[0].t < MOMENT + 0.041


def test_an_empty_hand_at_rest_feels_nothing() -> None:
    watched = Watched(Faulty(arm("lab"), 0.4, **biased(12.0)), ARM)
    list(ticked(watched, 1.0))
    assert watched.fault is not None
    assert "a force out of nothing" in str(watched.fault)


def test_friction_that_a_motion_left_in_the_joints_is_no_fault() -> None:
    """Up to 7.5 N at `hardware`."""
    watched = Watched(Faulty(arm("lab"), 0.0, **biased(7.5)), ARM)
    list(ticked(watched, 1.0))
    assert watched.fault is None


def test_samples_before_the_watch_began_stay_evidence() -> None:
    """A robot that has measured for a while is watched anew when something is measured again."""
    robot = arm("lab")
    robot.advance(1.0)
    watched = Watched(Faulty(robot, 1.0, **biased(12.0)), ARM)
    list(ticked(watched, 0.5))
    assert watched.fault is not None
    assert 1.0 <= watched.fault.since < 1.1


def biased(force: float) -> dict[str, Any]:
    """A force of so many N in every state."""
    return every(lambda now: replace(now, contact=now.contact + np.array([0, force, 0, 0, 0, 0])))


@pytest.mark.parametrize(("size", "is_fault"), [(3.0, False), (5.0, True)])
def test_a_contact_that_sticks_and_slips_is_no_spike(size: float, is_fault: bool) -> None:
    """A rubbing moment of 3 N m swings to its negative; one of 3 N m does not leap by 8 N m."""
    robot = arm()
    spikes, found = Spikes(robot.limits), []
    for tick in range(60):
        moment = -size if tick > 5 and tick % 3 == 0 else 3.0
        contact = np.array([20.0, 0.0, -20.0, moment, 0.0, 0.0])
        found.append(spikes.follow(replace(robot.state, t=0.02 * tick, contact=contact)))
    assert any(found) == is_fault
