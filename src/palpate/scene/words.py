"""Words by which a request may name an object or surface: parts of its name, colour, shape."""

from __future__ import annotations

import re

import numpy as np

from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import Element, tokens

_COLOURS = {
    "red": (0.85, 0.1, 0.1),
    "green": (0.1, 0.65, 0.15),
    "blue": (0.1, 0.2, 0.8),
    "yellow": (0.95, 0.85, 0.1),
    "orange": (0.95, 0.5, 0.05),
    "purple": (0.5, 0.1, 0.6),
    "pink": (1.0, 0.55, 0.7),
    "brown": (0.45, 0.28, 0.12),
    "black": (0.05, 0.05, 0.05),
    "white": (0.97, 0.97, 0.97),
    "grey": (0.5, 0.5, 0.5),
    "light blue": (0.55, 0.78, 0.95),
    "light green": (0.6, 0.9, 0.6),
    "dark blue": (0.05, 0.08, 0.4),
    "dark green": (0.03, 0.3, 0.08),
    "dark red": (0.45, 0.03, 0.05),
    "cyan": (0.1, 0.8, 0.85),
    "beige": (0.9, 0.82, 0.65),
}
_SPELLINGS = {"grey": "gray", "purple": "violet"}
_SHAPES = {
    "box": ("box", "block", "cube"),
    "cylinder": ("cylinder", "can"),
    "sphere": ("ball", "sphere"),
    "ellipsoid": ("ellipsoid",),
    "capsule": ("capsule",),
}


def name_words(name: str) -> set[str]:
    """Words of a name: green and bottle of `greenBottle_2`; and the name itself."""
    # Words start at capitals; letters of other scripts make words too, digits do not.
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_a-zA-Z]+", name)
    words = {part.lower() for part in parts}
    return words | {name.lower(), " ".join(part.lower() for part in parts)} - {""}


def thing_words(
    name: str,
    element: Element,
    geoms: tuple[Element, ...],
    defaults: Defaults,
    shapes: bool = True,
) -> frozenset[str]:
    """Words for the body or geom `name` made of `geoms`, with the names of its parts; `shapes` adds
    `box`, `ball`, …"""
    words = name_words(name)
    root = element.getroottree().getroot()
    for part in element.iterdescendants("body"):
        words |= name_words(part.get("name") or "")
    for geom in geoms:
        rgb = _rgb(geom, defaults, root)
        if rgb is not None:
            words |= colour_words(rgb)
    # The name and shape of the only geom describe the body.
    if len(geoms) == 1:
        (only,) = geoms
        words |= name_words(only.get("name") or "")
        if shapes:
            words.update(_SHAPES.get(defaults.attribute(only, "type") or "sphere", ()))
    return frozenset(words)


def colour_words(rgb: tuple[float, float, float]) -> set[str]:
    """Words of the nearest basic colour; for `light blue` also `blue`."""

    def distance(name: str) -> float:
        return float(np.linalg.norm(np.array(_COLOURS[name]) - np.array(rgb)))

    nearest = min(_COLOURS, key=distance)
    words = {nearest, nearest.split()[-1]}
    return words | {_SPELLINGS[w] for w in words if w in _SPELLINGS}


def _rgb(geom: Element, defaults: Defaults, root: Element) -> tuple[float, float, float] | None:
    """Colour of a geom, else of its material; None where neither states one."""
    stated = defaults.attribute(geom, "rgba")
    if stated is None:
        name = defaults.attribute(geom, "material")
        for material in root.iterfind("asset/material") if name is not None else ():
            if material.get("name") == name:
                stated = defaults.attribute(material, "rgba")
                break
    try:
        r, g, b = (float(part) for part in tokens(stated)[:3])
    except ValueError:
        return None
    return r, g, b
