"""The vocabulary: which primitives and composites there are."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

from palpate.errors import InputError, unknown_name
from palpate.quantities.quantity import QUANTITIES
from palpate.vocabulary import core
from palpate.vocabulary.base import ConversionPrimitive, Primitive
from palpate.vocabulary.composites import COMPOSITES, Composite


def converters(quantity: str) -> list[type[Primitive]]:
    """Primitives that convert a buffer into `quantity`."""
    return [
        cls
        for cls in vocabulary().primitives.values()
        if cls.measures is not None and cls.measures.id == quantity
    ]


def sensors(buffer: str | None) -> list[type[Primitive]]:
    """Primitives that write `buffer`."""
    return [
        cls
        for cls in vocabulary().primitives.values()
        if buffer is not None and cls.writes == buffer
    ]


class Vocabulary:
    """The primitives and composites that plans may use, by name."""

    def __init__(
        self, primitives: Mapping[str, type[Primitive]], composites: Mapping[str, Composite]
    ) -> None:
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
    """Everything registered through the entry-point group `palpate.primitives`, palpate's own
    first.

    An entry point names a module; every public concrete `Primitive` in it is registered under its
    class name.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """

    found: dict[str, type[Primitive]] = _declared(core)
    for entry in sorted(entry_points(group="palpate.primitives"), key=lambda e: e.name):
        if entry.value != core.__name__:
            found = {**_declared(_loaded(entry)), **found}
    for cls in found.values():
        if cls.measures is not None:
            QUANTITIES.setdefault(cls.measures.id, cls.measures)
    return Vocabulary(
        dict(sorted(found.items(), key=lambda item: _order(item[0], core))), COMPOSITES
    )


def _loaded(entry: EntryPoint) -> ModuleType:
    try:
        return entry.load()
    except Exception as error:
        raise InputError(
            f"the primitives '{entry.name}' ({entry.value}) cannot be loaded: {type(error).__name__}: "
            f"{error}; repair or uninstall the package that brings them"
        ) from error


def _declared(module: ModuleType) -> dict[str, type[Primitive]]:
    names: list[str] = getattr(
        module, "__all__", [name for name in vars(module) if not name.startswith("_")]
    )
    candidates = [getattr(module, name) for name in names]
    return {
        c.__name__: c
        for c in candidates
        if isinstance(c, type)
        and issubclass(c, Primitive)
        and c not in (Primitive, ConversionPrimitive)
    }


def _order(name: str, core: ModuleType) -> tuple[int, str]:
    names: list[str] = core.__all__
    return (names.index(name), "") if name in names else (len(names), name)
