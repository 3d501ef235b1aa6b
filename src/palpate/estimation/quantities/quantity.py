"""Contract of a physical quantity: one class per quantity defines everything about it.

A quantity declares its names, the evidence for its estimate, and its place in the user's MJCF. The latter covers
three questions: does the file state it, which prior it has before a measurement, and which edits write a value.
A subclass declares `id`, `unit` and `subject` and overrides what applies to it. For example, a velocity has no
body, and a temperature no place in MJCF.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.estimate import UNBOUNDED
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.edits import Change, Edit, Slot
from palpate.mjcf.elements import Elements
from palpate.mjcf.inertial import Statement
from palpate.robots.description import RobotDescription
from palpate.trace.recording import Activity, Context, pose_name
from palpate.trace.samples import Trace

Status = Literal["known", "missing", "assumed", "not applicable"]
"""Status in the user's file: stated, omitted or written `?`, inferred by MuJoCo, or without a place."""
Values = Mapping[Parameter, tuple[float, ...]]
Logged = tuple[str, Context]
"""Buffer of a recording, and its context."""
Piece = tuple[int, str]
"""Index of a kind of evidence, and key of one recording of that kind."""
GRIPPER = "gripper"
"""Subject of recordings with an empty gripper."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Kind of recording from which a quantity is estimated.

    The check of plans, the symbolic search, the prompt, the conversions and the judgement of studies read it.
    """

    buffer: str  # logged buffer
    how: str  # instruction for the recording, for prompts and explanations
    activity: tuple[Activity, ...] = ()  # activities during the recording; any if empty
    # True if about the held object; else about the surface touched, or about the moving held object or gripper.
    holding: bool = False
    # Part of the context that makes recordings different, grasp or place; None if all are alike.
    distinct: Literal["grasp", "place"] | None = None
    count: int = 1  # required number of different recordings
    better: int = 1  # preferred number of different recordings where they take little effort
    # True if recorded with an empty hand at the place where it would hold the object.
    empty: bool = False
    place: str = ""  # X of evidence that is recorded at `<object>_X`; anywhere if empty
    as_grasped: bool = False  # True if recorded where the held object was grasped, or right above
    # True if recorded only where the scene has room; the estimate does not need it.
    optional: bool = False
    tool: str = ""  # kind of object that is held while another one is measured; none if empty

    def about(self, context: Context) -> str | None:
        """Return the object or surface that a recording in `context` is evidence of; None if it is no evidence."""
        # Conditions on activity, hand and place of the recording.
        if self.activity and context.activity not in self.activity:
            return None
        if self.empty:
            return context.place_of if context.holding is None else None
        if self.as_grasped and context.is_elsewhere:
            return None
        # Subject: the held object, the touched surface, or the moving hand.
        if self.holding:
            subject = context.holding
        elif context.activity == "contact":
            subject = context.support
        else:
            subject = context.holding or GRIPPER
        # The recording must be made at the stated pose of the subject, if there is one.
        at = context.grasp if self.holding else context.at
        is_there = not self.place or pose_name(at or "") == f"{subject}_{self.place}"
        return subject if is_there else None

    def key(self, context: Context) -> str | None:
        """Return the grasp or place that distinguishes a recording from others of its kind.

        It is empty if all are alike, and None if unknown.
        """
        if self.distinct is None:
            return ""
        return context.grasp if self.distinct == "grasp" else context.at


def held_and_empty(
    buffer: str, motion: str, activity: Activity, where: str, optional: bool = False
) -> tuple[Evidence, Evidence]:
    """Evidence recorded during a motion primitive with the held object, and for contrast without it."""
    held, empty = f"while it is held {where}", "at the same pose with the empty hand"
    how = f"in a Parallel with {motion}"
    kinds: tuple[Activity, ...] = (activity,)
    return (
        Evidence(buffer, f"{how} {held}", kinds, holding=True, optional=optional),
        Evidence(buffer, f"{how} {empty}", kinds, empty=True, optional=optional),
    )


@dataclass(frozen=True, slots=True)
class Prior:
    """Prior of a quantity: independent normal components."""

    mean: tuple[float, ...]  # one number per component, in the quantity's unit
    std: tuple[float, ...]  # 1 sigma of each; 0 for a number stated by the file


@dataclass(frozen=True, slots=True)
class Effort:
    """Effort for a parameter: number and speed of lifts, or number of repetitions."""

    cycles: int = 1  # number of grasps, lifts and put-downs of the object
    # M/s between grasp and lift, loaded and empty; None for the fastest safe speed.
    speed: float | None = None
    times: int = 1  # number of repetitions of the whole measurement


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """Workplace of an object: arm, grasp and lift poses."""

    parameter: Parameter  # parameter to measure
    arm: RobotDescription  # description of the arm
    pose_world_base: Pose  # pose of its base
    # grasp, above: poses of the TCP in the world, at the grasp and at the end of the lift
    grasp: Pose
    above: Pose
    believed: tuple[float, ...]  # believed value of the quantity, one number per component
    gravity: float  # m/s², magnitude
    near_speed: float  # m/s, speed limit near obstacles


class Quantity:
    """Physical quantity that palpate knows by name.

    Attributes:
        id: name in plans, results and on the command line.
        unit: SI unit, as printed.
        subject: kind of its owner: `object`, `surface`, `fixture` or `gripper`.
        label: name for people; the id unless declared.
        words: names in requests by language, singular, lower case.
        size: number of components of its value.
        bounds: least and largest physically possible value, of all components or of each. Its estimators need not
            apply them (`quantities.estimators.guarded_estimate`).
        evidence: recordings for its estimate; all are required.
        elsewhere: id of the quantity that its words denote for subjects that cannot have it.
        derived: True if those recordings suffice; else a conversion primitive has to declare one of them.
        how: instruction for its measurement, for prompts and explanations; built from `evidence` unless declared.
        stands_for: id of the quantity that it measures in another way, and replaces in the file.
        entire: True if it counts as measured only with all its components.
        identifiable: True if the vocabulary can measure it.
        estimators: references by name, the default first. Each is a `package.module:function`, imported on use, with
            the contract of `palpate.estimation.quantities.estimators.Estimator`.
    """

    id: ClassVar[str]
    unit: ClassVar[str]
    subject: ClassVar[Literal["object", "surface", "fixture", "gripper"]]
    label: ClassVar[str]
    words: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})
    size: ClassVar[int] = 1
    bounds: ClassVar[tuple[float, float] | tuple[tuple[float, float], ...]] = UNBOUNDED
    evidence: ClassVar[tuple[Evidence, ...]] = ()
    elsewhere: ClassVar[str] = ""
    derived: ClassVar[bool] = False
    how: ClassVar[str]
    stands_for: ClassVar[str | None] = None
    entire: ClassVar[bool] = False
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
        """Return the id under which the file states this quantity."""
        return self.stands_for or self.id

    # Evidence: recordings for the estimate

    def piece(self, parameter: Parameter, buffer: str, context: Context) -> Piece | None:
        """Return the piece of evidence that a recording is for `parameter`; None if it is no evidence.

        `parameter` must be one of this quantity.
        """
        for i, evidence in enumerate(self.evidence):
            if buffer == evidence.buffer and evidence.about(context) == parameter.object:
                key = evidence.key(context)
                return None if key is None else (i, key)
        return None

    def pieces(self, parameter: Parameter, logged: Iterable[Logged]) -> set[Piece]:
        """Return the different pieces of evidence for `parameter` among recordings."""
        found = {self.piece(parameter, buffer, context) for buffer, context in logged}
        return {piece for piece in found if piece is not None}

    def is_evidenced(self, parameter: Parameter, logged: Iterable[Logged]) -> bool:
        """True if the recordings contain all required evidence for `parameter`."""
        kinds = Counter(kind for kind, _ in self.pieces(parameter, logged))
        pairs = enumerate(self.evidence)
        return all(kinds[i] >= evidence.count or evidence.optional for i, evidence in pairs)

    def is_told_in_part(self, parameter: Parameter, logged: Iterable[Logged]) -> bool:
        """True if the recordings of an aborted run suffice for some components of `parameter`.

        The other components keep their prior. By default all evidence is required.
        """
        return self.is_evidenced(parameter, logged)

    def needs(self, body: Body, bodies: Mapping[str, Body]) -> Iterable[Parameter]:
        """Return the parameters of other `bodies` that must be measured before this quantity of `body`."""
        return ()

    # Place in the user's MJCF: stated values, and how a value is written

    def status(self, body: BodyDescription) -> Status:
        """Status in the file of this quantity of `body`, a body of its subject."""
        return "not applicable"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        """Value stated by the file, by default the compiled one; called only where it is stated."""
        compiled = self.compiled(body)
        if compiled is None:
            raise NotImplementedError(f"{self.id} has no place in MJCF")
        return compiled

    def compiled(self, body: BodyDescription) -> tuple[float, ...] | None:
        """Value in the compiled model of `body`, including MuJoCo's defaults; None if there is none.

        By default it is the value stated by the file.
        """
        reads_file = type(self).known is not Quantity.known
        return self.known(body) if reads_file and self.status(body) == "known" else None

    def overruled(self, body: BodyDescription) -> str:
        """Name the statement elsewhere in the file that overrides that of `body`; empty if there is none."""
        return ""

    def slots(self, elements: Elements) -> Iterable[Slot]:
        """Attributes in which a `?` may represent it, with placeholders until it is measured."""
        return ()

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterable[Change | Statement]:
        """Changes of the file that state `value`; `std` determines the number of written digits.

        Raises InputError: the value has no place in this file.
        """
        return ()

    def confirm(self, body: BodyDescription, value: tuple[float, ...]) -> None:
        """Check that `body`, compiled with the believed `value`, has that value.

        Raises InputError: it has another value: the open numbers of the file have another meaning.
        """

    def places(self, body: Body, value: tuple[float, ...]) -> Pose | None:
        """Pose of the frame of `body` in the world once `value` is measured; None if the value does not move it."""
        return None

    def follows(self, body: BodyDescription, believed: Values) -> Iterable[Edit]:
        """Changes of the file for `body` that follow from the believed values of all other quantities."""
        return ()

    # Prior before a measurement

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior of a missing value; `believed` holds the values of earlier quantities in the catalogue."""
        raise NotImplementedError(f"{self.id} has no place in MJCF")

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """Draw a hidden truth around the prior for a simulated world."""
        return prior.mean

    # Predicted precision of a planned measurement

    def floor(self, site: Site) -> float:
        """1 sigma that repetition at a site does not reduce, as far as it is predictable."""
        return 0.0

    def effort(self, site: Site, std: float, trace: Trace | None) -> Effort | None:
        """Least effort at a site after which noise contributes at most `std`.

        The noise is that of the arm's description, or of a `trace` of the same measurement. Returns None without a
        prediction: the number of repetitions then follows from the noise so far.
        """
        return None
