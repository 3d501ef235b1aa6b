"""A kinematic stand-in for a robot and a few small primitives, for the lifecycle of leaves, trees
and runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from palpate.common.pose import Pose
from palpate.planning.plan import Node, Plan
from palpate.primitives.base import Blackboard, LeafFailure, Primitive, Recorder
from palpate.primitives.registry import COMPOSITES, Vocabulary
from palpate.primitives.sensing import MeasureForces, MeasureGripperPose
from palpate.primitives.state import SymbolicState, Violation
from palpate.robots.description import Limits
from palpate.robots.owner import load_description
from palpate.robots.robot import RobotState
from palpate.robots.safety import Expectation
from palpate.robots.sheet import Reflex
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Samples

LIMITS = Limits(
    q_min=np.full(7, -3.0),
    q_max=np.full(7, 3.0),
    dq_max=np.full(7, 2.0),
    tau_max=np.full(7, 80.0),
    force_max=40.0,
    torque_max=20.0,
    free_force=25.0,
    overload=14.0,
    speed_max=1.0,
    tracking_max=0.05,
    payload=3.0,
    workspace_min=np.array([-1.0, -1.0, -0.5]),
    workspace_max=np.array([1.0, 1.0, 1.2]),
    stale_after=0.1,
    reflexes=load_description().limits.reflexes,
)

STIFFNESS = 2000.0
"""N/m of the support under a held object."""


CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.5 0 0.005"><geom type="box" size="0.3 0.3 0.03"/></body>
  <body name="cup" pos="0.5 0 0.085"><freejoint/>
    <geom type="box" size="0.03 0.02 0.05" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>"""
"""A cup, 0.1 m high, on a table."""

IN_HAND = Pose.top_down((0.5, 0.0, 0.1), 0.0).inverse() @ Pose.of((0.5, 0.0, 0.085))
"""The grasped cup in the TCP's frame."""

TICK = 0.02
"""s of robot time between two ticks."""


class StandIn:
    """Not a simulation: the TCP follows straight lines exactly, and forces are what the test says.

    `support_z` is the height of the TCP at which a held object meets its support, `weight` its
    weight in N, `between` how wide what is between the fingers is, m, `calls` what was commanded,
    in order.
    """

    limits = LIMITS
    hand = NominalHand(0.009, 0.15, 0.01, 0.0001)
    gravity = 9.81

    def __init__(self) -> None:
        q = load_description().home
        pose = Pose.top_down((0.5, 0.0, 0.3), 0.0)
        self.calls: list[tuple[str, Any]] = []
        self.support_z, self.weight, self.force = -1.0, 0.0, np.zeros(6)
        self.between = 0.03
        self.on_advance: Callable[[StandIn], None] = lambda _: None
        self.goal, self.speed, self.fingers_until = pose, 0.0, 0.0
        self.gripping_after = False
        self.thresholds = LIMITS.reflexes.contact
        self.state = RobotState(
            0.0,
            0.0,
            q,
            np.zeros(7),
            np.zeros(7),
            np.zeros(7),
            pose,
            pose,
            np.zeros(6),
            np.zeros(6),
            np.zeros(6),
            0.08,
            False,
            False,
            False,
        )
        self._log: list[RobotState] = []

    def put(self, **changes: Any) -> None:
        """Change the state; it does not accelerate, so that a contact is the whole wrench."""
        if "wrench" in changes:
            changes.setdefault("contact", changes["wrench"])
        self.state = replace(self.state, **changes)

    def move_joints(self, q: Any, speed: float = 1.0) -> None:
        self.calls.append(("move_joints", q))

    def move_pose(self, target: Pose, speed: float, slower: Any = ()) -> None:
        self.calls.append(("move_pose", target))
        self.goal, self.speed = target, speed
        self.put(moving=True)

    def move_axis(self, direction: Any, speed: float, travel: float) -> None:
        self.move_pose(self.state.pose_world_tcp.translate(travel * np.asarray(direction)), speed)
        self.calls[-1] = ("move_axis", tuple(direction))

    def open_gripper(self, width: float | None = None) -> None:
        self.calls.append(("open_gripper", self.state.pose_world_tcp.position[2]))
        self.fingers_until, self.gripping_after = self.state.t + 0.2, False
        self.put(gripper_moving=True)

    def close_gripper(self, force: float | None = None) -> None:
        self.calls.append(("close_gripper", force))
        self.fingers_until, self.gripping_after = self.state.t + 0.2, True
        self.put(gripper_moving=True)

    def hold(self) -> None:
        self.calls.append(("hold", None))
        self.goal = self.state.pose_world_tcp
        self.put(moving=False)

    def set_reflex(self, thresholds: Reflex) -> None:
        self.thresholds = thresholds

    def advance(self, duration: float) -> None:
        state = self.state
        pose = self._next_pose(duration) if state.moving else state.pose_world_tcp
        arrived = state.gripper_moving and state.t + duration >= self.fingers_until
        gripping = self.gripping_after if arrived else state.gripping
        self.put(
            t=state.t + duration,
            q=state.q + 1e-9 * state.moving,  # its encoders live
            stamp=state.t + duration,
            pose_world_tcp=pose,
            target_world_tcp=pose,
            moving=state.moving and pose.distance_to(self.goal) > 1e-9,
            gripping=gripping,
            gripper_moving=state.gripper_moving and not arrived,
            width=float(
                np.clip(self.between if gripping else 0.08, state.width - 0.04, state.width + 0.04)
            ),
        )
        self.put(wrench=self.force + np.array([0, 0, self._load(), 0, 0, 0]))
        self.on_advance(self)
        self._log.append(self.state)

    def _next_pose(self, duration: float) -> Pose:
        here = self.state.pose_world_tcp
        left = self.goal.distance_to(here)
        step = min(1.0, self.speed * duration / left) if left else 1.0
        return Pose(
            here.position + step * (self.goal.position - here.position), self.goal.quaternion
        )

    def _load(self) -> float:
        if not self.state.gripping:
            return 0.0
        return self.weight - max(
            0.0, STIFFNESS * (self.support_z - self.state.pose_world_tcp.position[2])
        )

    def drain(self) -> Samples:
        rows, self._log = self._log, []
        return Samples(
            *(
                np.array([pick(r) for r in rows]).reshape(len(rows), *shape)
                for pick, shape in (
                    (lambda r: r.t, ()),
                    (lambda r: r.q, (7,)),
                    (lambda r: r.dq, (7,)),
                    (lambda r: r.tau_ext, (7,)),
                    (lambda r: r.wrench, (6,)),
                    (lambda r: r.pose_world_tcp.vector, (7,)),
                    (lambda r: r.twist, (6,)),
                    (lambda r: r.target_world_tcp.vector, (7,)),
                    (lambda r: r.width, ()),
                )
            )
        )

    def close(self) -> None:
        self.calls.append(("close", None))


def tick(root: Behaviour, robot: StandIn, times: int = 1) -> Status:
    """Let time pass and tick, at most `times` times, until the leaf or tree has ended."""
    for _ in range(times):
        robot.advance(TICK)
        root.tick_once()
        if root.status is not Status.RUNNING:
            break
    return root.status


class Wait(Primitive):
    """Stand still."""

    group: ClassVar = "sensing"
    seconds: float

    def run(self, blackboard: Blackboard):
        start = blackboard.robot.state.t
        while blackboard.robot.state.t - start < self.seconds - 1e-9:
            yield
        return "waited"


class Go(Primitive):
    """Move to a height."""

    claims: ClassVar = frozenset({"arm"})
    group: ClassVar = "motion"
    timeout: ClassVar[float] = 5.0
    z: float
    speed: float = 0.1

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="moving")

    def effects(self, state: SymbolicState) -> SymbolicState:
        return replace(
            state, at=f"z = {self.z}", activity="still", lifted=state.holding is not None
        )

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(holding=state.holding is not None, grasped=state.holding is not None)

    def run(self, blackboard: Blackboard):
        here = blackboard.robot.state.pose_world_tcp.position
        blackboard.robot.move_pose(Pose.top_down((here[0], here[1], self.z), 0.0), self.speed)
        yield
        while blackboard.robot.state.moving:
            yield
        return f"at {self.z}"


class Grasp(Primitive):
    """Close the fingers on the cup."""

    claims: ClassVar = frozenset({"gripper"})
    group: ClassVar = "gripper"

    def effects(self, state: SymbolicState) -> SymbolicState:
        return replace(
            state,
            holding="cup",
            grasp="cup_pose",
            gripper="closed",
            pose_tcp_object=IN_HAND,
        )

    def run(self, blackboard: Blackboard):
        blackboard.robot.close_gripper()
        yield
        while blackboard.robot.state.gripper_moving:
            yield
        return "grasped"


class Refuse(Primitive):
    """Fail at once."""

    group: ClassVar = "sensing"

    def run(self, blackboard: Blackboard):
        yield
        raise LeafFailure("it refuses")


class Crash(Primitive):
    """Move the arm, then raise something nobody expects."""

    claims: ClassVar = frozenset({"arm"})
    group: ClassVar = "motion"
    error: str = "ZeroDivisionError"

    def run(self, blackboard: Blackboard):
        blackboard.robot.move_axis(np.array([0, 0, 1.0]), 0.1, 0.5)
        yield
        raise {"ZeroDivisionError": ZeroDivisionError, "KeyboardInterrupt": KeyboardInterrupt}[
            self.error
        ]("boom")


class Never(Primitive):
    """Its precondition never holds."""

    claims: ClassVar = frozenset({"arm"})
    group: ClassVar = "motion"

    def requires(self, state: SymbolicState) -> list[Violation]:
        return [Violation("precondition", "the moon is not full")]

    def run(self, blackboard: Blackboard):
        blackboard.robot.move_axis(np.array([0, 0, 1.0]), 0.1, 0.5)
        yield
        return ""


@pytest.fixture
def robot() -> StandIn:
    return StandIn()


@pytest.fixture(scope="session")
def scene() -> Scene:
    """The cup on the table, which the stand-in's hand grasps at z = 0.1 m."""
    return parse_scene(CELL)


@pytest.fixture
def words() -> Vocabulary:
    known = (Wait, Go, Grasp, Refuse, Crash, Never, MeasureForces, MeasureGripperPose)
    return Vocabulary({c.__name__: c for c in known}, COMPOSITES)


@pytest.fixture
def blackboard(robot: StandIn, scene: Any) -> Blackboard:
    return Blackboard(robot, SymbolicState(scene), Recorder(robot))


@pytest.fixture
def node() -> Callable[..., Node]:
    """`node("Go", z=0.2)`, `node("Sequence", child, child)`."""
    return lambda kind, *children, **args: Node(kind, tuple(args.items()), children)


@pytest.fixture
def plan(node: Callable[..., Node]) -> Callable[..., Plan]:
    """A plan whose tree is a Sequence of the given nodes."""
    return lambda *children: Plan((), node("Sequence", *children), "a test")
