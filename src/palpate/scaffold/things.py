"""Things by their names: what shape and size a thing of that name may have, and where it may stand."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from palpate.errors import InputError
from palpate.files.plain_yaml import plain_yaml

MAX_THINGS = 15
MAX_NAME = 60

UNKNOWN = {"box": [60, 60, 80]}
"""mm: what a thing of no known kind is drawn as."""

_COLOURS = {
    "red": ".80 .18 .16",
    "blue": ".16 .42 .80",
    "green": ".22 .60 .32",
    "yellow": ".93 .78 .22",
    "orange": ".90 .52 .16",
    "purple": ".52 .28 .64",
    "white": ".93 .93 .91",
    "black": ".14 .14 .15",
    "grey": ".55 .56 .58",
    "gray": ".55 .56 .58",
    "brown": ".50 .35 .22",
}
_PALETTE = ("blue", "red", "green", "yellow", "purple", "orange")

_ROWS = (0.42, 0.56, 0.70)
_COLUMNS = (0.0, 0.18, -0.18, 0.36, -0.36)
"""m, in front of the arm's foot: rows ahead and columns aside, with room for a hand between them."""


@dataclass(frozen=True, slots=True)
class Thing:
    """Object or surface of a new scene.

    Attributes:
        name: as in the MJCF.
        kind: what it is taken for, or "" where its name says nothing.
        shape: `box`, `cylinder` or `sphere`.
        extents: m, of a box along x, y and z, of a cylinder across and upright, of a ball across.
        x, y: where it stands, m.
        colour: red, green and blue, 0 to 1.
    """

    name: str
    kind: str
    shape: str
    extents: tuple[float, ...]
    x: float
    y: float
    colour: str

    @property
    def height(self) -> float:
        """m: how far it reaches above what it stands on."""
        return self.extents[-1]

    @property
    def size(self) -> str:
        """MuJoCo's `size` of the geom: half extents, m."""
        return " ".join(f"{extent / 2:.4g}" for extent in self.extents)


@cache
def kinds() -> dict[str, dict[str, list[float]]]:
    """The kinds that are known: `{"mug": {"cylinder": [74, 95]}}`, in mm."""
    text = files("palpate.scaffold").joinpath("kinds.yaml").read_text(encoding="utf-8")
    found: Any = plain_yaml(text, "kinds.yaml")
    return found


def things_named(names: Sequence[str]) -> tuple[Thing, ...]:
    """A thing for each name, in rows in front of the arm.

    Raises:
        InputError: more than can be placed, two of one name, or no name at all.
    """
    if len(names) > MAX_THINGS:
        raise InputError(
            f"{len(names)} objects are too many to begin with: at most {MAX_THINGS} fit in front of the arm; "
            "add the others to the file by hand"
        )
    places = [(x, y) for x in _ROWS for y in _COLUMNS]
    found: dict[str, Thing] = {}
    for name, place in zip(names, places, strict=False):
        thing = _thing(name, place, colour=_PALETTE[len(found) % len(_PALETTE)])
        if thing.name in found:
            raise InputError(f"two objects are called '{thing.name}': give each a name of its own")
        found[thing.name] = thing
    return tuple(found.values())


def _thing(said: str, place: tuple[float, float], colour: str) -> Thing:
    name = identifier(said)
    words = name.lower().split("_")
    kind = next((word for word in reversed(words) if word in kinds()), "")
    [(shape, millimetres)] = kinds().get(kind, UNKNOWN).items()
    colour = next((word for word in words if word in _COLOURS and word != kind), colour)
    extents = tuple(value / 1000 for value in millimetres)
    return Thing(name, kind, shape, extents, *place, colour=_COLOURS[colour])


def identifier(said: str) -> str:
    """A name as MJCF and plans have it: letters, digits and underscores.

    Raises:
        InputError: nothing is left of it, or it is too long.
    """
    name = re.sub(r"\W+", "_", said.strip()).strip("_")
    if not name or not name[0].isalpha() or len(name) > MAX_NAME:
        raise InputError(
            f"'{said[:MAX_NAME]}' cannot be an object's name: it needs a letter first, then letters, digits or "
            f"'_', at most {MAX_NAME} of them, for example 'red_mug'"
        )
    return name
