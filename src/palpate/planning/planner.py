"""What a planner is, and how the command line's words become one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from palpate.errors import unknown_name
from palpate.planning.plan import Plan

if TYPE_CHECKING:
    from palpate.scene.scene import Scene

BUILT_IN = ("symbolic", "exhaustive", "replay:FILE")


class Planner(Protocol):
    """f(R, D, I) → plan."""

    @property
    def name(self) -> str:
        """As written on the command line; kept in `Plan.planner`."""
        ...

    def plan(self, request: str | None, scene: Scene, images: Sequence[Path] = ()) -> Plan:
        """A plan for the request and what the scene misses; its tree is None when nothing of it can be measured.

        Raises:
            InputError: a request that cannot be used. PlanRejected: no plan; the message explains.
            Unavailable: a provider out of reach.
        """
        ...


def make_planner(spec: str, *, remeasure: bool = False, **options: Any) -> Planner:
    """The planner that `spec` names: `symbolic`, `exhaustive`, `replay:FILE` or `PROVIDER[:MODEL]`.

    `options` go to the model's planner (see `palpate.planning.vlm.VlmPlanner`).

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

        return ReplayPlanner(Path(rest), remeasure)
    from palpate.planning.provider import PROVIDERS

    if kind not in PROVIDERS:
        raise unknown_name("planner", spec, [*BUILT_IN, *(f"{name}:MODEL" for name in PROVIDERS)])
    from palpate.planning.vlm import VlmPlanner

    return VlmPlanner(spec, remeasure=remeasure, **options)
