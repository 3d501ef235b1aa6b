"""The base of every primitive, and the registry that finds them.

A primitive is one frozen pydantic class. Its docstring and field descriptions are the prompt; its
fields the JSON schema and the BT.CPP ports; `requires` and `effects` its symbolic meaning, which
the planner chains, the check folds and the run applies; `run` its behaviour on a robot; `unsafe`
the predicate that is evaluated every tick while it runs. Nothing about a primitive is written
anywhere else.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from palpate.quantities.quantity import Quantity
from palpate.robots.robot import Robot
from palpate.robots.safety import Expectation, violation
from palpate.scene.scene import Scene
from palpate.trace.recording import Conversion, LeafRun, Recording
from palpate.trace.samples import Samples, Trace
from palpate.vocabulary.state import SymbolicState

Steps = Generator[None, None, str]
"""A run: yields once a tick while RUNNING, returns its message on SUCCESS, raises `LeafFailure`."""

Resource = Literal["arm", "gripper"]


class LeafFailure(Exception):
    """Raised inside `run`: the leaf returns FAILURE with this reason."""


class Recorder:
    """What is written while a plan runs. The runner drains the robot into it every tick."""

    def __init__(self, robot: Robot) -> None:
        self.recordings: list[Recording] = []
        self.conversions: list[Conversion] = []
        self.leaves: list[LeafRun] = []
        self._robot = robot
        self._parts: list[Samples] = []

    def drain(self) -> None:
        """Take over the samples that the robot logged since the last call."""
        samples = self._robot.drain()
        if len(samples):
            self._parts.append(samples)

    def snapshot(self) -> Trace:
        """The trace so far."""
        self._parts = [Samples.concatenate(self._parts)]
        return Trace(
            self._parts[0],
            tuple(self.leaves),
            tuple(self.recordings),
            tuple(self.conversions),
            self._robot.hand,
            self._robot.gravity,
        )


@dataclass
class Blackboard:
    """What a running primitive may use: the robot, the symbolic state, the recorder.

    `owner` maps each claimed resource to the leaf that has it; the first motion claims the arm, any
    other that asks for it fails.
    """

    robot: Robot
    state: SymbolicState
    recorder: Recorder
    motions: int = 0
    """How many motion leaves are running now."""
    owner: dict[Resource, object] = field(default_factory=dict[Resource, object])

    @property
    def scene(self) -> Scene:
        """What is believed about the cell at rest."""
        return self.state.scene


class Primitive(BaseModel):
    """Base class. Subclasses set the class variables they need and implement `run` and
    `effects`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    claims: ClassVar[frozenset[Resource]] = frozenset()
    group: ClassVar[Literal["motion", "gripper", "sensing", "conversion"]]
    reads: ClassVar[str | None] = None
    writes: ClassVar[str | None] = None
    measures: ClassVar[type[Quantity] | None] = None
    """What a conversion yields: a quantity of the catalogue."""
    timeout: ClassVar[float] = 30.0
    """Robot time in s after which the leaf fails."""

    def requires(self, state: SymbolicState) -> list[str]:
        """Violated preconditions, worded so that a model or a person can repair the plan; empty
        when none."""
        return []

    def during(self, state: SymbolicState) -> SymbolicState:
        """The symbolic state while this runs: what a sensing leaf beside it in a Parallel
        records."""
        return state

    def effects(self, state: SymbolicState) -> SymbolicState:
        """The symbolic state after SUCCESS, folded from the state before `during`."""
        return state

    def expectation(self, state: SymbolicState) -> Expectation:
        """Which forces are part of the job while this runs; the safety predicate fails all
        others."""
        return Expectation(holding=state.holding is not None)

    def unsafe(self, blackboard: Blackboard) -> str | None:
        """The safety predicate, evaluated every tick: the reason it is violated, or None."""
        return violation(
            blackboard.robot.state,
            blackboard.robot.limits,
            self.expectation(blackboard.state),
            blackboard.scene.pose_world_base,
            blackboard.robot.gravity,
        )

    def run(self, blackboard: Blackboard) -> Steps:
        """Behave. Yield once a tick while RUNNING."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """As people read it: `MovePose(bottle_pose + z_offset)`."""
        shown = ", ".join(str(v) for v in self.model_dump().values() if v is not None)
        return f"{type(self).__name__}({shown})"

    @classmethod
    def summary(cls) -> str:
        """The docstring: what the primitive does and how to use it safely."""
        return " ".join((cls.__doc__ or "").split())


class ConversionPrimitive(Primitive):
    """A primitive that declares a buffer to stand for `measures`, whose estimator makes a value of
    it."""

    group: ClassVar[Literal["motion", "gripper", "sensing", "conversion"]] = "conversion"

    def subject(self, state: SymbolicState) -> str | None:
        """The object or surface that the buffer's content is about, by its context; None when about
        none."""
        raise NotImplementedError
