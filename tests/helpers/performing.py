"""A tiny blackboard: a cup and a crate on a table, as the user knows them, and the worlds that hide
behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from palpate.common.pose import Array
from palpate.execution.runner import Execution, run
from palpate.planning.plan import Node, Plan
from palpate.primitives.base import Primitive
from palpate.primitives.registry import vocabulary
from palpate.primitives.state import SymbolicState
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.trace.recording import Recording

CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 {table}"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="cup" pos="{cup}"><freejoint/>
    <geom type="box" size=".03 .02 .05" {mass} friction="0.6 0.005 0.0001"/></body>
  <body name="crate" pos="0.45 -0.3 0.06"><freejoint/>
    <geom type="box" size=".1 .1 .06" mass="0.5" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>"""
CUP = (0.5, 0.1, 0.05)
"""m: where the scene has the cup's middle; the table's top is at z = 0."""
MASS = 0.3
"""kg: the cup's, which only the worlds have."""


def cell(cup: tuple[float, float, float] = CUP, table: float = -0.03, mass: str = "") -> Scene:
    return parse_scene(CELL.format(cup=" ".join(map(str, cup)), table=table, mass=mass))


@dataclass(frozen=True)
class Done:
    """A run and the world in which it was."""

    execution: Execution
    robot: MujocoRobot

    def message(self, primitive: str) -> str:
        """What the last leaf of that kind said."""
        return next(
            leaf.message
            for leaf in reversed(self.execution.trace.leaves)
            if leaf.primitive == primitive
        )

    def true_velocity(self, recording: Recording) -> Array:
        """Mean velocity of the true TCP over a recording, from the camera's frames at its ends,
        m/s."""
        first, last = (self._frame(t) for t in (recording.start, recording.end))
        return (self._tcp(last[1]) - self._tcp(first[1])) / (recording.end - recording.start)

    def _frame(self, t: float) -> tuple[float, Array]:
        return min(self.robot.world.frames, key=lambda frame: abs(frame[0] - t))

    def _tcp(self, qpos: Array) -> Array:
        return self.robot.world.data(qpos).site("robot/tcp").xpos.copy()


@pytest.fixture(scope="session")
def scene() -> Scene:
    """What the user knows."""
    return cell()


@pytest.fixture
def start(scene: Scene) -> SymbolicState:
    """Nothing done yet."""
    return SymbolicState(scene)


@pytest.fixture(scope="session")
def make() -> Callable[..., Primitive]:
    """`make("MovePose", pose="cup_pose")`."""
    return lambda kind, **arguments: vocabulary().make(kind, arguments)


@pytest.fixture(scope="session")
def after(make: Callable[..., Primitive]) -> Callable[..., SymbolicState]:
    """The state after `("MovePose", "cup_pose")` and the like, each of whose preconditions must
    hold."""

    def fold(state: SymbolicState, *steps: tuple[str, str] | str) -> SymbolicState:
        for primitive in (make(*_split(step)[:1], **_split(step)[1]) for step in steps):
            assert primitive.requires(state) == []
            state = primitive.effects(state)
        return state

    return fold


@pytest.fixture(scope="session")
def perform(scene: Scene) -> Callable[..., Done]:
    """Run steps on the embedded robot with perfect sensors, in a world that differs from the scene
    as told."""

    believed = scene

    def go(*steps: object, world: Scene | None = None, scene: Scene = believed) -> Done:
        world = world or cell(mass=f'mass="{MASS}"')
        robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm)
        return Done(run(Plan((), sequence(*steps), "a test"), scene, robot), robot)

    return go


def sequence(*steps: object) -> Node:
    return Node("Sequence", children=tuple(_node(step) for step in steps))


def _node(step: object) -> Node:
    """A list is a Parallel."""
    if isinstance(step, list):
        return Node("Parallel", children=tuple(_node(child) for child in step))
    kind, arguments = _split(step)  # type: ignore[arg-type]
    return Node(kind, tuple(arguments.items()))


def _split(step: tuple[str, Any] | str) -> tuple[str, dict[str, Any]]:
    kind, *value = (step,) if isinstance(step, str) else step
    if value and isinstance(value[0], dict):
        return kind, value[0]
    field = {"MovePose": "pose", "MoveJoints": "joints", "MoveUntilContact": "axis"}.get(kind)
    return kind, {field: value[0]} if field else {}


@pytest.fixture(scope="session")
def reached() -> tuple[object, ...]:
    """The way to the cup, with open fingers."""
    return "OpenGripper", ("MovePose", "cup_pose + z_offset"), ("MovePose", "cup_pose")
