"""Support of an object: its carriers, its support polygon seen from above, and its stability.

Upper faces at the height of an object's lower face carry it. The hull of the supported parts of the
lower face is the support polygon. The object is stable if its centre of mass is over that polygon.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from palpate.common.errors import InputError
from palpate.common.outline import Convex, clip_polygon, depth, hull, rim, slab
from palpate.common.pose import Array, Pose, digits
from palpate.mjcf.contacts import SAME_TOP
from palpate.primitives.rules.arrangement import Arrangement, arrangement
from palpate.primitives.rules.solids import Solids, solids
from palpate.primitives.state import SymbolicState, Violation

# m, largest height difference, in either sense, at which an upper face carries an object.
SETTLES = 0.005
FACE = 0.002  # m above an object's lowest point up to which its lower face reaches
# m. An upper face this far above an object's lowest point still counts as below it. Believed
# heights have errors of this size.
SUNK = 0.02
LIFTED = 0.005  # m between a held object and its support above which it hangs free
TIPPING = 0.005  # m that a centre of mass must be inside the support polygon
# Fraction of an object's extent by which an unstated centre of mass may be off the middle. It holds
# in both senses, and is the prior of `quantities.com`.
OFF_CENTRE = 0.1
EDGE = 0.003  # m between an object of unknown centre of mass and the edge of its carriers
AS_FOUND = 0.003  # m, position error up to which an object counts as back at its given pose
UPRIGHT = np.radians(2.0)  # rad that an object may lean
CYLINDER = mujoco.mjtGeom.mjGEOM_CYLINDER
# Shapes that roll unless they stand on a flat end
ROLLING = {
    CYLINDER,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}
MIN_SLIDE = 0.03  # m: a shorter slide is not much more than the grip's and the arm's compliance


@dataclass(frozen=True, slots=True, eq=False)
class Top:
    """Upper face of a shape."""

    owner: str  # name of its body
    outline: Array  # (k, 2) m, corners, counterclockwise
    height: float  # world z of the face, m
    foot: float  # world z of the shape's lowest point, m
    # Sliding coefficient, `priority` and `condim` of the geom, which MuJoCo combines in a contact.
    friction: tuple[float, int, int]


@dataclass(frozen=True, eq=False)
class Footing:
    """An object at a pose, and the tops below it."""

    bottom: float  # world z of its lowest point, m
    # outline, face: (k, 2) corners of the whole object seen from above, and of its lower face
    outline: Array
    face: Array
    tops: tuple[Top, ...]  # tops under its outline, at any height below

    @cached_property
    def carriers(self) -> tuple[Top, ...]:
        """Tops at the height of its bottom."""
        return tuple(top for top in self.tops if abs(top.height - self.bottom) <= SETTLES)

    @property
    def owners(self) -> list[str]:
        """Bodies that carry it."""
        return list(dict.fromkeys(top.owner for top in self.carriers))

    @cached_property
    def support(self) -> Array:
        """(k, 2) corners of its support polygon; fewer than three where nothing carries it."""
        parts = [clip_polygon(self.face, top.outline) for top in self.carriers]
        return hull(np.concatenate([np.zeros((0, 2)), *parts]))

    @property
    def gap(self) -> float:
        """m down to the highest top below it; inf where there is none."""
        return self.bottom - max((top.height for top in self.tops), default=-np.inf)


def footing(state: SymbolicState, name: str, pose_world_object: Pose) -> Footing:
    """Footing of an object at a pose, among everything else that is not held."""
    key = ("footing", name, pose_world_object.digits, state.holding, *state.others(name))
    return solids(state.scene).get_or_compute(key, lambda: _footing(state, name, pose_world_object))


def sideways_resistance(state: SymbolicState, name: str) -> float:
    """Horizontal force, N, that a standing object resists: its believed friction times its weight.

    A ball, or a cylinder on its side, rolls and resists nothing.
    """
    shapes, pose = solids(state.scene), state.pose_of(name)
    parts = shapes.objects[name]
    kind = mujoco.mjtGeom(int(shapes.model.geom_type[parts.geoms[0]]))
    stands = abs(float((pose.rotation @ parts.rotations[0])[2, 2])) > np.cos(UPRIGHT)
    if len(parts.geoms) == 1 and kind in ROLLING and not (stands and kind == CYLINDER):
        return 0.0
    return support_friction(state, name) * shapes.mass(name) * state.scene.gravity


def support_friction(state: SymbolicState, name: str) -> float:
    """Believed sliding friction between an object and its carriers; 0 without any."""
    shapes, below = solids(state.scene), footing(state, name, state.pose_of(name)).owners
    under = [geom for geom, owner in shapes.owners.items() if owner in below]
    return shapes.friction(shapes.objects[name].geoms, under)


def _footing(state: SymbolicState, name: str, pose: Pose) -> Footing:
    """Place the object's outline at the pose, and find the upper faces below it."""
    shapes, around = solids(state.scene), arrangement(state, {})
    # The footing at the origin is shared by all objects of the same shapes.
    like = shapes.alike[name]
    key = ("stand", like, digits(pose.quaternion))
    stand = shapes.get_or_compute(key, lambda: _stand(shapes, like, pose.quaternion))
    bottom = stand.bottom + float(pose.position[2])
    outline, face = stand.outline + pose.position[:2], stand.face + pose.position[:2]
    # Search the column below the outline, down to any depth.
    low, high = np.full((1, 3), -np.inf), np.full((1, 3), bottom + SUNK)
    low[0, :2], high[0, :2] = outline.min(axis=0), outline.max(axis=0)
    tops: list[Top] = []
    for i in np.flatnonzero(around.near(low, high)[0]).tolist():
        if around.parts[i].owner == name:
            continue
        top = _top(shapes, around, i)
        # Skip shapes that are wholly above the object's bottom.
        if top.height > bottom + SUNK and top.foot > bottom:
            continue
        if len(clip_polygon(outline, top.outline)) > 2:
            tops.append(top)
    return Footing(bottom, outline, face, tuple(tops))


def _stand(shapes: Solids, name: str, quaternion: Array) -> Footing:
    """Footing of an object whose frame is at the origin with a rotation, without tops below it."""
    pose = Pose(np.zeros(3), quaternion)
    parts: list[Convex] = []
    for geom, position, rotation in shapes.objects[name]:
        parts.append(shapes.convex(geom, pose.apply(position), pose.rotation @ rotation))
    points = np.concatenate([part.points for part in parts])
    bottom = float(points[:, 2].min())
    # The lower face is the hull of the points up to `FACE` above the lowest one.
    face = hull(np.concatenate([slab(part, bottom, bottom + FACE) for part in parts]))
    return Footing(bottom, hull(rim(points[:, :2])), face, ())


def _top(shapes: Solids, around: Arrangement, i: int) -> Top:
    """Upper face of a static shape: the hull of its points within `FACE` of its highest one."""
    part, there = around.parts[i], around.frames
    position, rotation = there.positions[0, i], there.rotations[0, i]

    def compute() -> Top:
        shape = shapes.convex(part.geom, position, rotation)
        foot, height = float(shape.points[:, 2].min()), float(shape.points[:, 2].max())
        model, geom = shapes.model, part.geom
        friction = (
            float(model.geom_friction[geom, 0]),
            int(model.geom_priority[geom]),
            int(model.geom_condim[geom]),
        )
        return Top(part.owner, hull(slab(shape, height - FACE, height)), height, foot, friction)

    key = ("top", part.geom, position.tobytes(), rotation.tobytes())
    return shapes.get_or_compute(key, compute)


def clear_of_support(state: SymbolicState, name: str, pose_world_object: Pose) -> bool:
    """True if an object at a pose hangs free of everything below it."""
    return footing(state, name, pose_world_object).gap > LIFTED


def met_early(state: SymbolicState, name: str, pose_world_object: Pose) -> float:
    """Height, m, above a pose (world) at which a lifted object meets its original support.

    An object that slipped in the pads, by at most `SUNK`, meets its support before the hand is at
    the pose. 0 if it would not be back at its original pose.
    """
    early = -footing(state, name, pose_world_object).gap
    if not SETTLES < early <= SUNK:
        return 0.0
    met = pose_world_object.translate((0.0, 0.0, early))
    return early if is_as_found(state, name, met) else 0.0


def stable(state: SymbolicState, name: str, pose_world_object: Pose) -> str | None:
    """Reason why an object released at a pose (world) would not stay there; None if it would.

    Its original pose is stable while its carriers are in place. Elsewhere it must be upright, with
    its centre of mass inside the support polygon by `TIPPING`. Where the file leaves the centre of
    mass to the shapes, it is the middle with its uncertainty. An unknown one may be anywhere: the
    object's whole outline must then be over its carriers.
    """
    if is_as_found(state, name, pose_world_object):
        return None
    lean = leaning(state, name, pose_world_object)
    if lean > UPRIGHT:
        return f"it would lean by {np.degrees(lean):.0f}° and tip over"
    there = footing(state, name, pose_world_object)
    if not there.carriers:
        if math.isinf(there.gap):
            return "no support is below it"
        if there.gap > 0:
            return f"it would fall by {there.gap:.3f} m"
        return f"it would be pressed {-there.gap:.3f} m into its support"
    # Stable for any centre of mass if each corner of the outline is inside some carrier.
    outlines = [top.outline for top in there.carriers]
    inside = (max(depth(outline, corner) for outline in outlines) for corner in there.outline)
    if all(edge >= EDGE for edge in inside) or _is_balanced(state, name, pose_world_object, there):
        return _tips_carrier(state, name, pose_world_object, there)
    carriers = " and ".join(f"'{owner}'" for owner in there.owners)
    return f"it would tip over the edge of {carriers}"


def leaning(state: SymbolicState, name: str, pose_world_object: Pose) -> float:
    """Angle, rad, between an object's vertical at a pose (world) and the one in the scene."""
    up = state.scene.body(name).pose_world.rotation[2]
    return float(np.arccos(np.clip(pose_world_object.rotation[2] @ up, -1.0, 1.0)))


def is_as_found(state: SymbolicState, name: str, pose: Pose) -> bool:
    """True if an object is at its pose in the scene, and so are all bodies that carry it there."""
    found = state.scene.body(name).pose_world
    if pose.distance_to(found) > AS_FOUND or pose.angle_to(found) > UPRIGHT:
        return False
    # A carrier in the hand, or moved elsewhere, no longer carries the object.
    for owner in footing(SymbolicState(state.scene), name, found).owners:
        if owner == state.holding:
            return False
        if owner in state.moved and not is_as_found(state, owner, state.moved[owner]):
            return False
    return True


def _is_balanced(state: SymbolicState, name: str, pose: Pose, there: Footing) -> bool:
    """True if an object's centre of mass, with its uncertainty, is over its support polygon."""
    body = state.scene.body(name)
    if "com" in body.known:
        return depth(there.support, pose.apply(body.known["com"])[:2]) >= TIPPING
    # Neither stated nor left to the shapes: the centre of mass is unknown.
    if "com" not in body.assumed:
        return False
    middle = pose.apply(solids(state.scene).centre_of_mass(name))
    # The middle may be off by a fraction of the largest horizontal extent.
    extent = np.abs(pose.rotation[:2]) @ body.size
    return depth(there.support, middle[:2]) >= TIPPING + float(OFF_CENTRE * extent.max())


def _tips_carrier(state: SymbolicState, name: str, pose: Pose, there: Footing) -> str | None:
    """Reason why a carrier that is an object may tip under an object at a pose (world); None if it cannot."""
    body, owners = state.scene.body(name), there.owners
    for owner in owners:
        # The load may act anywhere in the contact if other bodies carry a part, or the centre of mass is unknown.
        tops = [top.outline for top in there.carriers if top.owner == owner]
        loads = [point for top in tops for point in clip_polygon(there.face, top)]
        if len(owners) == 1 and ("com" in body.known or "com" in body.assumed):
            loads = [pose.apply(solids(state.scene).centre_of_mass(name))[:2]]
        if reason := _tips(state, owner, loads):
            return reason
    return None


def _tips(state: SymbolicState, carrier: str, loads: Sequence[Array]) -> str | None:
    """Reason why a carrier, or one below it, may tip under vertical loads at points (2,); None if it cannot.

    A load over the foot of an object tips it at no mass. Elsewhere the object's weight must balance the load, and a
    stated mass may be wrong.
    """
    if carrier not in state.scene.objects:
        return None
    foot = footing(state, carrier, state.pose_of(carrier))
    if any(depth(foot.support, load) < TIPPING for load in loads):
        return (
            f"'{carrier}' may tip under it: the load must act {1e3 * TIPPING:.0f} mm inside the foot of '{carrier}', "
            "where it tips at no mass"
        )
    return next((why for below in foot.owners if (why := _tips(state, below, loads))), None)


def slides(before: SymbolicState, after: SymbolicState) -> bool:
    """True if a motion from one state to the other drags the held object along its support."""
    if before.holding is None or before.lifted or after.lifted:
        return False
    travel = _travel(before, after)
    return float(np.linalg.norm(travel)) > LIFTED and float(travel[2]) >= -SUNK


def dragged_off(before: SymbolicState, after: SymbolicState) -> str | None:
    """Reason why a dragged object would not be stable at the end of a motion; None if stable or lifted."""
    held = before.holding
    if held is None or before.lifted or np.linalg.norm(_travel(before, after)) <= LIFTED:
        return None
    start, end = before.pose_of(held), after.pose_of(held)
    rise = float(end.position[2] - start.position[2])
    if rise > LIFTED:
        return None
    if rise < -SUNK:
        return f"'{after.at}' is {-1e3 * rise:.0f} mm lower than its support"
    return stable(before, held, end)


def surfaces_slid_on(before: SymbolicState, after: SymbolicState) -> list[str]:
    """Surfaces that carry the held object at the start, middle or end of a slide, as in `carriers`."""
    held = before.holding
    if held is None:
        return []
    start, end = before.pose_of(held), after.pose_of(held)
    half = start.translate((end.position - start.position) / 2)
    return carriers(before, held, (start, half, end))


def carriers(state: SymbolicState, name: str, poses: Iterable[Pose]) -> list[str]:
    """Bodies that carry an object at some of the poses (world), once for each friction of their shapes."""
    found: dict[tuple[object, ...], str] = {}
    for pose in poses:
        tops = footing(state, name, pose).carriers
        # Only the highest of the carrying faces bear load.
        highest = max((top.height for top in tops), default=0.0)
        for top in tops:
            if top.height > highest - SAME_TOP:
                found[top.owner, top.friction] = top.owner
    return list(found.values())


def _travel(before: SymbolicState, after: SymbolicState) -> Array:
    """(3,) m, displacement of the TCP; zero from or to an unknown pose."""
    start, end = before.pose_world_tcp, after.pose_world_tcp
    return np.zeros(3) if start is None or end is None else end.position - start.position


def would_fall(state: SymbolicState) -> list[Violation]:
    """Violation of opening the fingers: the held object would not stay."""
    if not state.holding:
        return []
    if state.lifted:
        problem = (
            f"'{state.holding}' is lifted and would fall; MovePose it onto its support first, "
            f"e.g. to '{state.grasp}'"
        )
        return [Violation("gripper-state", problem)]
    reason = stable(state, state.holding, state.pose_of(state.holding))
    if reason is None:
        return []
    problem = (
        f"'{state.holding}' would not stay where it is released: {reason}; MovePose it to its original "
        f"place, e.g. '{state.grasp}', or well inside a surface, before OpenGripper"
    )
    return [Violation("unsupported", problem)]


def above(state: SymbolicState, expression: str | None) -> str:
    """A pose expression plus one z_offset; anything else unchanged."""
    try:
        return str(state.scene.symbols.parse(expression or "").shift("z_offset", 1))
    except InputError:
        return f"{expression}"
