"""The vocabulary: which primitives and composites there are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType
from typing import Any

from palpate.errors import InputError, unknown_name
from palpate.extensions import extensions, public
from palpate.quantities.catalogue import GROUP as QUANTITIES
from palpate.quantities.catalogue import catalogue
from palpate.quantities.quantity import Quantity
from palpate.vocabulary import contact, conversion, gripper, sensing, turning
from palpate.vocabulary.base import ConversionPrimitive, Primitive
from palpate.vocabulary.composites import COMPOSITES, Composite
from palpate.vocabulary.motion import move_joints, move_pose

GROUP = "palpate.primitives"
"""Entry-point group of third parties' packages. Each entry names a module."""
CORE = (move_pose, move_joints, turning, gripper, contact, sensing, conversion)
"""Modules of palpate's own primitives, in the order in which people read them."""
_ABSTRACT = (Primitive, ConversionPrimitive)


@dataclass(frozen=True, eq=False, repr=False)
class Vocabulary:
    """The primitives and composites that plans may use, by name."""

    primitives: Mapping[str, type[Primitive]]
    composites: Mapping[str, Composite] = field(default_factory=lambda: COMPOSITES)

    def __repr__(self) -> str:
        return f"<Vocabulary: {len(self.primitives)} primitives, {len(self.composites)} composites>"

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
        return self.primitive(type)(**self.arguments(type, args))

    def arguments(self, type: str, args: Mapping[str, Any]) -> dict[str, Any]:
        """The arguments without the buffer that the primitive reads or writes anyway, which may be
        named as the paper names it: `Force2Mass(gripper_forces)`.

        Raises:
            InputError: unknown primitive.
        """
        cls = self.primitive(type)
        buffer = cls.reads or cls.writes
        own = cls.model_fields
        return {k: v for k, v in args.items() if k in own or buffer is None or v != buffer}

    def converters(self, quantity: str) -> list[type[Primitive]]:
        """Primitives that convert a buffer into `quantity`."""
        return [
            cls
            for cls in self.primitives.values()
            if cls.measures is not None and cls.measures.id == quantity
        ]

    def sensors(self, buffer: str) -> list[type[Primitive]]:
        """Primitives that write `buffer`."""
        return [cls for cls in self.primitives.values() if cls.writes == buffer]


def load_vocabulary(third_parties: Iterable[ModuleType] = ()) -> Vocabulary:
    """Palpate's own primitives, and after them those of the modules of `third_parties`.

    Every public concrete `Primitive` of a module is found under its class name. Palpate's own names
    cannot be taken.
    """
    own: dict[str, type[Primitive]] = {}
    for module in CORE:
        own |= {cls.__name__: cls for cls in _public(module) if cls.__module__ == module.__name__}
    theirs: dict[str, type[Primitive]] = {}
    for module in third_parties:
        for cls in _public(module):
            theirs.setdefault(cls.__name__, cls)
    added = {name: theirs[name] for name in sorted(theirs) if name not in own}
    return Vocabulary({**own, **added})


@cache
def vocabulary() -> Vocabulary:
    """Installed vocabulary: palpate's own primitives and those of every package with an entry
    point.

    Raises:
        InputError: an entry point's module cannot be loaded, or a conversion measures a quantity
            that the catalogue lacks; the message names it.
    """
    found = load_vocabulary(extensions(GROUP))
    for cls in found.primitives.values():
        if cls.measures is not None and cls.measures.id not in catalogue():
            raise InputError(
                f"{cls.__name__} measures '{cls.measures.id}', which is no quantity of the "
                "catalogue; the package that brings it must name its module in the entry-point "
                f"group {QUANTITIES}"
            )
    return found


def acquisition(quantity: Quantity, words: Vocabulary | None = None) -> str:
    """Description of a quantity's acquisition: its evidence, and then the conversion or other
    steps."""
    if quantity.derived:
        return f"{quantity.how}; derived"
    for cls in (words or vocabulary()).converters(quantity.id):
        return f"{quantity.how}, then {cls.__name__}"
    return quantity.how


def _public(module: ModuleType) -> Iterator[type[Primitive]]:
    """The concrete primitives that are public in a module, in its order."""
    for thing in public(module):
        if isinstance(thing, type) and issubclass(thing, Primitive) and thing not in _ABSTRACT:
            yield thing
