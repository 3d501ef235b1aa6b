"""What is believed of missing quantities before they are measured, and hidden truths drawn around
it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from palpate.geometry.pose import Array
from palpate.mjcf.document import UNKNOWN, has_unknown, tokens
from palpate.mjcf.roles import ObjectEntry, SurfaceEntry
from palpate.mjcf.shapes import RESTING, box_around, standing_point
from palpate.parameter import Parameter
from palpate.scene.fill import Filler
from palpate.scene.poses import Poses

if TYPE_CHECKING:
    pass

PRIOR_DENSITY = 500.0
"""kg/m³: between hollow household things and wood."""
PRIOR_MASS = (0.02, 1.5)
"""kg: bounds of the prior."""
PRIOR_FRICTION = 0.5
PRIOR_HEIGHT = 0.4
"""m, of a surface on which nothing stands."""
PRIOR_POSITION = (0.5, 0.0)
"""m, of an object whose place nobody gave."""


APPROACH = 0.10
"""m: how far above a surface its approach pose has the TCP."""


def derive_priors(
    filler: Filler, poses: Poses, given_z: Mapping[str, float]
) -> dict[Parameter, tuple[float, ...]]:
    """What is believed of every missing quantity. `given_z` is the world z that poses.yaml gives
    where D has `?`."""
    priors: dict[Parameter, tuple[float, ...]] = {}
    for surface in filler.found.surfaces.values():
        if surface.missing:
            priors[Parameter(surface.name, "height")] = (
                _prior_height(filler, surface, poses, given_z),
            )
    for thing in filler.found.objects.values():
        priors |= {
            Parameter(thing.name, quantity): value
            for quantity, value in _prior_values(filler, thing, poses)
        }
    return priors


def _prior_height(
    filler: Filler, surface: SurfaceEntry, poses: Poses, given_z: Mapping[str, float]
) -> float:
    if surface.name in given_z and "body" in surface.unknown | (
        {"body"} if surface.element.tag == "geom" else set()
    ):
        return filler.top_z(surface) + given_z[surface.name]
    known_tops = [(s, filler.top_z(s)) for s in filler.found.surfaces.values() if not s.missing]
    bottoms = [
        point[2]
        for point in _above(filler, surface)
        if not any(
            abs(point[2] - top) < RESTING and filler.covers(s, point) for s, top in known_tops
        )
    ]
    if bottoms:
        return float(min(bottoms))
    approach = poses.places.get(f"{surface.name}_approach")
    return approach.pos[2] - APPROACH if approach is not None else PRIOR_HEIGHT


def _above(filler: Filler, surface: SurfaceEntry) -> Iterator[Array]:
    """The standing points of objects with a known z over a surface."""
    for thing in filler.found.objects.values():
        point = standing_point(filler.shapes, thing)
        if thing.name in filler.given_z:
            point[2] += filler.given_z[thing.name]
        elif has_unknown(thing.element, "pos", 2):
            continue
        if filler.covers(surface, point):
            yield point


def _prior_values(
    filler: Filler, thing: ObjectEntry, poses: Poses
) -> Iterator[tuple[str, tuple[float, ...]]]:
    volume = sum(filler.shapes.volume(geom) for geom in thing.colliding)
    mass = float(np.clip(volume * PRIOR_DENSITY, *PRIOR_MASS))
    if "mass" in thing.missing:
        yield "mass", (mass,)
    if "friction" in thing.missing:
        yield "friction", (PRIOR_FRICTION,)
    com = filler.com(thing)
    if "com" in thing.missing:
        com = _prior_com(filler, thing)
        yield "com", com
    if "inertia" in thing.missing:
        own = mass if "mass" in thing.missing else filler.mass(thing)
        yield "inertia", filler.inertia_values(thing, own, np.array(com))
    if "position" in thing.missing:
        entry = poses.objects.get(thing.name)
        given = entry.pos if entry is not None else PRIOR_POSITION
        stated = tokens(thing.element.get("pos"))
        x, y = (given[i] if stated[i] == UNKNOWN or entry else float(stated[i]) for i in (0, 1))
        yield "position", (x, y)


def _prior_com(filler: Filler, thing: ObjectEntry) -> tuple[float, ...]:
    """The middle of the geoms, except for the numbers that are stated."""
    assert thing.inertial is not None
    centre, _ = box_around(
        filler.shapes.body_pose(thing.name), filler.shapes.cloud(thing.colliding)
    )
    stated = tokens(thing.inertial.get("pos")) or [UNKNOWN] * 3
    return tuple(
        float(c) if part == UNKNOWN else float(part) for c, part in zip(centre, stated, strict=True)
    )
