"""The elements of an object or a surface: its body, the geoms that count, its `<inertial>`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from palpate.errors import InputError
from palpate.mjcf.attached import around
from palpate.mjcf.defaults import Defaults
from palpate.mjcf.document import Element, compiler_settings, has_unknown, label
from palpate.mjcf.roles.robots import TRANSPARENT, through_frames

Role = Literal["object", "surface"]
PLACING = frozenset({"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"})
"""Attributes that place a body, a frame or a site."""


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """The elements of an object or a surface.

    Attributes:
        name: as compiled models know it; of several copies, that of the first, which stands for all.
        element: its body; of a surface, its geom when that stands in the worldbody.
        geoms: all geoms of its body and what is fixed to it; of a surface, those that may carry.
        colliding: those of them that can touch, else all.
        inertial: its `<inertial>`, if any.
        defaults: what its elements inherit.
        parts: an object's bodies besides its own, which move with it.
        through: the `<attach>`s that bring it from a model of its own, the outermost first.
    """

    name: str
    role: Role
    element: Element
    geoms: tuple[Element, ...]
    colliding: tuple[Element, ...]
    inertial: Element | None
    defaults: Defaults
    parts: tuple[Element, ...] = ()
    through: tuple[Element, ...] = ()

    def moved_by(self) -> Element | None:
        """Parent with a pose of its own, so that the element's pose is not the world's; None if
        there is none."""
        for outer in around(self.element, self.through):
            moves = outer.tag == "replicate" or PLACING & set(outer.keys())
            if outer.tag in (*TRANSPARENT, "body") and moves:
                return outer
        return None


def inertial_of(body: Element) -> Element | None:
    """A body's `<inertial>`, where MuJoCo looks at it."""
    settings = compiler_settings(body.getroottree().getroot())
    if settings.get("inertiafromgeom") == "true":
        return None
    return body.find("inertial")


def has_open_height(geom: Element, defaults: Defaults) -> bool:
    """True if its z or its half height is written `?`."""
    index = half_height_index(geom, defaults)
    open_size = index is not None and has_unknown(geom, "size", index)
    return open_size or has_unknown(geom, "pos", 2)


def half_height_index(geom: Element, defaults: Defaults) -> int | None:
    """Index of the half height in `size`: box 2, cylinder 1, others None."""
    return {"box": 2, "cylinder": 1}.get(defaults.attribute(geom, "type") or "sphere")


def own_geoms(body: Element) -> tuple[Element, ...]:
    return tuple(child for child in through_frames(body) if child.tag == "geom")


def colliding(geoms: tuple[Element, ...], defaults: Defaults) -> tuple[Element, ...]:
    """The geoms that can touch something; all of them where none can."""
    touching = tuple(geom for geom in geoms if _touches(geom, defaults))
    return touching or geoms


def carrying(
    element: Element, geoms: tuple[Element, ...], defaults: Defaults
) -> tuple[Element, ...]:
    """The geoms that may be a surface's top: the one whose own height is open, else all."""
    marked = tuple(geom for geom in geoms if has_open_height(geom, defaults))
    if len(marked) > 1:
        raise InputError(
            f"surface {label(element)} has `?` in several geoms; only one can be its top"
        )
    return marked or geoms


def _touches(geom: Element, defaults: Defaults) -> bool:
    contype = defaults.attribute(geom, "contype") or "1"
    conaffinity = defaults.attribute(geom, "conaffinity") or "1"
    return contype.strip() != "0" or conaffinity.strip() != "0"
