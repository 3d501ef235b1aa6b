"""MJCF's defaults classes, and MuJoCo's values of attributes that are not stated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from palpate.mjcf.document import UNKNOWN, Element, tokens
from palpate.mjcf.edits import Edit

MUJOCO_FRICTION = ("1", "0.005", "0.0001")
"""MuJoCo's default sliding, torsional and rolling friction."""

MUJOCO_PAIR_FRICTION = "1 1 0.005 0.0001 0.0001"
"""MuJoCo's default friction of a `<pair>`: sliding along two axes, torsional, rolling about two axes."""

INHERITED: Mapping[str, tuple[str, ...] | None] = {
    "mass": None,
    "density": None,
    "friction": MUJOCO_FRICTION,
}
"""Attributes of geoms that a defaults class may leave open. Once every element has its own value, the
`?` is replaced by these numbers, or the attribute is removed (None)."""

STAND_INS: Mapping[str, tuple[str, ...]] = {
    "mass": ("1",),
    "density": ("1000",),
    "friction": MUJOCO_FRICTION,
}
"""Numbers in place of a `?` while models are compiled; without them an outer class would apply."""


def unknowns_replaced(
    element: Element, values: Mapping[str, tuple[str, ...] | None]
) -> Iterator[Edit]:
    """Yield the changes that replace each `?` in an element's inherited attributes by its number in
    `values`, or remove the attribute (None)."""
    for attribute, numbers in values.items():
        parts = tokens(element.get(attribute))
        unknown = [i for i, part in enumerate(parts) if part == UNKNOWN]
        if unknown and numbers is None:
            yield Edit(element, attribute, None)
        elif unknown and numbers is not None:
            yield Edit(element, attribute, {i: numbers[min(i, 2)] for i in unknown})


class Defaults:
    """The `<default>` classes of a document and of each model that it attaches."""

    def __init__(self, root: Element, *attached: Element) -> None:
        # For each class of a model its `<default>` elements, the outermost first.
        self._models: dict[Element, dict[str, list[Element]]] = {}
        for model in (root, *attached):
            classes = self._models[model] = {}
            pending = [(top, [top]) for top in model.iterfind("default")]
            while pending:
                default, chain = pending.pop(0)
                classes.setdefault(default.get("class") or "main", []).extend(chain)
                inner = [(child, [*chain, child]) for child in default.iterfind("default")]
                pending = [*inner, *pending]
        self._only = None if attached else root

    def attribute(self, element: Element, name: str) -> str | None:
        """The attribute with defaults applied, or None if nothing states it."""
        own = element.get(name)
        if own is not None:
            return own
        # Its own class, else the `childclass` of the nearest ancestor, else the top class.
        outer = element.iterancestors("body", "frame", "worldbody")
        called = element.get("class")
        called = called or next((c for above in outer if (c := above.get("childclass"))), None)
        root = element.getroottree().getroot() if self._only is None else self._only
        if called is None:
            top = root.find("default")
            called = "" if top is None else top.get("class") or "main"
        for default in reversed(self._models[root].get(called, [])):
            for entry in default.iterfind(str(element.tag)):
                inherited = entry.get(name)
                if inherited is not None:
                    return inherited
        return None
