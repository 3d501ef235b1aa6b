"""The planners there are: palpate's own, the models, and those that other packages bring."""

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


@dataclass(frozen=True, slots=True)
class Planners:
    """Kinds of planners by name, in the order in which they are listed."""

    kinds: Mapping[str, PlannerKind]

    def make(self, spec: str, settings: PlannerSettings | None = None) -> Planner:
        """The planner that `spec` names, e.g. `symbolic`, `replay:FILE`, `openai:MODEL`.

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
    kinds = {kind.name: kind for kind in _own()}
    for module in extensions("palpate.planners"):
        for kind in _offered(module):
            kinds.setdefault(kind.name, kind)
    return Planners(kinds)


def _own() -> Iterator[PlannerKind]:
    yield PlannerKind("symbolic", _symbolic)
    yield PlannerKind("exhaustive", _exhaustive)
    yield PlannerKind("replay", _replay, "FILE")
    for provider in PROVIDERS:
        yield PlannerKind(provider, partial(_model, provider), "MODEL", optional=True)


def _offered(module: ModuleType) -> Iterator[PlannerKind]:
    """The planners that are public in another package's module."""
    for thing in public(module):
        if isinstance(thing, PlannerKind):
            yield thing
        elif isinstance(thing, type) and _is_planner(thing):
            name: str = vars(thing)["name"]
            yield PlannerKind(name, partial(_plain, thing))


def _is_planner(cls: type) -> TypeGuard[type[Planner]]:
    """True if a class has the members of `Planner`, with a constant name."""
    named = isinstance(vars(cls).get("name"), str)
    return named and callable(getattr(cls, "plan", None))


# What makes a planner imports it, so that a command loads only the planner that it uses.


def _plain(cls: type[Planner], argument: str, settings: PlannerSettings) -> Planner:
    return cls()


def _symbolic(argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.symbolic.planner import SymbolicPlanner

    return SymbolicPlanner(settings.remeasure, settings.within)


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
    return VlmPlanner(spec, model_settings, settings.remeasure, settings.builder)
