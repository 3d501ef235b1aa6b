"""The base of every primitive, and the registry that finds them.

A primitive is one frozen pydantic class. Its docstring and field descriptions are the prompt; its fields
the JSON schema and the BT.CPP ports; `requires` and `effects` its symbolic meaning, which the planner
chains, the check folds and the run applies; `run` its behaviour on a robot; `unsafe` the predicate that
is evaluated every tick while it runs. Nothing about a primitive is written anywhere else.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from palpate.errors import InputError, unknown_name
from palpate.estimation.estimate import Estimate
from palpate.quantities import QUANTITIES, Quantity
from palpate.robots.robot import Robot
from palpate.robots.safety import Expectation, violation
from palpate.scene.scene import Scene
from palpate.trace import Conversion, LeafRun, Recording, Samples, Trace
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
        return Trace(self._parts[0], tuple(self.leaves), tuple(self.recordings), tuple(self.conversions),
                     self._robot.hand, self._robot.gravity)


@dataclass
class Cell:
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
    """Base class. Subclasses set the class variables they need and implement `run` and `effects`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    claims: ClassVar[frozenset[Resource]] = frozenset()
    group: ClassVar[Literal["motion", "gripper", "sensing", "conversion"]]
    reads: ClassVar[str | None] = None
    writes: ClassVar[str | None] = None
    measures: ClassVar[Quantity | None] = None
    """What a conversion yields; a quantity the catalogue lacks is added to it on registration."""
    timeout: ClassVar[float] = 30.0
    """Robot time in s after which the leaf fails."""

    def requires(self, state: SymbolicState) -> list[str]:
        """Violated preconditions, worded so that a model or a person can repair the plan; empty when none."""
        return []

    def during(self, state: SymbolicState) -> SymbolicState:
        """The symbolic state while this runs: what a sensing leaf beside it in a Parallel records."""
        return state

    def effects(self, state: SymbolicState) -> SymbolicState:
        """The symbolic state after SUCCESS, folded from the state before `during`."""
        return state

    def expectation(self, state: SymbolicState) -> Expectation:
        """Which forces are part of the job while this runs; the safety predicate fails all others."""
        return Expectation(holding=state.holding is not None)

    def unsafe(self, cell: Cell) -> str | None:
        """The safety predicate, evaluated every tick: the reason it is violated, or None."""
        return violation(cell.robot.state, cell.robot.limits, self.expectation(cell.state),
                         cell.scene.pose_world_base)

    def run(self, cell: Cell) -> Steps:
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
    """A primitive that turns a buffer into an estimate of `measures`."""

    group: ClassVar[Literal["motion", "gripper", "sensing", "conversion"]] = "conversion"

    def subject(self, state: SymbolicState) -> str | None:
        """The object or surface that the buffer's content is about, by its context; None when about none."""
        raise NotImplementedError

    @classmethod
    def estimate(cls, trace: Trace, conversion: Conversion) -> Estimate:
        """The estimate, from recordings alone."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Composite:
    """A composite's one declaration: `Sequence` and `Parallel` are the two there are."""

    name: str
    symbol: str
    summary: str
    btcpp: Mapping[str, str]
    """Tag and fixed attributes in BT.CPP 4."""


class Vocabulary:
    """The primitives and composites that plans may use, by name."""

    def __init__(self, primitives: Mapping[str, type[Primitive]], composites: Mapping[str, Composite]) -> None:
        self.primitives = dict(primitives)
        self.composites = dict(composites)

    def primitive(self, name: str) -> type[Primitive]:
        """The class named `name`.

        Raises:
            InputError: unknown; the message lists the valid ones.
        """
        if name not in self.primitives:
            raise unknown_name("primitive", name, [*self.primitives, *self.composites])
        return self.primitives[name]

    def make(self, type: str, args: Mapping[str, Any]) -> Primitive:
        """An instance with validated arguments.

        Raises:
            InputError: unknown primitive. pydantic.ValidationError: arguments that do not fit.
        """
        return self.primitive(type)(**args)


@cache
def vocabulary() -> Vocabulary:
    """Everything registered through the entry-point group `palpate.primitives`, palpate's own first.

    An entry point names a module; every public concrete `Primitive` in it is registered under its class name.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """
    from palpate.vocabulary import core
    from palpate.vocabulary.composites import COMPOSITES

    found: dict[str, type[Primitive]] = _declared(core)
    for entry in sorted(entry_points(group="palpate.primitives"), key=lambda e: e.name):
        if entry.value != core.__name__:
            found = {**_declared(_loaded(entry)), **found}
    for cls in found.values():
        if cls.measures is not None:
            QUANTITIES.setdefault(cls.measures.id, cls.measures)
    return Vocabulary(dict(sorted(found.items(), key=lambda item: _order(item[0], core))), COMPOSITES)


def _loaded(entry: EntryPoint) -> ModuleType:
    try:
        return entry.load()
    except Exception as error:
        raise InputError(f"the primitives '{entry.name}' ({entry.value}) cannot be loaded: {type(error).__name__}: "
                         f"{error}; repair or uninstall the package that brings them") from error


def _declared(module: ModuleType) -> dict[str, type[Primitive]]:
    names: list[str] = getattr(module, "__all__", [name for name in vars(module) if not name.startswith("_")])
    candidates = [getattr(module, name) for name in names]
    return {c.__name__: c for c in candidates if isinstance(c, type) and issubclass(c, Primitive)
            and c not in (Primitive, ConversionPrimitive)}


def _order(name: str, core: ModuleType) -> tuple[int, str]:
    names: list[str] = core.__all__
    return (names.index(name), "") if name in names else (len(names), name)
