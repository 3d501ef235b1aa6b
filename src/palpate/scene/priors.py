"""What is believed of missing quantities before they are measured, and hidden truths drawn around it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from palpate.pose import Array, Pose
from palpate.quantities import Gap
from palpate.scene.fill import Filler
from palpate.scene.gap import ObjectEntry, SurfaceEntry
from palpate.scene.mjcf import UNKNOWN, has_unknown, tokens
from palpate.scene.poses import Poses
from palpate.scene.shapes import Shapes

if TYPE_CHECKING:
    from palpate.scene.scene import Scene

PRIOR_DENSITY = 500.0
"""kg/m³: between hollow household things and wood."""
PRIOR_MASS = (0.02, 1.5)
"""kg: bounds of the prior."""
PRIOR_FRICTION = 0.5
PRIOR_HEIGHT = 0.4
"""m, of a surface on which nothing stands."""
PRIOR_POSITION = (0.5, 0.0)
"""m, of an object whose place nobody gave."""

TRUE_FRICTION = (0.25, 0.7)
"""Range in which a hidden friction is drawn."""

TRUE_SHIFT = 0.003
"""m: how far a hidden position is from the believed one, per axis."""

APPROACH = 0.10
"""m: how far above a surface its approach pose has the TCP."""

RESTING = 0.02
"""m: an object whose bottom is this close to a top stands on it."""

def draw_truth(scene: Scene, seed: int) -> dict[Gap, tuple[float, ...]]:
    """Values for everything missing, for a hidden world made from D itself; the same for the same seed.

    Masses within a factor of two of the prior, friction in `TRUE_FRICTION`. A surface is a little lower than
    believed where things stand on it (they must not start inside it), else up to 3 cm off; a position up to
    `TRUE_SHIFT` off; a centre of mass up to a tenth of the object's size off.
    """
    random = np.random.default_rng(seed)
    return {gap: _drawn(scene, gap, random) for gap in scene.missing()}


def _drawn(scene: Scene, gap: Gap, random: np.random.Generator) -> tuple[float, ...]:
    prior = np.array(scene.priors[gap])
    if gap.quantity == "mass":
        return (float(np.clip(prior[0] * 2 ** random.uniform(-1, 1), *PRIOR_MASS)),)
    if gap.quantity == "friction":
        return (float(random.uniform(*TRUE_FRICTION)),)
    if gap.quantity == "height":
        return (float(prior[0] + _height_error(scene, gap.object, random)),)
    if gap.quantity in ("com", "position"):
        scale = 0.1 * scene.body(gap.object).size if gap.quantity == "com" else np.full(2, TRUE_SHIFT)
        shift = random.uniform(-scale, scale) * _open_numbers(scene, gap)
        return tuple(float(v) for v in prior + shift)
    return scene.priors[gap]


def _open_numbers(scene: Scene, gap: Gap) -> Array:
    """1 for each number of a `pos` that is `?`, 0 for those that are stated."""
    thing = scene.source.found.objects[gap.object]
    element = thing.inertial if gap.quantity == "com" else thing.element
    count = len(scene.priors[gap])
    stated = tokens(element.get("pos") if element is not None else None) or [UNKNOWN] * count
    return np.array([float(part == UNKNOWN) for part in stated[:count]])


def _height_error(scene: Scene, surface: str, random: np.random.Generator) -> float:
    top = scene.body(surface)
    used = any(top.covers(float(o.pose_world.position[0]), float(o.pose_world.position[1]))
               and abs(o.bottom_z() - top.top_z()) < RESTING for o in scene.objects.values())
    return float(random.uniform(-0.003, 0.0) if used else random.uniform(-0.03, 0.03))


def derive_priors(filler: Filler, poses: Poses, given_z: Mapping[str, float]) -> dict[Gap, tuple[float, ...]]:
    """What is believed of every missing quantity. `given_z` is the world z that poses.yaml gives where D has `?`."""
    priors: dict[Gap, tuple[float, ...]] = {}
    for surface in filler.found.surfaces.values():
        if surface.missing:
            priors[Gap(surface.name, "height")] = (_prior_height(filler, surface, poses, given_z),)
    for thing in filler.found.objects.values():
        priors |= {Gap(thing.name, quantity): value for quantity, value in _prior_values(filler, thing, poses)}
    return priors


def _prior_height(filler: Filler, surface: SurfaceEntry, poses: Poses, given_z: Mapping[str, float]) -> float:
    if surface.name in given_z and "body" in surface.unknown | ({"body"} if surface.element.tag == "geom" else set()):
        return filler.top_z(surface) + given_z[surface.name]
    known_tops = [(s, filler.top_z(s)) for s in filler.found.surfaces.values() if not s.missing]
    bottoms = [point[2] for point in _above(filler, surface)
               if not any(abs(point[2] - top) < RESTING and filler.covers(s, point) for s, top in known_tops)]
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


def _prior_values(filler: Filler, thing: ObjectEntry, poses: Poses) -> Iterator[tuple[str, tuple[float, ...]]]:
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
    centre, _ = box_around(filler.shapes.body_pose(thing.name), filler.shapes.cloud(thing.colliding))
    stated = tokens(thing.inertial.get("pos")) or [UNKNOWN] * 3
    return tuple(float(c) if part == UNKNOWN else float(part) for c, part in zip(centre, stated, strict=True))


def standing_point(shapes: Shapes, thing: ObjectEntry) -> Array:
    """(3,) the middle of the bottom of the box around an object, world, m."""
    cloud = shapes.cloud(thing.colliding)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    return np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])


def box_around(pose: Pose, cloud: Array) -> tuple[Array, Array]:
    """Centre and size of the box around world points, in the frame `pose`."""
    local = (cloud - pose.position) @ pose.rotation
    low, high = local.min(axis=0), local.max(axis=0)
    return (low + high) / 2, high - low
