"""Bounds on the size of a scene, computed from its text before MuJoCo builds it.

A line of MJCF can ask for a million bodies. What can be computed from the text is computed and
refused here; where a text does not tell (meshes, plugins, many bodies), it says that the scene is
to be compiled elsewhere first (`palpate.mjcf.limits.trial`).

The limits are ours. They are some ten times what scenes of a workplace need, and small enough that
MuJoCo 4.0 compiles what keeps to them in about a second and a few hundred megabytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, prod

from palpate.errors import InputError
from palpate.mjcf.document import Document, Element, elements, label, tokens
from palpate.mjcf.limits.assets import require_bounded_files

MAX_ELEMENTS = 10_000
"""Elements of a scene, replicated ones counted as often as they are replicated. A kitchen with its
furniture cut into convex pieces has some five thousand."""

MAX_REPLICATED = 3_000
"""Elements that `<replicate>` adds: MuJoCo takes time with the square of their number."""

MAX_POINTS = 4_000
"""Points of all flexible things together."""

MAX_CELLS = 4_000_000
"""Cells of all height fields together."""

MAX_TEXELS = 64_000_000
"""Pixels of all textures that are made by MuJoCo together; a cube has six sides."""

MAX_MEMORY = 512 << 20
"""Bytes that `<size memory=…>` may reserve."""

MANY_ELEMENTS, MANY_POINTS = 2_000, 500
"""From here on, a scene is compiled elsewhere first."""

LARGE_TEXT, LARGE_MESHES = 1_000_000, 5_000_000
"""Bytes of MJCF, and of all mesh files, from which on the same holds."""

SIZES: Mapping[str, float] = {
    "actdim": 1_000,
    "gridlayout": 1_000,
    "interval": 1_000,
    "iterations": 10_000,
    "ls_iterations": 10_000,
    "noslip_iterations": 10_000,
    "ccd_iterations": 10_000,
    "sdf_iterations": 1_000,
    "sdf_initpoints": 1_000,
    "nconmax": 100_000,
    "njmax": 100_000,
    "nkey": 1_000,
    "nsample": 10_000,
    "nstack": 50_000_000,
    "nuserdata": 100_000,
    "nuser_body": 1_000,
    "nuser_jnt": 1_000,
    "nuser_geom": 1_000,
    "nuser_site": 1_000,
    "nuser_cam": 1_000,
    "nuser_tendon": 1_000,
    "nuser_actuator": 1_000,
    "nuser_sensor": 1_000,
    "num": 1_000,
    "numquads": 1_000,
    "numslices": 1_000,
    "numstacks": 1_000,
    "octree_maxdepth": 8,
    "offheight": 16_384,
    "offsamples": 64,
    "offwidth": 16_384,
    "params": 128,
    "resolution": 16_384,
    "shadowsize": 16_384,
}
"""Attributes that size something, and the largest number in each."""

_UNITS = {"": 1, "k": 1 << 10, "m": 1 << 20, "g": 1 << 30, "t": 1 << 40, "p": 1 << 50, "e": 1 << 60}
_FLEX_COUNT = (10.0, 10.0, 10.0)
"""MuJoCo's own where a `<flexcomp>` states none."""
_BUILT_IN = "mujoco."
"""MuJoCo's own plugins begin with it; all others would have to be loaded as code."""


@dataclass(frozen=True, slots=True)
class Extent:
    """Size of a scene once it is built."""

    elements: float
    points: float
    is_uncertain: bool = False
    """Something in it is larger than its text tells."""

    @property
    def is_large(self) -> bool:
        """True if it is compiled elsewhere first."""
        return self.is_uncertain or self.elements > MANY_ELEMENTS or self.points > MANY_POINTS


def require_bounded(document: Document, where: str = "the scene") -> Extent:
    """Check the size of a scene and return it.

    Raises:
        InputError: larger than is built, a picture unpacks to more than is read, or it needs a
            plugin that is not MuJoCo's own; the message names the element or the file.
    """
    roots = [document.root, *(model.root for model in document.attached().values())]
    for root in roots:
        _require_cells(root, where)
        for element in elements(root):
            _require_sizes(element, where)
            _require_own_plugin(element, where)
    # How often a model is attached is for the trial to find out: it has at least its own extent.
    extents = [_grown(root, where) for root in roots]
    meshes = require_bounded_files(document.files)
    is_uncertain = any(extent.is_uncertain for extent in extents)
    is_uncertain |= meshes > LARGE_MESHES or len(document.text) > LARGE_TEXT
    counted = sum(extent.elements for extent in extents)
    return Extent(counted, sum(extent.points for extent in extents), is_uncertain)


def _grown(root: Element, where: str) -> Extent:
    """Elements and points, counted as often as they are replicated."""
    counted = points = written = 0.0
    is_uncertain = False
    for element, times in _multiplied(root):
        counted += times
        written += 1
        if element.tag in ("flexcomp", "composite"):
            points += times * prod(_numbers(element, "count") or _FLEX_COUNT)
        is_uncertain |= element.tag in ("plugin", "attach") or element.get("type") == "sdf"
        if counted > MAX_ELEMENTS:
            raise _too_many(element, where, MAX_ELEMENTS, "elements")
        if counted - written > MAX_REPLICATED:
            raise _too_many(element, where, MAX_REPLICATED, "replicated elements")
        if points > MAX_POINTS:
            raise _too_many(element, where, MAX_POINTS, "points of flexible things")
    return Extent(counted, points, is_uncertain)


def _multiplied(root: Element) -> Iterator[tuple[Element, float]]:
    """Every element, and how many of it there will be."""
    pending = [(root, 1.0)]
    while pending:
        element, times = pending.pop()
        yield element, times
        if element.tag == "replicate":
            times *= max([1.0, *_numbers(element, "count")])
        pending += [(child, times) for child in reversed(element) if isinstance(child.tag, str)]


def _require_cells(root: Element, where: str) -> None:
    cells = texels = 0.0
    for element in elements(root):
        if element.tag == "hfield":
            cells += _product(element, "nrow", "ncol")
            if cells > MAX_CELLS:
                raise _too_many(element, where, MAX_CELLS, "cells of height fields")
        if element.tag == "texture" and element.get("builtin"):
            sides = 1 if element.get("type") == "2d" else 6
            texels += sides * _product(element, "width", "height")
            if texels > MAX_TEXELS:
                raise _too_many(element, where, MAX_TEXELS, "pixels of textures")


def _require_sizes(element: Element, where: str) -> None:
    for attribute in SIZES.keys() & set(element.keys()):
        limit = SIZES[attribute]
        if max(_numbers(element, attribute), default=0.0) > limit:
            raise _beyond(element, where, attribute, limit)
    if element.tag == "user" and max(_numbers(element, "dim"), default=0.0) > 1_000:
        raise _beyond(element, where, "dim", 1_000)
    if element.tag == "size" and _bytes(element.get("memory") or "") > MAX_MEMORY:
        raise _beyond(element, where, "memory", f"{MAX_MEMORY >> 20}M")


def _require_own_plugin(element: Element, where: str) -> None:
    plugin = element.get("plugin")
    if plugin is not None and not plugin.startswith(_BUILT_IN):
        raise InputError(
            f"{where}: {label(element)} needs the plugin '{plugin[:60]}', which is code of its own; "
            f"only MuJoCo's own ('{_BUILT_IN}…') are used: take it out"
        )


def _too_many(element: Element, where: str, limit: int, what: str) -> InputError:
    return InputError(
        f"{where}: with {label(element)} the scene has more than {limit} {what}, larger than is "
        "built; use fewer"
    )


def _beyond(element: Element, where: str, attribute: str, limit: object) -> InputError:
    value = (element.get(attribute) or "")[:40]
    return InputError(
        f'{where}: {label(element)}: {attribute}="{value}" is larger than is built; at most {limit}'
    )


def _numbers(element: Element, attribute: str) -> Sequence[float]:
    """The numbers of an attribute; what is none is left to MuJoCo to complain of."""
    found: list[float] = []
    for part in tokens(element.get(attribute)):
        try:
            number = abs(float(part))
        except ValueError:
            continue
        found.append(inf if number != number else number)
    return found


def _product(element: Element, *attributes: str) -> float:
    return prod(max([0.0, *_numbers(element, attribute)]) for attribute in attributes)


def _bytes(size: str) -> float:
    """A number with MuJoCo's suffix for kilo- to exabytes (powers of 1024)."""
    found = re.fullmatch(r"\s*([\d.eE+]+)\s*([a-zA-Z]?)\s*", size)
    if found is None:
        return 0.0
    try:
        return float(found.group(1)) * _UNITS.get(found.group(2).lower(), inf)
    except ValueError:
        return 0.0
