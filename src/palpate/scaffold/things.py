"""Objects of a new scene: shape and usual size by name, and a place in front of the arm."""

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
"""mm: shape and size of an object of unknown kind."""

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
        kind: key of `kinds()`, or "" for an unknown name.
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
        """m: upright extent."""
        return self.extents[-1]

    @property
    def size(self) -> str:
        """MuJoCo's `size` of the geom: half extents, m."""
        return " ".join(f"{extent / 2:.4g}" for extent in self.extents)


@cache
def kinds() -> dict[str, dict[str, list[float]]]:
    """Shape and size by kind: `{"mug": {"cylinder": [74, 95]}}`, in mm."""
    text = files("palpate.scaffold").joinpath("kinds.yaml").read_text(encoding="utf-8")
    found: Any = plain_yaml(text, "kinds.yaml")
    return found


def things_named(names: Sequence[str]) -> tuple[Thing, ...]:
    """Place an object for each name, in rows in front of the arm.

    Raises:
        InputError: too many, a name twice, or not a name.
    """
    if len(names) > MAX_THINGS:
        raise InputError(
            f"{len(names)} objects are too many to begin with: at most {MAX_THINGS} fit in front of the arm; "
            "add the others to the file by hand"
        )
    places = [(x, y) for x in _ROWS for y in _COLUMNS]
    found: dict[str, Thing] = {}
    for name, place in zip(names, places, strict=False):
        name = identifier(name)
        if name in found:
            raise InputError(f"two objects are called '{name}': give each a name of its own")
        words = name.lower().split("_")
        # The last word is the noun: a `box_cutter` is a cutter.
        kind = next((word for word in reversed(words) if word in kinds()), "")
        [(shape, millimetres)] = kinds().get(kind, UNKNOWN).items()
        extents = tuple(value / 1000 for value in millimetres)
        usual = _PALETTE[len(found) % len(_PALETTE)]
        colour = next((word for word in words if word in _COLOURS and word != kind), usual)
        found[name] = Thing(name, kind, shape, extents, *place, colour=_COLOURS[colour])
    return tuple(found.values())


def identifier(text: str) -> str:
    """Turn a text into a name for MJCF and plans: letters, digits and underscores.

    Raises:
        InputError: no letter first, or too long.
    """
    name = re.sub(r"\W+", "_", text.strip()).strip("_")
    if not name or not name[0].isalpha() or len(name) > MAX_NAME:
        raise InputError(
            f"'{text[:MAX_NAME]}' cannot be an object's name: it needs a letter first, then letters, digits or "
            f"'_', at most {MAX_NAME} of them, for example 'red_mug'"
        )
    return name
