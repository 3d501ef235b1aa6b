"""Contract of a physical quantity: one class per quantity, from which everything else derives.

A quantity says what it is and what it is called, how it is acquired, and where it stands in the
user's MJCF: whether the file states it, what is believed of it until it is measured, and which
changes of the file state a value. A subclass declares `id`, `unit` and `subject` and overrides what
it has: a velocity has no body, a temperature no place in MJCF.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from palpate.geometry.pose import Pose
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.edits import Change, Edit, Slot
from palpate.mjcf.inertial.written import Statement
from palpate.mjcf.roles.elements import Elements
from palpate.parameter import Parameter
from palpate.robots.description import RobotDescription
from palpate.trace.recording import Activity, Context
from palpate.trace.samples import Trace

Status = Literal["known", "missing", "assumed", "not applicable"]
"""In the user's file: stated, left out or written `?`, inferred by MuJoCo, or without a place."""

Values = Mapping[Parameter, tuple[float, ...]]


Logged = tuple[str, Context]
"""A recording's buffer and the context in which it was made."""

Piece = tuple[int, str]
"""Index of a kind of evidence, and the key of one recording of it."""


GRIPPER = "gripper"
"""Subject of recordings with an empty gripper."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Kind of recording from which a quantity is estimated.

    Attributes:
        buffer: what is logged.
        how: how that is done, in words for prompts and explanations.
        activity: what goes on meanwhile; anything when empty.
        empty: whether it is made with an empty hand where it would hold the object.
        holding: whether it is about the object held; otherwise it is about the surface touched, or
            about what moves, held object or gripper.
        distinct: what of the context tells several such recordings apart, the grasp or the place;
            None when they are all alike.
        count: how many different ones it takes.
        better: how many different ones are worth having where they come easily.
        place: X, of evidence that is recorded at `<object>_X`; anywhere when empty.
        as_grasped: of what is held, it is recorded where that was grasped, or right above.
        optional: it is recorded where the scene has room for it, and told without it.
    """

    buffer: str
    how: str
    activity: tuple[Activity, ...] = ()
    holding: bool = False
    distinct: Literal["grasp", "place"] | None = None
    count: int = 1
    better: int = 1
    empty: bool = False
    place: str = ""
    as_grasped: bool = False
    optional: bool = False

    def about(self, context: Context) -> str | None:
        """The object or surface that a recording made in `context` is evidence of; None when it is
        none."""
        if self.activity and context.activity not in self.activity:
            return None
        if self.empty:
            return context.place_of if context.holding is None else None
        if self.as_grasped and context.is_elsewhere:
            return None
        if self.holding:
            subject = context.holding
        elif context.activity == "contact":
            subject = context.support
        else:
            subject = context.holding or GRIPPER
        return subject if self._is_there(context, subject) else None

    def _is_there(self, context: Context, subject: str | None) -> bool:
        """The recording about `subject` is made at the required place."""
        at = context.grasp if self.holding else context.at
        return not self.place or (at or "").split(" ")[0] == f"{subject}_{self.place}"

    def key(self, context: Context) -> str | None:
        """Grasp or place that distinguishes a recording from others of its kind; empty where they
        are all alike, None if unknown."""
        if self.distinct is None:
            return ""
        return context.grasp if self.distinct == "grasp" else context.at


@dataclass(frozen=True, slots=True)
class Prior:
    """Prior of a quantity: independent normal components.

    Attributes:
        mean: one number a component, in the quantity's unit.
        std: 1 sigma of each; 0 for a number that the file states.
    """

    mean: tuple[float, ...]
    std: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Effort:
    """Attributes:
    cycles: how often the object is taken, lifted and put back.
    speed: m/s of the ways between grasp and lift, loaded and empty; None is as fast as is safe.
    times: how often all of it is measured, one time after the other.
    """

    cycles: int = 1
    speed: float | None = None
    times: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """Workplace of an object: arm, grasp and lift poses.

    Attributes:
        parameter: what the work is for.
        arm: that works.
        pose_world_base: where it stands.
        grasp, above: poses of the TCP in the world, where the object is taken and lifted to.
        believed: what is believed of the quantity, one number a component.
        gravity: m/s², magnitude.
        near_speed: m/s, the fastest near things.
    """

    parameter: Parameter
    arm: RobotDescription
    pose_world_base: Pose
    grasp: Pose
    above: Pose
    believed: tuple[float, ...]
    gravity: float
    near_speed: float


class Quantity:
    """A physical quantity that palpate knows by name.

    Attributes:
        id: name in plans, results and on the command line.
        unit: SI unit, as printed.
        subject: what carries it, `object`, `surface` or `gripper`.
        label: words for people; the id unless declared.
        words: by language, what a request may call it, singular, lower case.
        size: number of components of its value.
        evidence: the recordings that it is read from, all of them needed.
        elsewhere: id of the quantity that its words mean of things which cannot have it.
        derived: whether those recordings are all it takes; otherwise a conversion primitive has to
            say which of them stands for it.
        how: for prompts and explanations, how it is acquired; what `evidence` says unless declared.
        stands_for: id of the quantity that it is another way to measure: a value of it is one of
            that, and stands where that does.
        identifiable: whether the vocabulary can measure it at all.
        estimators: by name, the default first; each `package.module:function`, which is imported
            when it is used, and keeps to the contract of `palpate.estimation.estimator.Estimator`.
    """

    id: ClassVar[str]
    unit: ClassVar[str]
    subject: ClassVar[Literal["object", "surface", "gripper"]]
    label: ClassVar[str]
    words: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})
    size: ClassVar[int] = 1
    evidence: ClassVar[tuple[Evidence, ...]] = ()
    elsewhere: ClassVar[str] = ""
    derived: ClassVar[bool] = False
    how: ClassVar[str]
    stands_for: ClassVar[str | None] = None
    identifiable: ClassVar[bool] = True
    estimators: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def __init_subclass__(cls) -> None:
        if "label" not in cls.__dict__ and "id" in cls.__dict__:
            cls.label = cls.id
        if "how" not in cls.__dict__:
            cls.how = ", and ".join(evidence.how for evidence in cls.evidence)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.label} of a {self.subject}, {self.unit}>"

    def known_as(self) -> str:
        """The id under which the file states it."""
        return self.stands_for or self.id

    def piece(self, parameter: Parameter, buffer: str, context: Context) -> Piece | None:
        """Piece of evidence that a recording is for `parameter`, a parameter of this quantity; None
        if it is none."""
        for i, evidence in enumerate(self.evidence):
            if buffer == evidence.buffer and evidence.about(context) == parameter.object:
                key = evidence.key(context)
                return None if key is None else (i, key)
        return None

    def pieces(self, parameter: Parameter, logged: Iterable[Logged]) -> set[Piece]:
        """The different pieces of evidence for `parameter` among recordings."""
        found = {self.piece(parameter, buffer, context) for buffer, context in logged}
        return {piece for piece in found if piece is not None}

    def is_evidenced(self, parameter: Parameter, logged: Iterable[Logged]) -> bool:
        """The recordings hold all the evidence that `parameter` needs."""
        kinds = Counter(kind for kind, _ in self.pieces(parameter, logged))
        for i, evidence in enumerate(self.evidence):
            if kinds[i] < evidence.count and not evidence.optional:
                return False
        return True

    def is_told_in_part(self, parameter: Parameter, logged: Iterable[Logged]) -> bool:
        """The recordings of an aborted run suffice for some components of `parameter`, with the
        prior for the others; by default all evidence is needed."""
        return self.is_evidenced(parameter, logged)

    def needs(self, body: Body, bodies: Mapping[str, Body]) -> Iterable[Parameter]:
        """Parameters of other `bodies` that have to be measured before this one of `body`."""
        del body, bodies
        return ()

    def shown(self, body: Body) -> tuple[float, ...] | None:
        """Value that a body's geometry implies though no file states it (a size); None if there is
        none."""
        del body
        return None

    def compiled(self, body: BodyDescription) -> tuple[float, ...] | None:
        """Value that the compiled model of `body` shows where the file states it, but no number of
        it alone does; None if there is none."""
        del body
        return None

    def acting(self, body: BodyDescription, stated: tuple[float, ...]) -> tuple[float, ...]:
        """Value that acts in the compiled world: the `stated` one, unless another body shares in it."""
        del body
        return stated

    def overruled(self, body: BodyDescription) -> str:
        """Name the statement elsewhere in the file that overrides the one of `body`; empty if there
        is none."""
        del body
        return ""

    def status(self, body: BodyDescription) -> Status:
        """Status in the file of this quantity of `body`, which is of its subject."""
        del body
        return "not applicable"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        """The value that the file states; asked only where it does."""
        raise NotImplementedError(f"{self.id} has no place in MJCF")

    def slots(self, elements: Elements) -> Iterable[Slot]:
        """Attributes in which a `?` may stand for it, with their placeholders until it is measured."""
        del elements
        return ()

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior where it is missing; `believed` holds the values of the quantities before it in the
        catalogue."""
        raise NotImplementedError(f"{self.id} has no place in MJCF")

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """A hidden truth for a simulated world, around the prior."""
        del body, random
        return prior.mean

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterable[Change | Statement]:
        """The changes of the file that state `value`; `std` decides how many digits are written.

        Raises:
            InputError: a value that has no place in this file.
        """
        del body, value, std
        return ()

    def floor(self, site: Site) -> float:
        """1 sigma of it that no repetition of the work at a site narrows, as far as that is
        foreseen."""
        del site
        return 0.0

    def effort(self, site: Site, std: float, trace: Trace | None) -> Effort | None:
        """The least work at a site after which noise leaves no more than `std` of it, as noisy as
        the arm is said to be, or was in a `trace` of the like; None where nothing is foreseen, and
        it is measured as often as the noise so far asks for."""
        del site, std, trace
        return None

    def confirm(self, body: BodyDescription, value: tuple[float, ...]) -> None:
        """Look at `body` compiled with the believed `value` in place.

        Raises:
            InputError: the value does not show; what the file leaves open is not what it seems.
        """
        del body, value

    def places(self, body: Body, value: tuple[float, ...]) -> Pose | None:
        """Pose of the frame of `body` in the world once `value` is measured; None if the value does
        not move it."""
        del body, value
        return None

    def follows(self, body: BodyDescription, believed: Values) -> Iterable[Edit]:
        """The changes of the file that follow for `body` from what is believed of all others."""
        del body, believed
        return ()
