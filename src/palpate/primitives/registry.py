"""The vocabulary: all primitives and composites, and the JSON schema of a plan derived from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType
from typing import Any

from palpate.common.errors import InputError, unknown_name
from palpate.common.extensions import Registry, extensions, public
from palpate.estimation.quantities.catalogue import GROUP as QUANTITIES
from palpate.estimation.quantities.catalogue import catalogue
from palpate.estimation.quantities.quantity import Quantity
from palpate.primitives import contact, gripper, handle, motion, sensing, turning
from palpate.primitives.base import ConversionPrimitive, Primitive

# Entry-point group of third parties' packages. Each entry names a module.
GROUP = "palpate.primitives"
# Modules of palpate's own primitives, in the order of the documentation.
CORE = (motion, turning, gripper, contact, handle, sensing)
ABSTRACT = (Primitive, ConversionPrimitive)


@dataclass(frozen=True, slots=True)
class Composite:
    """Declaration of a composite."""

    name: str  # in a plan
    symbol: str  # for people
    summary: str  # for the prompt and the documentation
    btcpp: Mapping[str, str]  # tag and fixed attributes in BT.CPP 4.


COMPOSITES: dict[str, Composite] = {
    c.name: c
    for c in (
        Composite(
            "Sequence",
            "{-}",
            "Runs its children in order and remembers where it is; the first failure stops it.",
            {"tag": "Sequence"},
        ),
        Composite(
            "Parallel",
            "/_/",
            "Runs all its children at once and succeeds when all have; the first failure stops them all. One child "
            "may move the arm and one the gripper; others sense.",
            {"tag": "Parallel", "success_count": "-1", "failure_count": "1"},
        ),
    )
}


@dataclass(frozen=True, eq=False, repr=False)
class Vocabulary:
    """The primitives and composites that plans may use, by name."""

    primitives: Mapping[str, type[Primitive]]
    composites: Mapping[str, Composite] = field(default_factory=lambda: COMPOSITES)

    def __repr__(self) -> str:
        return f"<Vocabulary: {len(self.primitives)} primitives, {len(self.composites)} composites>"

    def primitive(self, name: str) -> type[Primitive]:
        """Return the class of that name; the error for an unknown one lists the valid ones."""
        if name not in self.primitives:
            raise unknown_name("primitive", name, [*self.primitives, *self.composites])
        return self.primitives[name]

    def make(self, type: str, args: Mapping[str, Any]) -> Primitive:
        """Make an instance; pydantic raises `ValidationError` for arguments that do not fit."""
        return self.primitive(type)(**self.arguments(type, args))

    def arguments(self, type: str, args: Mapping[str, Any]) -> dict[str, Any]:
        """Remove the primitive's own buffer, which a plan may name as the paper does:
        `Force2Mass(gripper_forces)`.
        """
        cls = self.primitive(type)
        buffer = cls.reads or cls.writes
        own = cls.model_fields
        return {k: v for k, v in args.items() if k in own or buffer is None or v != buffer}

    def converters(self, quantity: str) -> list[type[Primitive]]:
        """Primitives that convert a buffer into `quantity`."""
        every = self.primitives.values()
        return [cls for cls in every if cls.measures is not None and cls.measures.id == quantity]

    def sensors(self, buffer: str) -> list[type[Primitive]]:
        """Primitives that write `buffer`."""
        return [cls for cls in self.primitives.values() if cls.writes == buffer]


def load_vocabulary(third_parties: Iterable[ModuleType] = ()) -> Vocabulary:
    """Palpate's own primitives, and after them those of the modules of `third_parties`.

    Every public concrete `Primitive` of a module is found under its class name. Palpate's own names
    cannot be taken.
    """
    own = [cls for module in CORE for cls in _public(module) if cls.__module__ == module.__name__]
    others = [cls for module in third_parties for cls in _public(module)]
    others.sort(key=lambda cls: cls.__name__)
    return Vocabulary(Registry([(cls.__name__, cls) for cls in (*own, *others)]))


def _public(module: ModuleType) -> Iterator[type[Primitive]]:
    """Public concrete primitives of a module, in its order."""
    for part in public(module):
        if isinstance(part, type) and issubclass(part, Primitive) and part not in ABSTRACT:
            yield part


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
        # A conversion needs its quantity in the catalogue, or its estimate has no name.
        if cls.measures is not None and cls.measures.id not in catalogue():
            raise InputError(
                f"{cls.__name__} measures '{cls.measures.id}', which is not in the catalogue; its "
                f"package must name the quantity's module in the entry-point group {QUANTITIES}"
            )
    return found


def acquisition(quantity: Quantity, words: Vocabulary | None = None) -> str:
    """Description of a quantity's acquisition: its evidence, and its conversion if there is one."""
    if quantity.derived:
        return f"{quantity.how}; derived"
    # The first primitive that converts to the quantity names the last step.
    for cls in (words or vocabulary()).converters(quantity.id):
        return f"{quantity.how}, then {cls.__name__}"
    return quantity.how


def leaf_schema(cls: type[Primitive]) -> dict[str, Any]:
    """JSON schema of one primitive's node."""
    schema = cls.model_json_schema()
    # Every node states its type; a name is optional, and so is the buffer.
    properties: dict[str, Any] = {"type": {"const": cls.__name__}, "name": {"type": "string"}}
    buffer = cls.reads or cls.writes
    if buffer:
        properties[buffer] = {
            "const": buffer,
            "description": "the buffer, which may be named as the paper names it",
        }
    # The fields of the pydantic class complete the node.
    properties |= schema.get("properties", {})
    return {
        "type": "object",
        "description": cls.summary(),
        "properties": properties,
        "required": ["type", *schema.get("required", [])],
        "additionalProperties": False,
    }


def composite_schema(composite: Composite) -> dict[str, Any]:
    """JSON schema of a composite's node."""
    return {
        "type": "object",
        "description": composite.summary,
        "required": ["type", "children"],
        "properties": {
            "type": {"const": composite.name},
            "name": {"type": "string"},
            "children": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/node"}},
        },
        "additionalProperties": False,
    }


def plan_schema(vocabulary: Vocabulary) -> dict[str, Any]:
    """JSON schema (2020-12) of a whole plan; the tree is recursive through `$defs/node`."""
    # One definition for each primitive and composite; a node is any of them.
    leaves = {name: leaf_schema(cls) for name, cls in vocabulary.primitives.items()}
    composites = {name: composite_schema(c) for name, c in vocabulary.composites.items()}
    node = {"oneOf": [{"$ref": f"#/$defs/{name}"} for name in (*leaves, *composites)]}
    parameter = {
        "type": "object",
        "required": ["object", "quantity"],
        "additionalProperties": False,
        "properties": {
            "object": {"type": "string"},
            "quantity": {"type": "string"},
            "again": {"type": "boolean"},
        },
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "palpate plan",
        "type": "object",
        "required": ["parameters", "explanation", "tree"],
        "properties": {
            "parameters": {"type": "array", "items": parameter},
            "explanation": {"type": "string"},
            "tree": {"oneOf": [{"type": "null"}, {"$ref": "#/$defs/node"}]},
        },
        "$defs": {**leaves, **composites, "node": node},
    }
