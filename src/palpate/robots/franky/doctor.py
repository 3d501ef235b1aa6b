"""Checks of `palpate doctor --robot`, each with its remedy.

The arm does not move. If allowed, it holds still under control for some seconds.
"""

from __future__ import annotations

import os
import platform
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.common.errors import InputError, PalpateError
from palpate.common.pose import Array, Pose
from palpate.common.processes import Call
from palpate.robots.description import RobotDescription
from palpate.robots.franky import control_box
from palpate.robots.franky.control_box import SPOKEN, Address, franky, greet
from palpate.robots.franky.session import FrankySession, pose_of, require_end_effector
from palpate.robots.nominal import NominalArm
from palpate.trace.samples import STANDARD_GRAVITY

NEAR_END = np.radians(5.0)  # rad: a joint nearer to its end stop has no room to plan with
# kg, m: tolerance between the end effectors of Desk and robot.yaml. At 5 cm from the wrist's axis
# this is 0.2 N m.
WEIGHT, CENTRE = 0.05, 0.01
# N m: torque beyond the model that each joint of a resting arm may show. It covers static friction
# and the model's error (Gaz et al., RA-L 2019, doi:10.1109/LRA.2019.2931248, about 1 N m in the
# large joints).
LEFT = (1.5, 1.5, 1.5, 1.5, 0.6, 0.6, 0.6)
# Share of cycles that must be answered in time. franky-control's README and libfranka's
# communication_test demand more than 0.95.
ARRIVE = 0.99
LISTENED = 5.0  # s


class CheckResult(NamedTuple):
    """Result of one check."""

    good: bool
    what: str  # name of the check
    detail: str  # value or remedy

    @classmethod
    def of(cls, good: bool, what: str, detail: str, remedy: str) -> CheckResult:
        """Make the result of a check, with the remedy after the detail if it failed."""
        return cls(good, what, detail if good else f"{detail}: {remedy}")


def examine(
    address: Address, arm: RobotDescription, pose_world_base: Pose, may_hold: Callable[[], bool]
) -> Iterator[CheckResult]:
    """Yield the results in order; a failed check that later checks depend on ends them."""
    # Communication with the control box, then the computer.
    began = time.perf_counter()
    greeting = greet(address)
    took = time.perf_counter() - began
    if greeting.problem is not None:
        yield CheckResult(False, "control box", greeting.problem)
        return
    yield CheckResult(True, "control box", f"{address.host} answers in {1e3 * took:.0f} ms")
    yield CheckResult(
        True, "robot interface", f"version {greeting.version}, as franky-control's ({SPOKEN})"
    )
    yield from check_computer(address)
    try:
        session = FrankySession(address)
    except PalpateError as error:
        yield CheckResult(False, "connection", str(error))
        return
    # The arm and the hand; control is tried only if both are in order.
    try:
        lines = [*check_arm(session, arm, pose_world_base), *check_hand(session)]
        yield from lines
        if all(line.good for line in lines):
            yield check_cycles(session, arm, may_hold)
        else:
            why = "not tried: an arm that is not well does not hold itself"
            yield CheckResult(False, "answered cycles", why)
    except PalpateError as error:
        yield CheckResult(False, "arm", str(error))
    finally:
        session.close()


def check_computer(address: Address) -> Iterator[CheckResult]:
    """Check for a realtime kernel, and the permission to use realtime priority."""
    kernel = platform.release()
    realtime = Path("/sys/kernel/realtime")
    good = realtime.is_file() and realtime.read_text().strip() == "1"
    remedy = (
        f"{kernel} is none: install a PREEMPT_RT kernel (Ubuntu: linux-image-realtime), or give "
        "?realtime=ignore and expect lost cycles"
    )
    if not address.realtime:
        remedy = f"{kernel} is none, which this address does not ask for"
    detail = kernel if good else remedy
    yield CheckResult(good or not address.realtime, "realtime kernel", detail)
    # Highest realtime priority that this user may have.
    most = allowed = os.sched_get_priority_max(os.SCHED_FIFO)
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
    if os.geteuid() != 0 and limit != resource.RLIM_INFINITY:
        allowed = min(limit, most)
    remedy = "add '@realtime - rtprio 99' to /etc/security/limits.conf, and yourself to the group"
    yield CheckResult.of(allowed >= most, "realtime priority", f"up to {allowed} of {most}", remedy)


def check_arm(
    session: FrankySession, arm: RobotDescription, pose_world_base: Pose
) -> Iterator[CheckResult]:
    """Check mode, errors, posture, end effector, kinematics and weight of the arm."""
    state = session.state()
    problem = control_box.of_mode(state)
    yield CheckResult(
        problem is None, "mode", problem or control_box.MODES[control_box.mode_of(state)]
    )
    errors = control_box.errors_of(state)
    cleared = f"{', '.join(errors)}: see what it met, and clear them in Desk"
    yield CheckResult(not errors, "errors", cleared if errors else "none")
    yield check_margins(np.array(state.q), arm)
    yield check_end_effector(state, arm)
    try:
        nominal = NominalArm(arm, pose_world_base, np.zeros(3))
        away = require_end_effector(state, nominal, pose_world_base)
        yield CheckResult(True, "TCP", f"{1e3 * away:.2f} mm from the description's")
    except InputError as error:
        yield CheckResult(False, "TCP", str(error))
    detail = f"their height is known to ± {2e3 * arm.real().nominal.tip_offset_std:.1f} mm"
    if arm.config is None or arm.config.tip_offset is None:
        detail += ", not measured on this arm: palpate calibrate --gauge HEIGHT"
    yield CheckResult(True, "fingertips", detail)
    yield check_weight(session, state, arm, pose_world_base)


def check_margins(q: Array, arm: RobotDescription) -> CheckResult:
    """Check the joints' distance from their end stops."""
    limits = arm.limits
    room = np.minimum(q - limits.q_min, limits.q_max - q)
    i = int(room.argmin())
    detail = f"joint {i + 1} is {np.degrees(room[i]):.0f}° from its end stop"
    good = bool(room[i] >= NEAR_END)
    detail += ", the others farther" if good else ""
    return CheckResult.of(good, "joint margins", detail, "guide the arm to its middle by hand")


def check_end_effector(state: Any, arm: RobotDescription) -> CheckResult:
    """Compare the end effector set in Desk with the one of robot.yaml."""
    mass, centre = float(state.m_ee), np.array(state.F_x_Cee)
    told = f"{mass:.3f} kg at {millimetres(centre)} mm from the flange"
    known = arm.end_effector
    if known is None:
        if mass <= 0.0:
            none = "nothing, as Desk has it: set the Franka Hand as end effector (Settings)"
            return CheckResult(False, "end effector", none)
        return CheckResult(
            True, "end effector", f"{told}, as Desk has it; robot.yaml says nothing of it"
        )
    # From the axes of the hand's body into those of the flange, by the TCP that both frames have.
    site = arm.spec().compile().site(arm.tcp)
    hand_in_flange = pose_of(state.F_T_EE) @ Pose(site.pos.copy(), site.quat.copy()).inverse()
    wanted = hand_in_flange.apply(known.centre)
    if abs(mass - known.mass) <= WEIGHT and float(np.linalg.norm(centre - wanted)) <= CENTRE:
        near = f"{1e3 * WEIGHT:.0f} g and {1e3 * CENTRE:.0f} mm"
        return CheckResult(True, "end effector", f"{told}, as robot.yaml says within {near}")
    return CheckResult(
        False,
        "end effector",
        f"{told}, but robot.yaml says {known.mass:.3f} kg at {millimetres(wanted)} mm: set the same "
        "in Desk (Settings, End effector) and in robot.yaml",
    )


def millimetres(point: Array) -> list[int]:
    """Round a point (3,) in m to whole mm."""
    return np.round(1e3 * point).astype(int).tolist()


def check_weight(
    session: FrankySession, state: Any, arm: RobotDescription, pose_world_base: Pose
) -> CheckResult:
    """Check the joint torques of a resting arm against its gravity model."""
    down = np.array([0.0, 0.0, -(arm.gravity or STANDARD_GRAVITY)])
    into_base = pose_world_base.rotation.T @ down
    weight = session.model.gravity(state.q, state.m_total, state.F_x_Ctotal, into_base)
    left = np.array(state.tau_J) - np.array(weight)
    excess = np.abs(left) - np.array(LEFT)
    i = int(excess.argmax())
    detail = f"joint {i + 1} feels {left[i]:+.2f} N m beyond its model at rest"
    remedy = (
        "is anything in the hand, does it touch something, is the end effector's mass right, does the base "
        "stand upright?"
    )
    return CheckResult.of(bool(excess[i] <= 0.0), "gravity residual", detail, remedy)


def check_hand(session: FrankySession) -> Iterator[CheckResult]:
    """Check that the hand answers, is homed and empty."""
    try:
        state = Call(lambda: session.gripper.state, "palpate fingers").result(LISTENED)
    except Exception as error:
        yield CheckResult(False, "hand", f"{error}: is it set as end effector in Desk?")
        return
    homed = state.max_width > 0.0
    detail = f"opens {1e3 * state.max_width:.0f} mm"
    yield CheckResult(homed, "hand", detail if homed else "not homed: Homing in Desk, End effector")
    if state.is_grasped:
        yield CheckResult(
            False, "fingers", f"hold something at {1e3 * state.width:.0f} mm: take it out"
        )


def check_cycles(
    session: FrankySession, arm: RobotDescription, may_hold: Callable[[], bool]
) -> CheckResult:
    """Measure the share of cycles that are answered in time, while the arm holds still."""
    if not may_hold():
        return CheckResult(
            True, "answered cycles", "not tried: the arm was not allowed to hold itself"
        )
    module, robot = franky(), session.robot
    motion = module.JointImpedanceTrackingMotion(stiffness=arm.stiffness.joints)
    robot.move(motion, asynchronous=True)
    rates: list[float] = []
    until = time.perf_counter() + LISTENED
    while time.perf_counter() < until and robot.is_in_control:
        time.sleep(0.05)
        rates.append(float(robot.state.control_command_success_rate))
    # Leave out the first quarter, while the loop starts.
    settled = rates[len(rates) // 4 :]
    rate = float(np.mean(settled)) if settled else 0.0
    detail = f"{100 * rate:.1f} % over {LISTENED:g} s"
    remedy = "use a realtime kernel, a network card and cable of its own, and no power saving"
    return CheckResult.of(rate >= ARRIVE, "answered cycles", detail, remedy)
