"""The base of every primitive.

A primitive is one frozen pydantic class. Its docstring and field descriptions are the prompt
(the lean one has the docstring's first paragraph, what it does without what for); its fields the
JSON schema and the BT.CPP ports; `groundings` the arguments that a planner tries;
`requires` and `effects` its symbolic meaning, which the planner chains, the check folds and the run
applies; `run` its behaviour on a robot; `unsafe` the predicate that is evaluated every tick while
it runs. Nothing about a primitive is written anywhere else.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from dataclasses import dataclass, field
from inspect import cleandoc
from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from palpate.errors import InputError
from palpate.quantities.quantity import Quantity
from palpate.robots.robot import Robot, RobotState
from palpate.robots.safety import Expectation, violation
from palpate.scene.scene import Scene
from palpate.trace.recording import Conversion, LeafRun, Recording
from palpate.trace.samples import FORCES, POSE, Samples, Trace
from palpate.vocabulary.admissible import motion
from palpate.vocabulary.load import NOTHING, Load
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import Violation

Steps = Generator[None, None, str]
"""A run: yields once a tick while RUNNING, returns its message on SUCCESS, raises `LeafFailure`."""

Resource = Literal["arm", "gripper"]

WRITERS = {FORCES: "MeasureForces", POSE: "MeasureGripperPose"}
"""Primitives that fill palpate's own buffers."""


class LeafFailure(Exception):
    """Raised inside `run`: the leaf returns FAILURE with this reason."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Subject of a planner's present work, for `Primitive.groundings`.

    Attributes:
        state: where its search begins.
        subject: object or surface that it works on; empty for none.
        poses: pose expressions that matter there, the nearest first.
    """

    state: SymbolicState
    subject: str = ""
    poses: tuple[str, ...] = ()


class Recorder:
    """Recorder of a running plan. The runner drains the robot into it every tick."""

    def __init__(self, robot: Robot) -> None:
        self.recordings: list[Recording] = []
        self.conversions: list[Conversion] = []
        self.leaves: list[LeafRun] = []
        self.hand, self.gravity = robot.hand, robot.gravity
        self._robot = robot
        self._parts: list[Samples] = []

    def drain(self) -> Samples:
        """Take over the samples that the robot logged since the last call."""
        samples = self._robot.drain()
        if len(samples):
            self._parts.append(samples)
        return samples

    def snapshot(self) -> Trace:
        """The trace so far."""
        self._parts = [Samples.concatenate(self._parts)]
        return Trace(
            self._parts[0],
            tuple(self.leaves),
            tuple(self.recordings),
            tuple(self.conversions),
            self.hand,
            self.gravity,
        )


@dataclass
class Blackboard:
    """Blackboard of a running primitive: the robot, the symbolic state, the recorder.

    `owner` maps each claimed resource to the leaf that has it; the first motion claims the arm, any
    other that asks for it fails.
    """

    robot: Robot
    state: SymbolicState
    recorder: Recorder
    motions: int = 0
    """Number of running motion leaves."""
    owner: dict[Resource, object] = field(default_factory=dict[Resource, object])
    load: Load = NOTHING
    """Load on the fingers, as measured."""
    unrepeated: float = 0.0
    """N m by which a moment about the closing direction differed, with the hand empty, from before it was
    turned where it is and back: joints rub."""
    failed: bool = False
    """A leaf has failed: nothing else may move."""
    bound: dict[str, str] = field(default_factory=dict[str, str])
    """Of every pose that the run has found out and no leaf has told of: where it is, and what that rests
    on, in words."""

    @property
    def scene(self) -> Scene:
        """Believed scene, at rest."""
        return self.state.scene


class Primitive(BaseModel):
    """Base class. Subclasses set the class variables they need and implement `run` and
    `effects`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    claims: ClassVar[frozenset[Resource]] = frozenset()
    group: ClassVar[Literal["motion", "gripper", "sensing", "conversion"]]
    reads: ClassVar[str | None] = None
    writes: ClassVar[str | None] = None
    tilts: ClassVar[bool] = False
    """It may tilt the held object."""
    extra: ClassVar[bool] = False
    """It yields optional evidence only: no path is searched for it."""
    measures: ClassVar[type[Quantity] | None] = None
    """Quantity of the catalogue that a conversion yields."""
    timeout: ClassVar[float] = 30.0
    """Robot time in s after which the leaf fails."""

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterable[Primitive]:
        """Instances whose arguments make sense here, the likeliest first; a planner tries them in
        this order.

        By default the one with default arguments. A primitive with a required argument yields its
        own; else only those use it who write arguments themselves.
        """
        needs_arguments = any(field.is_required() for field in cls.model_fields.values())
        return () if needs_arguments else (cls(),)

    def transferred(self, old: str, new: str) -> Primitive:
        """The same for the object or surface `new` as this is for `old`: a planner's guess, which
        it tries before it searches anew."""
        return self

    def violations(self, state: SymbolicState) -> list[Violation]:
        """Everything that speaks against running it in `state`: what it requires itself, and what
        its motion would do to the things around the hand."""
        if self.reads and self.reads not in state.buffers:
            return [self.unwritten()]
        found = self.requires(state)
        if "arm" not in self.claims:
            unknown = self.claims and state.pose_world_tcp is None
            return [*found, motion.unknown_start()] if unknown else found
        if any(violation.rule == "unreachable" for violation in found):
            return found
        try:
            after = self.effects(state)
        except InputError:
            return found
        return [*found, *motion.violations(state, after, may_tilt=self.tilts)]

    def requires(self, state: SymbolicState) -> list[Violation]:
        """Violated preconditions of its own, worded so that a model or a person can repair the
        plan; empty when none. Judgements that others share are in `admissible`."""
        return []

    @classmethod
    def writer(cls) -> str | None:
        """Primitive that fills the buffer which it reads; None where that is not one of palpate's."""
        return WRITERS.get(cls.reads or "")

    @classmethod
    def unwritten(cls) -> Violation:
        """Violation: the buffer that it reads is empty."""
        writer = cls.writer() or "its sensing"
        return Violation(
            "buffer-unwritten", f"`{cls.reads}` is empty; {writer} must come before {cls.__name__}"
        )

    def bind(self, blackboard: Blackboard) -> None:
        """Find out, before anything else, what of its arguments a run alone can tell; nothing moves."""

    def during(self, state: SymbolicState) -> SymbolicState:
        """The symbolic state while this runs: what a sensing leaf beside it in a Parallel
        records."""
        return state

    def effects(self, state: SymbolicState) -> SymbolicState:
        """The symbolic state after SUCCESS, folded from the state before `during`."""
        return state

    def observed(self, after: SymbolicState, robot: RobotState) -> SymbolicState:
        """The state after SUCCESS at run time, where the robot tells more than was believed."""
        return after

    def expectation(self, state: SymbolicState) -> Expectation:
        """Expected forces while this runs; the safety predicate fails on all others."""
        return Expectation(holding=state.holding is not None)

    def unsafe(self, blackboard: Blackboard) -> str | None:
        """The safety predicate, evaluated every tick: the reason it is violated, or None."""
        expected = self.expectation(blackboard.state)
        return self.slipping(blackboard) or violation(
            blackboard.robot.state,
            blackboard.robot.limits,
            expected,
            blackboard.scene.pose_world_base,
            blackboard.robot.gravity,
        )

    def slipping(self, blackboard: Blackboard) -> str | None:
        """Reason why the held object slips from the fingers; None while it does not."""
        grasped, state = self.expectation(blackboard.state).grasped, blackboard.robot.state
        return blackboard.load.slip(state.width) if grasped and state.gripping else None

    def run(self, blackboard: Blackboard) -> Steps:
        """Behave. Yield once a tick while RUNNING."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """Label for people: `MovePose(bottle_pose + z_offset)`."""
        shown = ", ".join(str(v) for v in self.model_dump().values() if v is not None)
        return f"{type(self).__name__}({shown})"

    @classmethod
    def summary(cls) -> str:
        """The docstring: what the primitive does, how to use it safely, and what for."""
        return " ".join((cls.__doc__ or "").split())

    @classmethod
    def capability(cls) -> str:
        """The docstring's first paragraph: what the primitive does and how to use it safely, without
        what for."""
        return " ".join(cleandoc(cls.__doc__ or "").split("\n\n")[0].split())


class ConversionPrimitive(Primitive):
    """A primitive that declares a buffer to stand for `measures`, whose estimator makes a value of
    it."""

    group: ClassVar[Literal["motion", "gripper", "sensing", "conversion"]] = "conversion"

    def subject(self, state: SymbolicState) -> str | None:
        """The object or surface that the buffer's content is about, by its context; None when about
        none."""
        raise NotImplementedError
