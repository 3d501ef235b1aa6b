"""Contract of a planner: turns a request, a scene and pictures into a plan.

A planner of another package is one class with the members of `Planner`, public in a module that an
entry point of the group `palpate.planners` names. Its `name` is the word after `--planner`. It is made
without arguments; one that takes an argument (`--planner mine:FILE`) or settings is offered as a
`PlannerKind` instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

from palpate.errors import InputError
from palpate.parameter import Parameter
from palpate.planning.plan import Plan
from palpate.quantities.within import Within

if TYPE_CHECKING:
    from palpate.planning.check.case import Finding
    from palpate.planning.model.conversation import Conversation
    from palpate.planning.model.settings import ModelSettings
    from palpate.scene.pictured.detected import DetectedScene, SceneBuilder
    from palpate.scene.scene import Scene

Rehearse = Callable[[Plan, "Scene"], "Finding | None"]
MAX_REQUEST = 4_000
"""Characters: a request is a sentence or a paragraph, not a document."""


class Planner(Protocol):
    """Turns a request, an incomplete scene and pictures into a plan: the paper's f(R, D, I)."""

    @property
    def name(self) -> str:
        """Name on the command line; kept in `Plan.planner`."""
        ...

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """A plan for the request and the missing parameters of the scene; its tree is None when none of
        them can be measured.

        Without a scene, a planner must be able to see the images.

        Raises:
            InputError: the request is not usable.
            PlanRejected: there is no plan; the message explains.
            Unavailable: a provider is out of reach.
        """
        ...


@runtime_checkable
class Observant(Protocol):
    """Planner that also keeps its dialogue and the detected scene.

    Attributes:
        looks: it takes a picture of the workspace even where there is a scene.
        conversation: the latest dialogue with a model, also when `plan` raised.
        seen: the scene detected in the pictures, where there was no scene.
    """

    looks: ClassVar[bool]
    conversation: Conversation | None
    seen: DetectedScene | None


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """Settings for the construction of a planner.

    Attributes:
        remeasure: the request is measured even where the scene states it.
        model_settings: settings of a model; None for the defaults.
        builder: makes a scene of detected objects, where there is none.
        within: requested widths of intervals.
        measure: the parameters that the plan must measure, no more and no fewer; None: the planner
            decides by the request.
        rehearse: executes a plan in physics and returns what it finds, None for a harmless plan; for a
            planner that corrects its plans.
    """

    remeasure: bool = False
    model_settings: ModelSettings | None = None
    builder: SceneBuilder | None = None
    within: Within = field(default_factory=Within)
    measure: tuple[Parameter, ...] | None = None
    rehearse: Rehearse | None = None


@dataclass(frozen=True, slots=True)
class PlannerKind:
    """Factory of a planner for the command line's `name` or `name:argument`.

    Attributes:
        name: the word before the colon.
        make: factory from the argument (empty where none is given) and the settings.
        argument: placeholder of the argument after the colon: `FILE`; empty without one.
        optional: the argument may be left out.
    """

    name: str
    make: Callable[[str, PlannerSettings], Planner]
    argument: str = ""
    optional: bool = False

    @property
    def form(self) -> str:
        """Form on the command line: `symbolic`, `replay:FILE`."""
        return f"{self.name}:{self.argument}" if self.argument else self.name

    def accepts(self, spec: str) -> bool:
        """True if `spec` is written in that form."""
        name, _, argument = spec.partition(":")
        if not self.argument:
            return spec == self.name
        return name == self.name and (self.optional or argument != "")


def needs_scene(planner: str) -> InputError:
    """Error for a planner without a scene that cannot see."""
    return InputError(
        f"the {planner} planner needs a scene to work on: give an MJCF with scene=D.xml, or let a "
        "model look at a picture: planner=PROVIDER:MODEL images=I.png poses=poses.yaml (with its "
        "camera)"
    )
