"""Symbols derived from the scene's geometry; `poses.yaml` takes precedence.

Objects are the points of their geoms in the world, and surfaces those of their carrier geom. Seen from
above, a grasp is a strip of the object between the fingers. A temporary pose is a spot of the surface
with room for object and hand. An approach is a spot for the closed fingers:

        +----------------------- surface ------------------------+
        |    o approach: hand clear of everything                |
        |                              +------+                  |
        |    [bottle]  temporary ----> |bottle| + hand, with     |
        |    grasp: fingers in y       +------+ room around it   |
        +--------------------------------------------------------+
                           arm (base)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from palpate.common.errors import unknown_name
from palpate.common.outline import Convex, Obstacle, above, rectangle, rim
from palpate.common.pose import Array, Pose, PoseLine
from palpate.mjcf.body import Body
from palpate.mjcf.shapes import RESTING
from palpate.robots.description import RobotDescription
from palpate.robots.grasp import Grasp, derive_grasp, turned_grasp
from palpate.robots.pace import configuration
from palpate.scene.handle_grasps import (
    RETREAT,
    Geometry,
    fixtures_without_grasp,
    handle_grasp,
    middle,
    points_down,
)
from palpate.scene.places import APPROACH, GUESSED, approach_pose, free_spot
from palpate.scene.poses import Poses
from palpate.scene.resolve import ResolvedScene
from palpate.scene.symbols import (
    DEFAULT_OFFSETS,
    Symbols,
    configurations,
    given_offsets,
    in_hand,
    in_world,
    vectors,
)

LIFT = (0.10, 0.35)  # m, bounds of a derived `z_offset`
USUAL_LIFT = RETREAT  # m, default of a derived `z_offset`; neighbours may require a larger one
# m, half width of the corridor from the arm to an object, in which a lift clears neighbours.
CORRIDOR = 0.15
LEVEL_TOP = 0.001  # m, depth below an object's highest point down to which points belong to its top
CLEAR = 0.02  # m, clearance between a carried object's bottom and the top of a neighbour


def derive_symbols(
    resolved: ResolvedScene, bodies: Mapping[str, Body], base: Pose, arm: RobotDescription
) -> Symbols:
    """All symbols of a scene, from poses.yaml and from geometry."""
    geometry = Geometry.of(resolved, bodies, base, arm)
    entries = resolved.poses
    grasps = {name: _grasp(geometry, name) for name in geometry.objects}
    described = resolved.description.bodies
    handles = {
        name: _handle_grasp(geometry, name, bool(described[name].named_handle))
        for name in geometry.handles
    }
    poses = _poses(geometry, grasps | handles, entries)
    later = _later(geometry, poses)
    # Offsets of an object: derived ones, then common ones, then its own of poses.yaml.
    common, special = given_offsets(entries)
    for name in special:
        if name not in grasps | handles:
            raise unknown_name("object in offsets", name, grasps | handles)
    own: dict[str, dict[str, Array]] = {}
    for name, grasp in grasps.items():
        derived = _own_offsets(geometry, name, grasp, poses[f"{name}_pose"])
        own[name] = derived | common | special.get(name, {})
    for name in geometry.handles:
        lift = {"z_offset": _lift(geometry, geometry.handles[name], poses[f"{name}_pose"], name)}
        own[name] = vectors(DEFAULT_OFFSETS) | lift | common | special.get(name, {})
    lines = _lines(geometry, poses, own)
    # Names of poses with the body that they belong to.
    subjects: dict[str, str] = {}
    for name in geometry.objects:
        for kind in ("pose", "temporary", "top", "across", "balance"):
            subjects[f"{name}_{kind}"] = name
    subjects |= {f"{name}_approach": name for name in geometry.tops}
    subjects |= {f"{name}_pose": name for name in geometry.handles}
    names = {*poses, *later, *lines}
    return Symbols(
        poses=poses,
        subjects={name: subject for name, subject in subjects.items() if name in names},
        later=later,
        lines=lines,
        configurations=fronts(geometry, poses, own) | configurations(entries, arm.home),
        handles=frozenset(f"{name}_pose" for name in geometry.handles),
        offsets=vectors(DEFAULT_OFFSETS) | common,
        own_offsets=own,
        ungraspable=_ungraspable(geometry, grasps | handles, entries)
        | fixtures_without_grasp(described, handles, entries.grasps),
    )


def _poses(geometry: Geometry, grasps: Mapping[str, Grasp], entries: Poses) -> dict[str, Pose]:
    """Poses of grasps and approaches; entries of poses.yaml replace derived ones."""
    poses = {f"{name}_pose": grasp.pose for name, grasp in grasps.items()}
    # Grasps of poses.yaml are in the object's frame, places in the world.
    for name, entry in entries.grasps.items():
        poses[f"{name}_pose"] = geometry.bodies[name].pose_world @ entry.tool_pose()
    for name in geometry.tops:
        # A surface of unknown height is approached from farther above.
        is_guessed = "height" in geometry.bodies[name].missing
        approach = approach_pose(
            geometry.arm,
            top=geometry.tops[name],
            others=geometry.others(name),
            objects=geometry.on(name),
            clear=APPROACH + (GUESSED if is_guessed else 0.0),
            base=geometry.base,
        )
        if approach is not None:
            poses[f"{name}_approach"] = approach
    for name, entry in entries.places.items():
        poses[name] = entry.tool_pose()
    return poses


def _later(geometry: Geometry, poses: Mapping[str, Pose]) -> dict[str, Callable[[], Pose | None]]:
    """Functions that compute poses on demand: temporary ones, poses above objects, and grasps turned by 90°.
    Poses in poses.yaml are left out."""
    later: dict[str, Callable[[], Pose | None]] = {}
    for name in geometry.objects:
        pose = poses[f"{name}_pose"]
        later[f"{name}_temporary"] = partial(free_place, geometry, name, poses)
        later[f"{name}_top"] = partial(above_top, geometry, name, pose)
        later[f"{name}_across"] = partial(grasp_across, geometry, name, pose)
    return {name: find for name, find in later.items() if name not in poses}


def fronts(
    geometry: Geometry, poses: Mapping[str, Pose], offsets: Mapping[str, Mapping[str, Array]]
) -> dict[str, Array]:
    """Joint configurations (7,), rad, in front of the handles that a level hand grasps."""
    points: dict[str, Array] = {}
    for name in geometry.handles:
        if not points_down(pose := poses[f"{name}_pose"]):
            # The configuration is at the retreat, not at the handle.
            back = pose.translate(in_hand(pose, offsets[name]["z_offset"]))
            # Joint configurations (7,), rad, on the way of a level hand to a pose in front of a
            # fixture.
            front = configuration(geometry.arm, geometry.base.inverse() @ back)
            points |= {
                f"{name}_level": np.array([*geometry.arm.home[:5], *front[5:]]),
                f"{name}_front": front,
            }
    return points


def _lines(
    geometry: Geometry, poses: Mapping[str, Pose], offsets: Mapping[str, Mapping[str, Array]]
) -> dict[str, PoseLine]:
    """Segments of possible balance points about the grasps of objects."""
    # They reach to twice the x_offset on both sides. Shorter ones than the pads are left out, and
    # so are balance poses that poses.yaml gives.
    lines: dict[str, PoseLine] = {}
    for name in geometry.objects:
        pose, body = poses[f"{name}_pose"], geometry.bodies[name]
        # The balance point may be anywhere within two x_offsets of the grasp, along the tool's x.
        half = in_world(pose, 2.0 * offsets[name]["x_offset"] * [1.0, 1.0, 0.0])
        if f"{name}_balance" in poses or np.linalg.norm(half) < geometry.arm.hand.pad:
            continue
        centre = np.array(body.known.get("com", body.centre))
        lines[f"{name}_balance"] = PoseLine.spanning(pose, half, body.pose_world.apply(centre))
    return lines


def above_top(geometry: Geometry, name: str, pose_world_tcp: Pose) -> Pose:
    """TCP pose above the middle of an object's top, with the yaw of its grasp."""
    cloud = geometry.clouds[name]
    # Middle of the points at the object's top, seen from above.
    highest = float(cloud[:, 2].max())
    part = cloud[cloud[:, 2] > highest - LEVEL_TOP]
    return Pose.of((*middle(part), highest + APPROACH), pose_world_tcp.quaternion)


def grasp_across(geometry: Geometry, name: str, pose_world_tcp: Pose) -> Pose | None:
    """The grasp of an object turned by 90°; None if it does not fit the hand."""
    others = geometry.others(name, geometry.support(name))
    grasp = turned_grasp(
        geometry.arm, geometry.objects[name], others, pose_world_tcp, geometry.base
    )
    return None if grasp.problem else grasp.pose


def _ungraspable(geometry: Geometry, grasps: Mapping[str, Grasp], entries: Poses) -> dict[str, str]:
    """Objects that the hand cannot grasp, with the reason."""
    reasons: dict[str, str] = {}
    for name, grasp in grasps.items():
        if grasp.problem and name not in entries.grasps:
            reasons[name] = grasp.problem
    for name in geometry.objects:
        if "position" in geometry.bodies[name].missing and name not in entries.objects:
            reasons[name] = "its pose is unknown; give it in poses.yaml"
    return reasons


def free_place(geometry: Geometry, name: str, poses: Mapping[str, Pose]) -> Pose | None:
    """TCP pose with the grasped object on a free spot of its surface; None without one.

    The object is grasped at its pose of `poses`. An object on top of another one is put down on the
    surface first.
    """
    # Two outlines move together. That of object and hand must be clear of all obstacles above the
    # object's bottom, its current place included. The object's box must be on the surface.
    support, pose_world_tcp = geometry.support(name), poses[f"{name}_pose"]
    if support is None:
        return None
    cloud = geometry.clouds[name]
    centre = np.array(middle(cloud))
    x, y = geometry.arm.hand.half_extents
    hand = rectangle(pose_world_tcp.position[:2], pose_world_tcp.rotation[:2, 0], x, y / 2)
    shape = rim(np.concatenate([cloud[:, :2], hand])) - centre
    # Bounding box of the object seen from above: it must be on the surface.
    footing = np.array([cloud.min(axis=0)[:2], cloud.max(axis=0)[:2]]) - centre
    # An object on top of another one goes down to the surface itself.
    stacked = float(cloud[:, 2].min() - geometry.tops[support][:, 2].max())
    drop = stacked if stacked > RESTING else 0.0
    bottom = float(cloud[:, 2].min()) - drop
    others = [*geometry.others(name, support), *_put_down_before(geometry, name, poses)]
    obstacles = above([*others, Obstacle.of(cloud)], bottom + 0.002)
    place = free_spot(
        geometry.arm.reach,
        shape=shape,
        footing=footing,
        top=geometry.tops[support],
        obstacles=obstacles,
        near=centre,
        z=bottom,
        base=geometry.base,
    )
    if place is None:
        return None
    spot, _ = place
    return pose_world_tcp.translate((*(spot - centre), -drop))


def _put_down_before(
    geometry: Geometry, name: str, poses: Mapping[str, Pose]
) -> Iterator[Obstacle]:
    """Yield the objects on an object, at their temporary poses: they are moved away first."""
    # An object is on another one if its middle is inside, and its bottom at the top.
    low, high = geometry.clouds[name].min(axis=0), geometry.clouds[name].max(axis=0)
    for other, cloud in geometry.clouds.items():
        centre = np.array(middle(cloud))
        is_inside = bool(((centre > low[:2]) & (centre < high[:2])).all())
        if other == name or not is_inside or cloud[:, 2].min() < high[2] - RESTING:
            continue
        place = free_place(geometry, other, poses)
        if place is not None:
            yield Obstacle.of(cloud + place.position - poses[f"{other}_pose"].position)


def _grasp(geometry: Geometry, name: str) -> Grasp:
    """The grasp among the neighbours; without one, the grasp with all other objects moved away."""
    # Yaw of the object: heading of the most horizontal axis of its frame.
    rotation = geometry.bodies[name].pose_world.rotation
    level = int(np.argmax(np.hypot(rotation[0], rotation[1])))
    yaw = float(np.arctan2(rotation[1, level], rotation[0, level]))
    support = geometry.support(name)
    geoms, covariance = geometry.objects[name], geometry.bodies[name].covariance
    spread = None if covariance is None else covariance[:2, :2]
    for cleared in ((name, support), (name, support, *geometry.objects)):
        others = geometry.others(*cleared)
        grasp = derive_grasp(geometry.arm, geoms, others, yaw, geometry.base, spread)
        if not grasp.problem:
            break
    return grasp


def _handle_grasp(geometry: Geometry, name: str, is_named: bool) -> Grasp:
    joint, handle = geometry.bodies[name].joint, geometry.handles[name]
    assert joint is not None
    around = [points for owner, points in geometry.solids if owner != name]
    return handle_grasp(geometry.arm, joint, handle, around, geometry.base, is_named)


def _own_offsets(geometry: Geometry, name: str, grasp: Grasp, pose: Pose) -> dict[str, Array]:
    """Offsets (3,), m, of an object."""
    # Along x it is half of the grasp's slack beyond the pads, along y a quarter of the width. Along
    # z it is a lift that clears the neighbours.
    # At least 5 mm, even if the grasp has no slack.
    x = max((grasp.slack - geometry.arm.hand.pad) / 2, 0.005)
    y = max(grasp.width / 4, 0.005)
    return {
        "x_offset": np.array([x, 0, 0]),
        "y_offset": np.array([0, y, 0]),
        "z_offset": _lift(geometry, geometry.objects[name], pose, name),
    }


def _lift(geometry: Geometry, geoms: Sequence[Convex], pose: Pose, name: str) -> Array:
    """Upward lift (3,), m, of a body with `geoms` that clears its neighbours; a level hand's retreat."""
    lift, bottom = USUAL_LIFT, min(float(geom.points[:, 2].min()) for geom in geoms)
    # Only neighbours in the corridor to the arm are in the way of a carried object.
    for other in geometry.others(name) if points_down(pose) else ():
        if _on_the_way(other.outline, pose, geometry.base):
            lift = max(lift, other.top + CLEAR - bottom)
    return np.array([0.0, 0.0, float(np.clip(lift, *LIFT))])


def _on_the_way(outline: Array, pose: Pose, base: Pose) -> bool:
    """True if an outline is within the corridor from the arm's front to the object."""
    start = base.position[:2] + 0.3 * base.rotation[:2, 0]
    path = pose.position[:2] - start
    low, high = outline.min(axis=0), outline.max(axis=0)
    # Distance of the outline's box from the point of the path nearest to its middle.
    share = np.clip(((low + high) / 2 - start) @ path / max(float(path @ path), 1e-9), 0, 1)
    nearest = start + share * path
    gap = np.maximum(np.maximum(low - nearest, nearest - high), 0)
    return bool(np.linalg.norm(gap) < CORRIDOR)
