"""The control loop of a Franka, cycle by cycle, on objects that stand for the library's."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from franka import ARM, BASE, NOMINAL, Gripper, state

from palpate.common.pose import Pose
from palpate.robots.franky import drive
from palpate.robots.franky import drive as course
from palpate.robots.franky.drive import CYCLE, Drive, joint_course, pose_course
from palpate.robots.franky.robot import FrankyRobot
from palpate.robots.sheet import Reflex
from palpate.robots.springs import SpringInertia
from palpate.robots.trajectory import MotionState, PosePath, Stretch, straight

ASKEW = Pose.of((0.0, 0.0, 0.0), (np.cos(0.3), np.sin(0.3), 0.0, 0.0))
"""How the arm hangs, for its reactions."""
FREE = ARM.limits.reflexes.free


class Measure:
    """A formula of the external force, as franky's reactions have them."""

    def __init__(self, of: Callable[[Any], Any]) -> None:
        self.of = of


def _made(name: str) -> Callable[[Measure, Any], Measure]:
    of = getattr(operator, name)

    def made(one: Measure, other: Any) -> Measure:
        return Measure(
            lambda f: of(one.of(f), other.of(f) if isinstance(other, Measure) else other)
        )

    return made


for _name in ("add", "sub", "mul", "pow", "gt", "le", "and_", "or_"):
    setattr(Measure, f"__{_name.rstrip('_')}__", _made(_name))
Measure.__rmul__ = Measure.__mul__  # type: ignore[attr-defined]


class Tracked:
    """A motion of franky's: it remembers what it is led along."""

    def __init__(self, **_: Any) -> None:
        self.references: list[Any] = []
        self.set_reference = self.references.append

    def register_callback(self, called: Any) -> None:
        self.called = called

    def add_reaction(self, reaction: Any) -> None:
        self.reaction = reaction


class Soft(Tracked):
    """A Cartesian motion: it remembers what it is made with."""

    def __init__(self, **given: Any) -> None:
        super().__init__()
        self.given, self.null_space = given, SimpleNamespace(posture_stiffness=None)
        self.told: list[Any] = []
        self.set_gains, self.set_nullspace_gains = lambda gains: None, self.told.append
        self.get_nullspace_gains = lambda: self.null_space


class Reaction(Tracked):
    def __init__(self, condition: Measure, stop: Any) -> None:
        super().__init__()
        self.condition = condition


@pytest.fixture
def led(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A drive along a joint motion that has just begun, its arm and its clock on the wall."""
    axes = {f"FORCE_{axis}": Measure(lambda f, i=i: f[i]) for i, axis in enumerate("XYZ")}
    module = SimpleNamespace(
        JointImpedanceTrackingMotion=Tracked,
        JointReference=lambda q, dq: q,
        Measure=SimpleNamespace(**axes),
        TorqueReaction=Reaction,
        TorqueStopMotion=lambda: None,
    )
    for one in (drive, course):
        monkeypatch.setattr(one, "franky", lambda: module)
    wall = SimpleNamespace(now=0.0)
    monkeypatch.setattr(drive.time, "perf_counter", lambda: wall.now)
    arm = SimpleNamespace(motion=None, state=cycle(0.0))
    arm.move = lambda motion, asynchronous: setattr(arm, "motion", motion)
    still = MotionState(ARM.home, np.zeros(7), np.zeros(7))
    path = straight(0.0, still, ARM.home + 0.1, [Stretch(1.0, 1.0)], 5.0)
    found = Drive(arm, ARM.stiffness, ASKEW)
    kinematics = NOMINAL.kinematics(ARM.home[None])
    inertia = SpringInertia.of(NOMINAL.mass_matrix(ARM.home), kinematics.jacobian[0])
    found.follow(lambda *_: joint_course(path, NOMINAL), inertia, FREE)

    def hear(t: float, behind: float = 0.0, took: float = CYCLE) -> None:
        """The callback after the cycle at `t`, s, with the loop `behind` s ahead of the queue."""
        wall.now += took
        arm.state = cycle(t + behind)
        arm.motion.called(cycle(t))

    return SimpleNamespace(drive=found, arm=arm, hear=hear, inertia=inertia)


def cycle(t: float) -> Any:
    return SimpleNamespace(time=SimpleNamespace(to_sec=lambda: t), O_F_ext_hat_K=np.zeros(6))


def test_each_cycle_leads_the_arm_on_by_one_row(led: Any) -> None:
    rows, given = led.drive.course.rows, led.arm.motion.references
    for k in range(1, 21):
        led.hear(k * CYCLE)
    assert led.drive.moving
    assert led.drive.clock == pytest.approx(0.02)
    assert np.array(given) == pytest.approx(rows[:21])
    assert len(led.drive.take()) == 20
    assert led.drive.take() == []
    for k in range(21, led.drive.course.last + 40):
        led.hear(k * CYCLE)
    assert not led.drive.moving
    assert given[-1] == pytest.approx(rows[-1])


def test_a_reference_never_jumps_over_cycles_that_were_missed(led: Any) -> None:
    led.hear(1 * CYCLE)
    led.hear(40 * CYCLE)
    assert led.drive.clock == pytest.approx(2 * CYCLE)
    led.hear(30 * CYCLE)
    assert led.drive.clock == pytest.approx(2 * CYCLE), "nor goes it back"


def test_a_reference_waits_while_the_queue_is_behind(led: Any) -> None:
    led.hear(1 * CYCLE)
    led.hear(2 * CYCLE, behind=0.05, took=0.05)
    for k in range(3, 10):
        led.hear(k * CYCLE, behind=0.05)
    assert led.drive.clock == pytest.approx(CYCLE)
    assert len(led.drive.take()) == 9, "what was sensed meanwhile is kept"
    led.hear(10 * CYCLE)
    assert led.drive.clock == pytest.approx(2 * CYCLE)


def test_a_reflex_ends_the_course(led: Any) -> None:
    led.hear(1 * CYCLE)
    led.arm.motion.reaction.called("its state")
    assert (led.drive.course, led.drive.moving) == (None, False)
    assert (led.drive.reacted.state, led.drive.reacted.thresholds) == ("its state", FREE)
    given = len(led.arm.motion.references)
    led.hear(2 * CYCLE)
    assert len(led.arm.motion.references) == given


def test_other_thresholds_begin_where_the_course_is(led: Any) -> None:
    led.hear(1 * CYCLE)
    first = led.arm.motion
    led.drive.guard(led.inertia, ARM.limits.reflexes.probing)
    assert led.arm.motion is not first
    assert led.arm.motion.references[0] == pytest.approx(first.references[-1])
    led.drive.note_end()
    before = led.arm.motion
    led.drive.guard(led.inertia, FREE)
    assert led.arm.motion is before, "nothing is commanded where no loop runs"


def test_the_spring_of_a_new_posture_fades_in(led: Any) -> None:
    """And no torque changes by as much in a cycle as libfranka refuses, 1 N m."""
    module = drive.franky()
    module.CartesianImpedanceTrackingMotion = Soft
    module.CartesianImpedanceGains = SimpleNamespace(diagonal=lambda *_: None)
    module.CartesianReference = module.Affine = module.Twist = lambda *_: None
    module.PostureTask = lambda q, stiffness, damping: stiffness
    begin = NOMINAL.poses(ARM.home[None])[0]
    still = MotionState(np.array([*begin[:3], 0.0, 0.0, 0.0]), np.zeros(6), np.zeros(6))
    path = straight(0.0, still, still.p + 0.05 * np.eye(6)[2], [Stretch(1.0, 1.0)], 5.0)
    way = pose_course(PosePath(path, begin[3:]), ARM.home, ASKEW)
    for cycles in range(1, 4):
        led.hear(cycles * CYCLE)
    led.drive.follow(lambda *_: way, led.inertia, FREE)
    first = led.arm.motion
    assert (led.drive.clock, first.told) == (0.0, [first.null_space])
    assert first.given["posture_task"] == pytest.approx(1e-3 * first.null_space.posture_stiffness)
    assert first.given["translational_error_clip"] == pytest.approx(np.full(3, 0.1))
    assert first.given["max_delta_tau"] < 1.0
    led.drive.guard(led.inertia, replace(FREE, load=30.0))
    assert led.arm.motion.given["posture_task"] == pytest.approx(first.null_space.posture_stiffness)


@pytest.mark.parametrize(
    "reflex",
    [
        FREE,
        replace(FREE, load=30.0),
        replace(FREE, pressed=(2.0, -3.0, -11.0)),
        Reflex(25.0, 10.0, load=15.0, sideways=9.0),
    ],
)
def test_the_loop_s_reaction_is_the_reflex_s(led: Any, reflex: Reflex) -> None:
    """At 1 kHz in franky, of force alone; the same thresholds as everywhere else."""
    led.drive.guard(led.inertia, reflex)
    fires = led.arm.motion.reaction.condition.of
    random, fired = np.random.default_rng(0), 0
    weight = np.array([0.0, 0.0, 0.7 * reflex.load])
    for force in weight + random.normal(0.0, 0.8 * reflex.force, (300, 3)):
        expected = reflex.fired(np.array([*force, 0.0, 0.0, 0.0])) is not None
        assert bool(fires(ASKEW.rotation.T @ force)) == expected, force
        fired += expected
    assert 20 < fired < 285


def test_the_first_motion_to_the_ready_pose_alone_is_slow(led: Any) -> None:
    """Where the arm stands, and what is around it, is unknown before."""
    start = ARM.home + 0.3 * np.eye(7)[0]
    session: Any = SimpleNamespace(
        robot=led.arm,
        gripper=Gripper(),
        model=SimpleNamespace(gravity=lambda *_: np.zeros(7)),
        address=SimpleNamespace(realtime=True),
        state=lambda: state(0.0, start),
        set_thresholds=lambda *_: None,
        recover=lambda: None,
        close=lambda lost: None,
    )
    robot, clock = FrankyRobot(session, ARM, BASE, 9.81), count(1)

    def took(goal: Any) -> int:
        """Cycles until the reference rests."""
        robot.move_joints(goal)
        given, before = led.arm.motion.references, 0
        while len(given) > before:
            before = len(given)
            led.hear(next(clock) * CYCLE)
        return len(given)

    slow, usual = took(ARM.home), took(start)
    robot.recover()
    again = took(ARM.home)
    robot.close()
    assert slow > 2 * usual
    assert again > 2 * usual, "after a stop, too"
