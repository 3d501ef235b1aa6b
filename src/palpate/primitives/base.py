"""The base of every primitive.

A primitive is one frozen pydantic class, and has no second declaration:

- Its docstring and field descriptions are the prompt. The lean prompt has only the docstring's first
  paragraph: the action without its purpose.
- Its fields are the JSON schema and the BT.CPP ports.
- `groundings` are the arguments that a planner tries.
- `requires` and `effects` are its symbolic meaning. The planner chains them, the check folds them, and
  the run applies them.
- `run` is its behaviour on a robot.
- `unsafe` is the safety predicate, evaluated every tick while it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field, replace
from inspect import cleandoc
from typing import ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.estimation.quantities.quantity import Quantity
from palpate.primitives.load import NOTHING, FingerLoad
from palpate.primitives.rules import motion
from palpate.primitives.state import SymbolicState, Violation
from palpate.robots.pace import (
    force_of_torque_errors,
    mistaken_force,
    mistaken_moment,
    unexplained_torque,
)
from palpate.robots.robot import Robot, RobotState
from palpate.robots.safety import Expectation, violation
from palpate.robots.sheet import Links, Reflex
from palpate.scene.scene import Scene
from palpate.trace.recording import Conversion, LeafRun, Recording
from palpate.trace.samples import FORCES, POSE, Samples, Trace

# A run: yields once a tick while RUNNING, returns its message on SUCCESS, raises `LeafFailure`. It
# may yield a duration in s of robot time: the next tick may be that late, unless an event happens.
Steps = Generator[float | None, None, str]
Wait = Generator[float | None]  # Part of a run that only waits
Resource = Literal["arm", "gripper"]
ARM: frozenset[Resource] = frozenset({"arm"})
GRIPPER: frozenset[Resource] = frozenset({"gripper"})
Settled = Callable[[str, "Blackboard"], SymbolicState]
# Primitives that fill palpate's own buffers.
WRITERS = {FORCES: "MeasureForces", POSE: "MeasureGripperPose"}


# m, radius about the TCP within which the empty hand makes contact: fingertips, palm and sides.
HAND = 0.1


class LeafFailure(Exception):
    """Raised inside `run`: the leaf returns FAILURE with this reason."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Start and subject of a planner's search, for `Primitive.groundings`."""

    state: SymbolicState  # start of the search
    subject: str = ""  # object or surface to measure; empty for none
    poses: tuple[str, ...] = ()  # pose expressions to try, the nearest first


class Recorder:
    """Recorder of a running plan, into which the runner drains the robot every tick.

    Attributes:
        newest: samples of the last tick.
    """

    def __init__(self, robot: Robot) -> None:
        self.newest = Samples.empty()
        self.recordings: list[Recording] = []
        self.conversions: list[Conversion] = []
        self.leaves: list[LeafRun] = []
        self.hand, self.gravity = robot.hand, robot.gravity
        self._robot = robot
        self._parts: list[Samples] = []

    def drain(self) -> Samples:
        """Move the samples that the robot logged since the last call into the record."""
        samples = self.newest = self._robot.drain()
        if len(samples):
            self._parts.append(samples)
        return samples

    def snapshot(self) -> Trace:
        """The trace so far."""
        # Join the parts once, so that the next snapshot is cheap.
        self._parts = [Samples.concatenate(self._parts)]
        return Trace(
            self._parts[0],
            tuple(self.leaves),
            tuple(self.recordings),
            tuple(self.conversions),
            self.hand,
            self.gravity,
        )


def keep_state(_: str, blackboard: Blackboard) -> SymbolicState:
    """Return the state unchanged: no pose after the motion is observed."""
    return blackboard.state


@dataclass
class Blackboard:
    """Blackboard of a running primitive.

    Attributes:
        robot: the robot.
        state: the symbolic state.
        recorder: the recorder.
        motions: number of running motion leaves.
        owner: leaf that claims each resource; another leaf with the same claim fails.
        load: measured load on the fingers.
        pressed: (3,) N on the hand, world axes, at the start of the running motion from a contact;
            zeros from free air.
        mistaken: N, largest force on the hand that errors of the joint torques can imitate at either
            end of the running motion; limited by the carrying reflex.
        unrepeated: N m, change of the moment about the closing direction by joint friction, when the
            empty hand turns in place and back.
        failed: a leaf has failed, and no other may move.
        bound: place and source, as text, of every pose bound in this run and not reported yet.
        choice: names of the conversions' estimators by quantity; others are the defaults.
        waits: s until the next tick that each ticked leaf needs.
        settled: hook that returns the state after the motion of the leaf at a path, corrected by the
            real final poses. It fails the leaf if they differ too much.
    """

    robot: Robot
    state: SymbolicState
    recorder: Recorder
    motions: int = 0
    owner: dict[Resource, object] = field(default_factory=dict[Resource, object])
    load: FingerLoad = NOTHING
    pressed: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mistaken: float = 0.0
    unrepeated: float = 0.0
    failed: bool = False
    bound: dict[str, str] = field(default_factory=dict[str, str])
    choice: Mapping[str, str] = field(default_factory=dict[str, str])
    waits: list[float] = field(default_factory=list[float])
    settled: Settled = keep_state

    @property
    def scene(self) -> Scene:
        return self.state.scene

    def wait(self, longest: float) -> float:
        """Take the time, s, until any leaf of the last tick needs the next one, at most `longest`."""
        # The leaf that needs the next tick first decides.
        waits, self.waits = self.waits, []
        return min(*waits, longest) if waits else 0.0

    @property
    def links(self) -> Links:
        """Limits of the joint torques that reveal a contact with a link of the arm.

        A force on the hand or the held object acts within the lever about the TCP that they reach. A
        torque that no such force explains comes from a link.
        """
        # The held object extends the lever by its reach.
        lever, state = HAND, self.state
        if state.holding is not None and state.pose_tcp_object is not None:
            body = state.scene.body(state.holding)
            apart = float(np.linalg.norm(state.pose_tcp_object.position))
            lever = max(lever, apart + body.reach)
        return Links(unexplained_torque(self.scene.arm), lever)

    def set_out(self) -> None:
        """Record the force of a hand in contact, before a motion that leaves the contact."""
        x, y, z = self.robot.state.contact[:3].tolist()
        self.pressed = (x, y, z) if self.state.activity == "contact" else (0.0, 0.0, 0.0)

    def clear_pressed_force(self, way: Array) -> None:
        """Clear `pressed` if the motion along `way` (3,), m, presses on, within 60° of the force."""
        pressed = np.array(self.pressed)
        # cos 60° = 0.5.
        if way @ pressed > 0.5 * np.linalg.norm(way) * np.linalg.norm(pressed):
            self.pressed = (0.0, 0.0, 0.0)

    def set_reflex(self, thresholds: Reflex, *way: Array, alone: bool = False) -> None:
        """Set the reflex thresholds of the robot, for a motion through joint angles `way` (7,), rad.

        Force and torque thresholds are at least what errors of the joint torques can imitate along the
        way. The limits of contacts with the links are set as well. The empty hand `alone` in free air meets
        no force, so that any sudden change of the torques is a contact.
        """
        arm, reflexes = self.scene.arm, self.robot.limits.reflexes
        # Largest force and moment that torque errors imitate at the start and along the way.
        places = (self.robot.state.q, *way)
        self.mistaken = min(max(mistaken_force(arm, q) for q in places), reflexes.carrying.force)
        pushing = min(max(force_of_torque_errors(arm, q) for q in places), reflexes.carrying.force)
        turning = min(max(mistaken_moment(arm, q) for q in places), reflexes.probing.torque)
        links = self.links
        if alone and not any(self.pressed):
            links = replace(links, change=links.torque)
        self.robot.set_reflex(
            replace(
                thresholds,
                force=max(thresholds.force, pushing),
                torque=max(thresholds.torque, turning),
                links=links,
                pressed=self.pressed,
            )
        )


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
    """It yields optional evidence only: the planner does not search for it."""
    measures: ClassVar[type[Quantity] | None] = None
    """Quantity of the catalogue that a conversion estimates."""
    timeout: ClassVar[float] = 30.0
    """Robot time in s after which the leaf fails."""

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterable[Primitive]:
        """Instances for a planner to try, the likeliest first.

        By default the one with default arguments. A primitive with a required argument must
        override this, or only plans with written arguments use it.
        """
        # A primitive with defaults for all arguments has one obvious instance.
        needs_arguments = any(field.is_required() for field in cls.model_fields.values())
        return () if needs_arguments else (cls(),)

    def transferred(self, old: str, new: str) -> Primitive:
        """Return the instance for body `new` that corresponds to this one for `old`, tried before a full search."""
        return self

    def violations(self, state: SymbolicState) -> list[Violation]:
        """All violations of running it in `state`: by its preconditions and by its motion."""
        # An empty buffer comes first: other requirements depend on its content.
        if self.reads and self.reads not in state.buffers:
            return [self.unwritten()]
        found = state.unmet(self)
        # A primitive that does not move the arm still needs a known pose for the fingers.
        if "arm" not in self.claims:
            unknown = self.claims and state.pose_world_tcp is None
            return [*found, motion.unknown_start()] if unknown else found
        if any(violation.rule == "unreachable" for violation in found):
            return found
        # The motion is judged only for a reachable and known goal.
        try:
            after = state.after(self)
        except InputError:
            return found
        return [*found, *motion.violations(state, after, may_tilt=self.tilts)]

    def requires(self, state: SymbolicState) -> list[Violation]:
        """Return violations of its preconditions, with remedies. Rules of several primitives: `primitives.rules`."""
        return []

    @classmethod
    def writer(cls) -> str | None:
        """Primitive that fills the buffer which it reads; None for a third party's buffer."""
        return WRITERS.get(cls.reads or "")

    @classmethod
    def unwritten(cls) -> Violation:
        """Violation: the buffer that it reads is empty."""
        writer = cls.writer() or "its sensing"
        return Violation(
            "buffer-unwritten", f"`{cls.reads}` is empty; {writer} must come before {cls.__name__}"
        )

    def bind(self, blackboard: Blackboard) -> None:
        """Bind arguments that are known only in a run; called first, before any motion."""

    def during(self, state: SymbolicState) -> SymbolicState:
        """Symbolic state while this runs: the context of a sensing leaf in the same Parallel."""
        return state

    def effects(self, state: SymbolicState) -> SymbolicState:
        """Symbolic state after SUCCESS, folded from the state before `during`."""
        return state

    def observed(self, after: SymbolicState, robot: RobotState) -> SymbolicState:
        """State after SUCCESS at run time, corrected by the robot's measured state."""
        return after

    def expectation(self, state: SymbolicState) -> Expectation:
        """Return the expected forces while this runs; any others violate the safety predicate."""
        held = state.holding is not None
        works = state.activity in ("working", "limit")
        touching = works or state.activity in ("contact", "sliding")
        # Primitives that move a handle grasp it meanwhile, and check for slip themselves.
        return Expectation(holding=held, grasped=held and not works, contact=touching)

    def unsafe(self, blackboard: Blackboard) -> str | None:
        """Safety predicate, evaluated every tick: the reason of its violation, or None."""
        # Complete the expectation with the forces measured at the start of the motion.
        expected = replace(
            self.expectation(blackboard.state),
            pressed=blackboard.pressed,
            mistaken=blackboard.mistaken,
        )
        return self.slipping(blackboard) or violation(
            blackboard.robot.state,
            blackboard.robot.limits,
            expected,
            blackboard.scene.pose_world_base,
            blackboard.robot.gravity,
            blackboard.links,
        )

    def slipping(self, blackboard: Blackboard) -> str | None:
        """Reason why the held object slips from the fingers; None while it does not."""
        grasped, state = self.expectation(blackboard.state).grasped, blackboard.robot.state
        return blackboard.load.slip(state.width) if grasped and state.gripping else None

    def contact_place(self, blackboard: Blackboard) -> str:
        """Place of a contact that stops it, as a clause; empty if it is not known."""
        return ""

    def run(self, blackboard: Blackboard) -> Steps:
        """Run, yielding once a tick; return the message of SUCCESS, or raise `LeafFailure`."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """Label for people: `MovePose(bottle_pose + z_offset)`."""
        shown = ", ".join(str(v) for v in self.model_dump().values() if v is not None)
        return f"{type(self).__name__}({shown})"

    @classmethod
    def summary(cls) -> str:
        """The docstring: action, safe use and purpose of the primitive."""
        return " ".join((cls.__doc__ or "").split())

    @classmethod
    def capability(cls) -> str:
        """The docstring's first paragraph: action and safe use of the primitive."""
        return " ".join(cleandoc(cls.__doc__ or "").split("\n\n")[0].split())


class ConversionPrimitive(Primitive):
    """A primitive that converts the content of a buffer into an estimate of `measures`."""

    group: ClassVar[Literal["motion", "gripper", "sensing", "conversion"]] = "conversion"

    def subject(self, state: SymbolicState) -> str | None:
        """Object or surface of the buffer's content, by its context; None without one."""
        raise NotImplementedError
