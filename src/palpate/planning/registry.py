"""Registry of planners: palpate's own, the models, and those of other packages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import TypeGuard

from palpate.errors import unknown_name
from palpate.extensions import extensions, public
from palpate.planning.model.provider import PROVIDERS
from palpate.planning.planner import Planner, PlannerKind, PlannerSettings

OWN = ("symbolic", "exhaustive")
"""Planners whose plans are palpate's own."""


@dataclass(frozen=True, slots=True)
class Planners:
    """Kinds of planners by name, in the order in which they are listed."""

    kinds: Mapping[str, PlannerKind]

    def make(self, spec: str, settings: PlannerSettings | None = None) -> Planner:
        """Make the planner that `spec` names, e.g. `symbolic`, `replay:FILE`, `openai:MODEL`.

        Raises:
            InputError: unknown; the message lists the valid ones.
        """
        name, _, argument = spec.partition(":")
        kind = self.kinds.get(name)
        if kind is None or not kind.accepts(spec):
            raise unknown_name("planner", spec, [known.form for known in self.kinds.values()])
        return kind.make(argument, settings or PlannerSettings())


@cache
def planners() -> Planners:
    """Palpate's own planners and everything in the entry-point group `palpate.planners`.

    An entry point names a module; every public planner class and every public `PlannerKind` in it
    is registered under its name. Palpate's own names cannot be taken.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """
    own = [
        PlannerKind("symbolic", _symbolic),
        PlannerKind("exhaustive", _exhaustive),
        PlannerKind("replay", _replay, "FILE"),
    ]
    for provider in PROVIDERS:
        own.append(PlannerKind(provider, partial(_model, provider), "MODEL", optional=True))
    kinds = {kind.name: kind for kind in own}
    for module in extensions("palpate.planners"):
        for kind in offered_kinds(module):
            kinds.setdefault(kind.name, kind)
    return Planners(kinds)


def offered_kinds(module: ModuleType) -> Iterator[PlannerKind]:
    """Planners that are public in another package's module."""
    for thing in public(module):
        if isinstance(thing, PlannerKind):
            yield thing
        elif isinstance(thing, type) and is_planner(thing):
            name: str = vars(thing)["name"]
            yield PlannerKind(name, partial(_without_arguments, thing))


def is_planner(cls: type) -> TypeGuard[type[Planner]]:
    """True if a class has the members of `Planner`, with a constant name."""
    return isinstance(vars(cls).get("name"), str) and callable(getattr(cls, "plan", None))


# Factories import the planner that they make, so that a command loads no other.


def _without_arguments(cls: type[Planner], argument: str, settings: PlannerSettings) -> Planner:
    return cls()


def _symbolic(argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.symbolic.planner import SymbolicPlanner

    return SymbolicPlanner(settings.remeasure, settings.within, settings.measure)


def _exhaustive(argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.symbolic.planner import ExhaustivePlanner

    return ExhaustivePlanner()


def _replay(argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.recorded import ReplayPlanner

    return ReplayPlanner(Path(argument), settings.remeasure, settings.builder)


def _model(provider: str, argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.model.planner import VlmPlanner
    from palpate.planning.model.settings import ModelSettings

    spec = f"{provider}:{argument}" if argument else provider
    model_settings = settings.model_settings or ModelSettings()
    return VlmPlanner(
        spec,
        model_settings,
        settings.remeasure,
        settings.builder,
        settings.measure,
        settings.rehearse,
    )
