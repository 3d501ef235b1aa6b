"""The parts of the driver for a Franka, on objects that stand for the library's."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from itertools import chain, count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from franka import ARM, BASE, DOWN, NOMINAL, Gripper, affine, state

import palpate as pp
from palpate.common.pose import Pose
from palpate.robots.franky import control_box as faults
from palpate.robots.franky import doctor
from palpate.robots.franky.drive import CYCLE, CycleRow, Drive, Reacted, joint_course, pose_course
from palpate.robots.franky.link import HandThread, StateListener
from palpate.robots.franky.session import (
    FrankySession,
    StateReadout,
    black_box,
    require_end_effector,
)
from palpate.robots.sheet import Reflex
from palpate.robots.trajectory import MotionState, PosePath, Stretch, rotate_quaternion, straight


def until(so: Any) -> None:
    """Wait for a thread of the hand's, 5 s at most."""
    for _ in range(500):
        if so():
            return
        time.sleep(0.01)
    pytest.fail("it is not so within 5 s")


def test_a_hand_holds_what_it_closed_on_and_nothing_else() -> None:
    gripper = Gripper()
    hand = HandThread(gripper, ARM.hand)
    gripper.may_end.clear()
    gripper.now = SimpleNamespace(width=0.04, is_grasped=True)
    hand.close(20.0)
    until(lambda: hand.fingers.width == 0.04)
    assert hand.moving
    assert not hand.gripping, "while the fingers still close"
    gripper.may_end.set()
    until(lambda: not hand.moving)
    assert hand.gripping
    gripper.now = SimpleNamespace(width=0.0015, is_grasped=True)
    until(lambda: not hand.gripping)
    gripper.now = SimpleNamespace(width=0.004, is_grasped=True)
    until(lambda: hand.gripping)
    gripper.now = SimpleNamespace(width=0.004, is_grasped=False)
    until(lambda: not hand.gripping)
    gripper.now = SimpleNamespace(width=0.04, is_grasped=True)
    hand.open()
    until(lambda: not hand.moving)
    assert not hand.gripping, "though the last packet says so"
    hand.end()


def test_a_hand_closes_with_the_requested_force_within_its_range() -> None:
    gripper = Gripper()
    hand = HandThread(gripper, ARM.hand)
    for force in (20.0, 500.0, None):
        hand.close(force)
        until(lambda: not hand.moving)
    assert [call[3] for call in gripper.calls] == [20.0, ARM.hand.force, ARM.hand.force]
    width, speed, _, inner, outer = gripper.calls[0][1:]
    assert (width, speed) == (0.0, ARM.hand.speed)
    assert width - inner < 0.0 < ARM.hand.opening < outer, "any width counts as a grasp"
    hand.end()


def test_a_hand_is_lost_after_three_queries_without_an_answer() -> None:
    class Mute(Gripper):
        asked = 0

        @property
        def state(self) -> SimpleNamespace:
            self.asked += self.lost
            return super().state

    gripper = Mute()
    hand = HandThread(gripper, ARM.hand)
    gripper.lost = True
    until(lambda: hand.lost is not None)
    assert gripper.asked in (3, 4), "one more where it fell silent within a query"
    hand.end()


def test_a_miss_is_no_problem_of_the_hand_and_fingers_that_stay_closed_are() -> None:
    gripper = Gripper()
    hand = HandThread(gripper, ARM.hand)
    gripper.answers = False
    hand.close(None)
    until(lambda: not hand.moving)
    assert hand.problem is None
    hand.open()
    until(lambda: not hand.moving)
    assert hand.problem == "the hand did not open"
    gripper.lost = True
    until(lambda: hand.lost is not None)
    assert "does not answer any more" in str(hand.lost)
    hand.end()


def test_a_hand_that_holds_something_is_not_taken_over() -> None:
    with pytest.raises(pp.Unavailable, match="holds something at 40 mm: take it out"):
        HandThread(Gripper(0.04, is_grasped=True), ARM.hand).require_free()
    for empty in (Gripper(0.001, is_grasped=True), Gripper(0.04)):
        hand = HandThread(empty, ARM.hand)
        hand.require_free()
        hand.end()


def readout(first: Any, gains: float = 0.0) -> StateReadout:
    """Of an arm whose model has gravity torques of 1 N m in each joint."""
    model = SimpleNamespace(gravity=lambda *_: np.ones(7))
    return StateReadout(NOMINAL, model, first, BASE, DOWN, np.full(7, gains))


def test_five_cycles_make_a_sample_of_their_means() -> None:
    out = readout(state(0.0), gains=0.25)
    rows = [
        CycleRow(state(t, tau_J=np.full(7, 1.25 + k), tau_J_d=np.full(7, k)), np.full(7, k))
        for k, t in enumerate(0.001 * np.arange(5, 11))
    ]
    samples = out.read(rows, width=0.03)
    assert len(samples) == 1, "the sixth cycle begins another one"
    assert samples.t[0] == pytest.approx(0.009)
    tau = (1.25 + 2.0) / 1.25
    assert out.tau == pytest.approx(tau), "less the sensors' gain errors"
    assert samples.tau_ext[0] == pytest.approx(tau - 1.0), "less the arm's own weight"
    assert out.commanded == pytest.approx(2.0)
    assert samples.target_world_tcp[0] == pytest.approx(2.0)
    assert samples.width[0] == 0.03
    assert (out.stamp, len(out.read(rows, 0.03))) == (0.010, 0), "no cycle counts twice"
    assert len(out.read([CycleRow(state(0.015), np.zeros(7))], 0.03)) == 1


def test_wrenches_are_read_in_the_worlds_axes() -> None:
    force = np.array([0.0, 0.0, -12.0])
    q = ARM.home + 0.1
    torque = NOMINAL.kinematics(q[None]).jacobian[0].T @ [*force, 0.0, 0.0, 0.0]
    own = [*(BASE.rotation.T @ [3.0, 0.0, 0.0]), *(BASE.rotation.T @ [0.0, 2.0, 0.0])]
    out = readout(state(0.0))
    shown = [
        CycleRow(state(t, q, tau_J=torque + 1.0, O_F_ext_hat_K=own), np.zeros(7))
        for t in (0.005, 0.01)
    ]
    samples = out.read(shown, 0.08)
    assert samples.wrench[0] == pytest.approx([*force, 0.0, 0.0, 0.0], abs=1e-4)
    assert out.contact == pytest.approx([3.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    assert samples.pose_world_tcp[0] == pytest.approx(NOMINAL.poses(q[None])[0], abs=1e-9)


@pytest.mark.parametrize(("away", "turned"), [(0.003, 0.0), (0.0, 0.02)])
def test_another_end_effector_than_the_descriptions_is_refused(away: float, turned: float) -> None:
    now = state(0.0)
    assert require_end_effector(now, NOMINAL, BASE) == pytest.approx(0.0, abs=1e-9)
    theirs = Pose(np.array(now.O_T_EE.translation), np.roll(now.O_T_EE.quaternion, 1))
    other = theirs @ Pose.of((0.0, 0.0, away), (np.cos(turned / 2), np.sin(turned / 2), 0.0, 0.0))
    with pytest.raises(pp.InputError, match="set the Franka Hand as end effector in Desk"):
        require_end_effector(state(0.0, O_T_EE=affine(other)), NOMINAL, BASE)


def test_a_black_box_holds_every_cycle_and_why_it_was_kept() -> None:
    rows = [CycleRow(state(0.001 * k, tau_J=np.full(7, k)), np.full(7, 2.0 * k)) for k in range(4)]
    kept = black_box(rows, "a reflex")
    assert kept is not None
    assert (str(kept["why"]), kept["mode"].tolist()) == ("a reflex", ["Move"] * 4)
    assert kept["t"] == pytest.approx(0.001 * np.arange(4))
    assert kept["tau_J"][:, 0] == pytest.approx(np.arange(4))
    assert kept["target_world_tcp"][:, 0] == pytest.approx(2.0 * np.arange(4))
    assert black_box([], "a reflex") is None


def test_a_joint_course_leads_to_its_end_and_rests_there() -> None:
    still = MotionState(ARM.home, np.zeros(7), np.zeros(7))
    goal = ARM.home + 0.2
    course = joint_course(straight(0.0, still, goal, [Stretch(1.0, 1.0)], 5.0), NOMINAL)
    assert course.rows[-1] == pytest.approx(goal)
    assert not course.rates[-1].any()
    middle = course.last // 2
    assert course.rates[middle] == pytest.approx(
        (course.rows[middle + 1] - course.rows[middle - 1]) / (2 * CYCLE)
    )
    assert course.row(1e3) == course.last
    assert course.target(course.last * CYCLE) == pytest.approx(
        NOMINAL.poses(goal[None])[0], abs=1e-9
    )
    tenth = NOMINAL.poses(course.rows[10][None])[0]
    assert course.target(10 * CYCLE) == pytest.approx(tenth, abs=1e-9)
    assert course.target(0.0) == pytest.approx(NOMINAL.poses(ARM.home[None])[0], abs=1e-9)


def test_a_cartesian_course_is_in_the_bases_axes() -> None:
    begin, origin = NOMINAL.poses(ARM.home[None])[0], np.array([0.0, 1.0, 0.0, 0.0])
    still = MotionState(np.array([*begin[:3], 0.0, 0.0, 0.0]), np.zeros(6), np.zeros(6))
    way = np.array([0.05, 0.0, 0.1, 0.0, 0.3, 0.0])
    path = straight(0.0, still, still.p + way, [Stretch(1.0, 1.0)], 5.0)
    course = pose_course(PosePath(path, origin), ARM.home, BASE)
    x, y, z, w = course.rows[-1, 3:]
    end = BASE @ Pose(course.rows[-1, :3], np.array([w, x, y, z]))
    wanted = Pose(still.p[:3] + way[:3], rotate_quaternion(origin, way[None, 3:])[0])
    assert end.distance_to(wanted) < 1e-9
    assert end.angle_to(wanted) < 1e-6
    assert course.target(1e3) == pytest.approx(wanted.vector)
    i = course.last // 2
    along = BASE.rotation @ course.rates[i, :3]
    assert along / np.linalg.norm(along) == pytest.approx(way[:3] / np.linalg.norm(way[:3]))
    about = BASE.rotation @ course.rates[i, 3:]
    assert about / np.linalg.norm(about) == pytest.approx([0.0, -1.0, 0.0], abs=1e-9), (
        "its tool points down"
    )
    assert not course.rates[-1].any()


@pytest.mark.parametrize(
    ("error", "mode", "said"),
    [
        ("libfranka: User stop pressed", None, "the user stop was pressed: release the user stop"),
        ("move failed", "UserStopped", "the user stop was pressed"),
        ("Net Exception: broken pipe", None, "the connection to the control box is lost"),
        ("libfranka: UDP receive timeout", "Reflex", "the connection to the control box is lost"),
        ("cartesian_reflex", None, "the arm stopped itself (cartesian_reflex): see what it met"),
        ("command aborted", "Reflex", "the arm stopped itself (command aborted)"),
        ("communication_constraints_violation", None, "use a realtime kernel"),
        ("odd", None, "RuntimeError: odd"),
    ],
)
def test_an_error_of_the_library_is_reported_with_its_remedy(
    error: str, mode: str | None, said: str
) -> None:
    assert said in faults.of_error(RuntimeError(error), mode)
    assert faults.is_network(RuntimeError(error)) == ("connection" in said)


def test_a_mode_in_which_the_arm_cannot_move_is_reported_with_its_remedy() -> None:
    assert [faults.of_mode(state(0.0, mode=mode)) for mode in ("Idle", "Move")] == [None, None]
    for mode, said in (("UserStopped", "release the user stop"), ("Guiding", "take the hands off")):
        assert said in str(faults.of_mode(state(0.0, mode=mode)))
    assert "Other" not in str(faults.of_mode(state(0.0, mode="Other")))
    assert "look at Desk" in str(faults.of_mode(state(0.0, mode="New")))


class Arm:
    """Stands for franky's robot, whose control loop answers or not."""

    is_in_control = True

    def __init__(self) -> None:
        self.motions: list[Any] = []
        self.state, self.ends = state(0.0), OSError("cartesian_reflex")

    def move(self, motion: Any, asynchronous: bool) -> None:
        self.motions.append(motion)

    def join_motion(self, _: float) -> None:
        raise self.ends


class Answering:
    """An arm that answers with one robot time after the other: in its control loop or without."""

    def __init__(self, times: Iterable[float], drive: Any = None) -> None:
        self.times, self.drive = iter(times), drive

    @property
    def state(self) -> Any:
        return state(next(self.times))

    @property
    def is_in_control(self) -> bool:
        self.drive.last = next(self.times)
        return True


class Listened:
    """A link to an arm that stands still, with all that it listens to."""

    def __init__(self, realtime: bool = True) -> None:
        self.arm = Arm()
        address = SimpleNamespace(realtime=realtime)
        self.session: Any = SimpleNamespace(robot=self.arm, address=address)
        fingers = SimpleNamespace(width=0.08)
        self.hand: Any = SimpleNamespace(fingers=fingers, speed=0.05, lost=None, problem=None)
        self.drive = Drive(self.arm, ARM.stiffness, BASE)
        self.link = StateListener(
            self.session, readout(state(0.0)), self.drive, self.hand, BASE.rotation
        )


def test_a_silent_control_box_is_lost_and_time_goes_on() -> None:
    one = Listened()
    for _ in range(20):
        one.link.advance(0.02)
    assert "has said nothing for 0.1 s" in str(one.link.fault)
    assert one.link.lost
    assert one.link.t >= 0.4, "robot time follows the clock on the wall"
    one.link.fail("another reason")
    assert "said nothing" in str(one.link.fault), "the first one is kept"
    one.link.taken_up()
    assert (one.link.fault, one.link.reflex, one.drive.begun) == (None, None, False)


def test_a_control_box_that_was_recovered_may_take_its_time_to_answer_again() -> None:
    one = Listened()
    one.link.advance(0.2)
    assert one.link.lost
    one.session.robot = Answering(chain([0.0, 0.0], count(1.0, 0.001)))
    one.link.taken_up()
    one.link.advance(0.02)
    assert (one.link.fault, one.link.lost) == (None, False)


def test_time_of_an_arm_that_has_stopped_follows_the_clock_on_the_wall() -> None:
    """At once, also where silence is allowed: nothing is listened to any more."""
    one = Listened(realtime=False)
    one.link.fail("it met something")
    started = time.perf_counter()
    one.link.advance(0.1)
    assert 0.1 <= one.link.t < time.perf_counter() - started + 0.02


def test_a_computer_without_a_realtime_kernel_may_stall() -> None:
    one = Listened(realtime=False)
    started = time.perf_counter()
    one.drive.begun = True
    threading.Timer(0.3, lambda: setattr(one.drive, "last", 0.02)).start()
    one.link.advance(0.02)
    assert (one.link.fault, time.perf_counter() - started > 0.25) == (None, True)


def test_the_first_sample_of_a_control_loop_is_waited_for() -> None:
    """It takes some cycles, which may begin just as the time has passed."""
    one = Listened()
    one.drive.begun = True
    cycles = [CycleRow(state(t), np.zeros(7)) for t in 1.0 + 0.001 * np.arange(6)]
    one.session.robot, taken = Answering([1.0, 1.02], one.drive), iter([[], cycles])
    one.drive.take = lambda: next(taken)
    one.link.advance(0.02)
    assert len(one.link.drain()) == 1


def test_a_reflex_is_reported_with_its_force_in_the_worlds_axes() -> None:
    one = Listened()
    one.drive.last = 1.0
    thresholds = ARM.limits.reflexes.free
    down = [*(BASE.rotation.T @ [0.0, 0.0, -60.0]), 0.0, 0.0, 0.0]
    one.drive.reacted = Reacted(state(1.0, O_F_ext_hat_K=down), thresholds)
    one.link.advance(0.02)
    assert str(one.link.reflex).startswith("unexpected contact: the arm stopped itself at 60.0 N")
    assert one.link.fault is None, "a reflex is no fault"


def test_a_width_changes_no_faster_than_the_fingers_move() -> None:
    one = Listened()
    one.hand.fingers.width, one.drive.last = 0.0, 1.0
    one.link.advance(0.02)
    assert one.link.width == pytest.approx(0.08 - 2 * 0.05 * 0.02)
    one.hand.problem = "the hand did not open"
    one.drive.last = 2.0
    one.link.advance(0.02)
    assert one.link.fault == "the hand did not open"


def test_a_control_loop_that_ended_is_a_fault_with_its_reason() -> None:
    one = Listened()
    one.drive.begun, one.arm.is_in_control = True, False
    one.drive.take = lambda: [CycleRow(state(0.01, mode="Move"), np.zeros(7))]
    one.arm.state = state(0.5, mode="Reflex")
    one.link.advance(0.02)
    assert "the arm stopped itself (cartesian_reflex)" in str(one.link.fault)
    assert (one.link.mode, one.link.lost, one.drive.begun) == ("Reflex", False, False)
    gone = Listened()
    gone.drive.begun, gone.arm.is_in_control = True, False
    gone.arm.ends = OSError("UDP timeout")
    gone.link.advance(0.02)
    assert gone.link.lost


def test_a_guided_arm_that_no_loop_controls_is_not_ready() -> None:
    one = Listened()
    one.arm.state = state(0.05, mode="Guiding")
    one.link.advance(0.02)
    assert "guided by hand" in str(one.link.fault)


def checks(**more: Any) -> dict[str, doctor.CheckResult]:
    """The doctor's lines about an arm in a state."""
    flange = affine(Pose.of((0.0, 0.0, 0.1034)))
    errors = SimpleNamespace(cartesian_reflex=more.pop("reflex", False))
    usual = {"m_ee": 0.73, "F_x_Cee": np.zeros(3), "F_T_EE": flange, "current_errors": errors}
    now = state(0.0, **{"tau_J": np.ones(7), "mode": "Idle"} | usual | more)
    model = SimpleNamespace(gravity=lambda *_: np.ones(7))
    session: Any = SimpleNamespace(state=lambda: now, model=model)
    return {line.what: line for line in doctor.check_arm(session, ARM, BASE)}


@pytest.mark.parametrize(
    ("change", "what", "said"),
    [
        ({"mode": "Guiding"}, "mode", "take the hands off"),
        ({"reflex": True}, "errors", "cartesian_reflex: see what it met"),
        ({"q": ARM.limits.q_max - 0.08}, "joint margins", "5° from its end stop"),
        ({"m_ee": 0.0}, "end effector", "set the Franka Hand as end effector"),
        ({"tau_J": 1.0 + 0.7 * np.eye(7)[5]}, "gravity residual", "joint 6 feels +0.70 N m"),
        ({"tau_J": 1.0 - 1.6 * np.eye(7)[1]}, "gravity residual", "joint 2 feels -1.60 N m"),
    ],
)
def test_the_doctor_names_what_is_not_well(change: dict[str, Any], what: str, said: str) -> None:
    well = checks()
    assert all(line.good for line in well.values()), well
    found = checks(**change)
    assert [name for name, line in found.items() if not line.good] == [what]
    assert said in found[what].detail


@pytest.mark.parametrize(
    ("hand", "bad"),
    [
        ({}, []),
        ({"max_width": 0.0}, ["hand"]),
        ({"is_grasped": True}, ["fingers"]),
    ],
)
def test_the_doctor_looks_at_the_hand(hand: dict[str, Any], bad: list[str]) -> None:
    now = SimpleNamespace(**{"max_width": 0.08, "width": 0.04, "is_grasped": False} | hand)
    session: Any = SimpleNamespace(gripper=SimpleNamespace(state=now))
    assert [line.what for line in doctor.check_hand(session) if not line.good] == bad


def test_the_control_boxs_own_thresholds_are_the_outermost() -> None:
    """They cannot be changed while it is controlled."""
    told: list[Any] = []
    session: Any = SimpleNamespace(
        robot=SimpleNamespace(set_collision_behavior=lambda *of: told.extend(of))
    )
    FrankySession.set_thresholds(session, Reflex(40.0, 20.0, load=30.0), np.full(7, 80.0))
    torques, upper_torques, wrench, upper_wrench = told
    assert torques == upper_torques == pytest.approx([72.0] * 7)
    assert wrench == upper_wrench == [70.0] * 3 + [20.0] * 3
