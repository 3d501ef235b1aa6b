"""Protocol of a planner, and parameters by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

from palpate.common.errors import InputError, unknown_name
from palpate.common.parameter import Parameter
from palpate.estimation.quantities.within import Within
from palpate.planning.plan import Plan
from palpate.planning.request.query import GRIPPER
from palpate.scene.describe import AN_OBJECT
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.planning.check.finding import Finding
    from palpate.planning.model.conversation import Conversation
    from palpate.planning.model.settings import ModelSettings
    from palpate.scene.picture_scene import DetectedScene, SceneBuilder


Rehearse = Callable[[Plan, "Scene"], "Finding | None"]
MAX_REQUEST = 4_000  # Maximum number of characters of a request: a sentence or a paragraph


class Planner(Protocol):
    """Maps a request, an incomplete scene and images to a plan: f(R, D, I) in the paper."""

    @property
    def name(self) -> str:
        """Name on the command line; stored in `Plan.planner`."""
        ...

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """Make a plan for the request and the missing parameters of the scene.

        The tree of the plan is None if none of them can be measured. Without a scene, a planner
        needs vision of the images.

        Raises:
            InputError: the request is not usable.
            PlanRejected: there is no plan; the message states the reason.
            Unavailable: a provider is out of reach.
        """
        ...


@runtime_checkable
class Observant(Protocol):
    """Planner that also keeps its dialogue and the detected scene."""

    looks: ClassVar[bool]  # it takes a picture of the workspace even if there is a scene
    # The latest dialogue with a model, also after an error in `plan`.
    conversation: Conversation | None
    seen: DetectedScene | None  # the scene detected in the pictures, if there was no scene


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """Settings for the construction of a planner."""

    remeasure: bool = False  # requested values are measured even where the scene states them
    model_settings: ModelSettings | None = None  # settings of a model; None for the defaults
    builder: SceneBuilder | None = None  # makes a scene of detected objects, if there is none
    within: Within = field(default_factory=Within)  # requested widths of intervals
    # The exact set of parameters that the plan must measure; None to derive it from the request.
    measure: tuple[Parameter, ...] | None = None
    # Executes a plan in physics and returns its finding, None for a harmless plan. For planners
    # that correct their plans.
    rehearse: Rehearse | None = None


@dataclass(frozen=True, slots=True)
class PlannerKind:
    """Factory of a planner for the command-line form `name` or `name:argument`."""

    name: str  # the word before the colon
    # Factory from the argument (empty by default) and the settings.
    make: Callable[[str, PlannerSettings], Planner]
    # Placeholder of the argument after the colon, e.g. `FILE`; empty without one.
    argument: str = ""
    optional: bool = False  # the argument may be left out

    @property
    def form(self) -> str:
        """Form on the command line: `symbolic`, `replay:FILE`."""
        return f"{self.name}:{self.argument}" if self.argument else self.name

    def accepts(self, spec: str) -> bool:
        """True if `spec` has this form."""
        name, _, argument = spec.partition(":")
        # Without an argument the spec is the name alone.
        if not self.argument:
            return spec == self.name
        return name == self.name and (self.optional or argument != "")


def needs_scene(planner: str) -> InputError:
    """Error for a planner without a scene and without vision."""
    return InputError(
        f"the {planner} planner needs a scene: give an MJCF with scene=D.xml, or use a model and a "
        "picture: planner=PROVIDER:MODEL images=I.png poses=poses.yaml (with its camera)"
    )


# Parameters by name: `bottle.mass`, `bottle.*`, `*.mass`, `missing`. They involve no language.


MISSING = "missing"  # Name of all missing parameters of the scene
HINT = "Give measure=bottle.mass, measure=bottle.*, measure=*.mass or measure=missing."


def named_parameters(names: Iterable[str], scene: Scene) -> tuple[Parameter, ...]:
    """Resolve names of parameters: each one a parameter, a pattern, or a comma-separated list.

    A pattern selects missing parameters: `bottle.*` for all of the bottle, `*.mass` for every mass,
    `missing` for all. It may match nothing if nothing is missing.
    Raises InputError: no such body or quantity, or a quantity that such a body does not have.
    """
    found: list[Parameter] = []
    # Each given name may be a comma-separated list.
    listed = [part.strip() for given in names for part in given.split(",")]
    if listed and not any(listed):
        raise InputError(f"measure= is empty. {HINT}")
    for name in listed:
        if name == MISSING:
            found += scene.missing
        elif "*" in name:
            found += _matching(name, scene)
        elif name:
            found.append(_parameter(name, scene))
    return tuple(dict.fromkeys(found))


def in_words(parameters: Sequence[Parameter]) -> str:
    """State the parameters as a request, for a planner that reads requests."""
    listed = ", ".join(str(parameter) for parameter in parameters) or "nothing"
    return f"Measure exactly these parameters, no more and no fewer: {listed}."


def _matching(pattern: str, scene: Scene) -> list[Parameter]:
    """Return the missing parameters that match a pattern, which must name a known body and quantity."""
    body, _, quantity = pattern.rpartition(".")
    # A pattern with an unknown body or quantity is an error, not an empty match.
    if not any(fnmatchcase(name, body) for name in scene.bodies):
        raise unknown_name("object or surface in measure=", body, scene.bodies, HINT)
    if not any(fnmatchcase(id, quantity) for id in scene.catalogue):
        raise unknown_name("quantity in measure=", quantity, scene.catalogue, HINT)
    return [one for one in scene.missing if fnmatchcase(str(one), pattern)]


def _parameter(name: str, scene: Scene) -> Parameter:
    """Return the parameter of an exact name, or raise an error with the valid names."""
    # The last point separates the quantity; body names may contain points.
    object, dot, id = name.rpartition(".")
    bodies = [*scene.bodies, GRIPPER]
    # A body without a quantity is a frequent error, so it has its own message.
    if not dot and name in bodies:
        raise InputError(f"measure={name} names no quantity. {HINT.replace('bottle', name)}")
    if object not in bodies:
        why = scene.resolved.description.explain_refusal(object or name)
        raise unknown_name("object or surface in measure=", object or name, bodies, why or HINT)
    # Suggest the quantity of a synonym.
    if id not in scene.catalogue:
        meant = scene.catalogue.meant(id)
        raise unknown_name("quantity in measure=", id, scene.catalogue, HINT, meant)
    # The body's role must fit the subject of the quantity.
    subject = scene.catalogue[id].subject
    role = GRIPPER if object == GRIPPER else scene.bodies[object].role
    # A held object also has the quantities of the gripper.
    if role != subject and not (subject == GRIPPER and role == "object"):
        raise InputError(
            f"measure={name}: '{object}' is a{'n' if role == 'object' else ''} {role}, and the "
            f"{scene.catalogue[id].label} is a quantity of a{'n' if subject == 'object' else ''} {subject}"
            f"{'; ' + AN_OBJECT if (role, subject) == ('surface', 'object') else ''}"
        )
    return Parameter(object, id)
