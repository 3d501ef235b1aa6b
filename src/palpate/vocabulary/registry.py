"""The vocabulary: which primitives and composites there are."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Any

from palpate.errors import InputError, unknown_name
from palpate.extensions import extensions, public
from palpate.quantities.catalogue import GROUP, catalogue
from palpate.quantities.quantity import Quantity
from palpate.vocabulary import core
from palpate.vocabulary.base import ConversionPrimitive, Primitive
from palpate.vocabulary.composites import COMPOSITES, Composite

_ABSTRACT = (Primitive, ConversionPrimitive)


def converters(quantity: str) -> list[type[Primitive]]:
    """Primitives that convert a buffer into `quantity`."""
    return [
        cls
        for cls in vocabulary().primitives.values()
        if cls.measures is not None and cls.measures.id == quantity
    ]


def acquisition(quantity: Quantity) -> str:
    """How a quantity is acquired, in words: its evidence, and then the conversion or what else
    follows."""
    if quantity.derived:
        return f"{quantity.how}; derived"
    names = [cls.__name__ for cls in converters(quantity.id)]
    return f"{quantity.how}, then {names[0]}" if names else quantity.how


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
        InputError: an entry point's module cannot be loaded, or a conversion measures a quantity
            that the catalogue lacks; the message names it.
    """

    found: dict[str, type[Primitive]] = _declared(core)
    for module in extensions("palpate.primitives"):
        if module is not core:
            found = {**_declared(module), **found}
    for cls in found.values():
        _require_known(cls)
    return Vocabulary(
        dict(sorted(found.items(), key=lambda item: _order(item[0], core))), COMPOSITES
    )


def _require_known(cls: type[Primitive]) -> None:
    if cls.measures is not None and cls.measures.id not in catalogue():
        raise InputError(
            f"{cls.__name__} measures '{cls.measures.id}', which is no quantity of the catalogue; the "
            f"package that brings it must name its module in the entry-point group {GROUP}"
        )


def _declared(module: ModuleType) -> dict[str, type[Primitive]]:
    """The concrete primitives that are public in `module`, by name."""
    found: dict[str, type[Primitive]] = {}
    for thing in public(module):
        if isinstance(thing, type) and issubclass(thing, Primitive) and thing not in _ABSTRACT:
            found[thing.__name__] = thing
    return found


def _order(name: str, core: ModuleType) -> tuple[int, str]:
    names: list[str] = core.__all__
    return (names.index(name), "") if name in names else (len(names), name)
