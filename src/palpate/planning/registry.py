"""Which planners there are, and how one is made from its name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import unknown_name
from palpate.planning.planner import Planner

if TYPE_CHECKING:
    from palpate.planning.model.session import ModelSettings
    from palpate.scene.from_picture import SceneBuilder


BUILT_IN = ("symbolic", "exhaustive", "replay:FILE")


def make_planner(
    spec: str,
    *,
    remeasure: bool = False,
    model_settings: ModelSettings | None = None,
    template: SceneBuilder | None = None,
) -> Planner:
    """The planner that `spec` names: `symbolic`, `exhaustive`, `replay:FILE` or `PROVIDER[:MODEL]`.

    `asking` is how a model is asked; `template` makes a scene of what it saw, where there is none.

    Raises:
        InputError: unknown; the message lists the valid ones.
    """
    kind, _, rest = spec.partition(":")
    if spec == "symbolic":
        from palpate.planning.symbolic.planner import SymbolicPlanner

        return SymbolicPlanner(remeasure)
    if spec == "exhaustive":
        from palpate.planning.exhaustive import ExhaustivePlanner

        return ExhaustivePlanner()
    if kind == "replay" and rest:
        from palpate.planning.recorded import ReplayPlanner

        return ReplayPlanner(Path(rest), remeasure, template)
    from palpate.planning.model.provider import PROVIDERS

    if kind not in PROVIDERS:
        raise unknown_name("planner", spec, [*BUILT_IN, *(f"{name}:MODEL" for name in PROVIDERS)])
    from palpate.planning.model.planner import VlmPlanner
    from palpate.planning.model.session import ModelSettings

    return VlmPlanner(spec, model_settings or ModelSettings(), remeasure, template)
