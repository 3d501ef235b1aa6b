"""What a planner is, and how the command line's words become one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from palpate.errors import InputError, unknown_name
from palpate.planning.plan import Plan

if TYPE_CHECKING:
    from palpate.planning.session import Asking
    from palpate.scene.from_picture import Template
    from palpate.scene.scene import Scene

BUILT_IN = ("symbolic", "exhaustive", "replay:FILE")


class Planner(Protocol):
    """f(R, D, I) → plan."""

    @property
    def name(self) -> str:
        """As written on the command line; kept in `Plan.planner`."""
        ...

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """A plan for the request and what the scene misses; its tree is None when nothing of it can be measured.

        Without a scene only who can look at the images can plan.

        Raises:
            InputError: a request that cannot be used. PlanRejected: no plan; the message explains.
            Unavailable: a provider out of reach.
        """
        ...


def make_planner(spec: str, *, remeasure: bool = False, asking: Asking | None = None,
                 template: Template | None = None) -> Planner:
    """The planner that `spec` names: `symbolic`, `exhaustive`, `replay:FILE` or `PROVIDER[:MODEL]`.

    `asking` is how a model is asked; `template` makes a scene of what it saw, where there is none.

    Raises:
        InputError: unknown; the message lists the valid ones.
    """
    kind, _, rest = spec.partition(":")
    if spec == "symbolic":
        from palpate.planning.symbolic import SymbolicPlanner

        return SymbolicPlanner(remeasure)
    if spec == "exhaustive":
        from palpate.planning.exhaustive import ExhaustivePlanner

        return ExhaustivePlanner()
    if kind == "replay" and rest:
        from palpate.planning.replay import ReplayPlanner

        return ReplayPlanner(Path(rest), remeasure, template)
    from palpate.planning.provider import PROVIDERS

    if kind not in PROVIDERS:
        raise unknown_name("planner", spec, [*BUILT_IN, *(f"{name}:MODEL" for name in PROVIDERS)])
    from palpate.planning.session import Asking
    from palpate.planning.vlm import VlmPlanner

    return VlmPlanner(spec, asking or Asking(), remeasure, template)


def needs_scene(planner: str) -> InputError:
    """What to tell who wants a planner that cannot look to plan without D."""
    return InputError(f"the {planner} planner needs a scene to work on: give an MJCF with --scene D.xml, or let a "
                      "model look at a picture: --planner PROVIDER:MODEL --image I.png --poses poses.yaml (with its "
                      "camera)")
