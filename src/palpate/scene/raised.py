"""A scene in which a surface is as high as it was measured, and what stands on it with it.

What stands on a surface of unknown height has a z that follows from it: objects, what is stacked on
them, and the named poses that belong to them or lie above them move by as much as the surface does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

from palpate.geometry.pose import Pose
from palpate.mjcf.body import Body
from palpate.mjcf.shapes import RESTING
from palpate.parameter import Parameter
from palpate.quantities.estimators import estimate_all
from palpate.scene.places import GUESSED
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

INSIDE = 0.001
"""m: what begins this far above the bottom of an object, within its height, stands on it or in it."""
PROBED = 0.002
"""Measured heights may be this much beyond the limit of a guess, m."""
BELOW = 0.05
"""m that a named place may be below the top of the surface that it belongs to."""

PoseOf = Callable[[str], Pose]
"""World pose of the frame of an object or a surface."""


def learned(scene: Scene, parameter: Parameter, value: tuple[float, ...]) -> Scene:
    """What is believed of the cell once a parameter has been measured: a surface of unknown height is
    as high as that, and what stands on it; a scene seen in a picture gets new shapes."""
    if parameter.quantity != "height" or not is_open(scene, parameter.object):
        return scene
    if scene.refit is not None:
        return scene.refit(parameter.object, value[0])
    return raised(scene, parameter.object, value[0])


def as_measured(scene: Scene, trace: Trace) -> Scene:
    """The scene with its surfaces as high as the touches of a trace tell, for what is estimated of the
    things that stand on them."""
    if scene.refit is not None:
        return scene
    open_ones = [Parameter(name, "height") for name in scene.surfaces if is_open(scene, name)]
    touched = [one for one in open_ones if trace.converted(one) is not None]
    for found in estimate_all(touched, trace, scene.bodies):
        if found.identified:
            scene = learned(scene, found.parameter, tuple(found.value.tolist()))
    return scene


def beyond_guess(scene: Scene, name: str) -> str | None:
    """Reason, with a remedy, not to approach an object whose surface was measured farther from its
    guessed height than motions keep clear; None where it was not."""
    rise = scene.rises.get(name, 0.0)
    if name not in scene.objects or abs(rise) <= GUESSED + PROBED:
        return None
    how = f"{1e3 * abs(rise):.0f} mm {'higher' if rise > 0 else 'lower'}"
    return (
        f"the surface below '{name}' is {how} than the z of '{name}' says, more than the "
        f"{1e3 * GUESSED:.0f} mm that a guess may be off: change that z by as much and run again"
    )


def is_open(scene: Scene, surface: str | None) -> bool:
    """True for a surface whose height the scene does not state."""
    body = scene.surfaces.get(surface or "")
    return body is not None and "height" in body.missing


def raised(scene: Scene, surface: str, top: float) -> Scene:
    """The scene with the top of a surface at world z `top`, m."""
    rises = risen(scene, surface, top, lambda name: scene.bodies[name].pose_world)
    bodies = dict(scene.bodies)
    for name, rise in rises.items():
        bodies[name] = _body(bodies[name], rise)
    symbols = scene.symbols.raised(rises, dict(_places(scene, rises)))
    whole = dict(scene.rises)
    for name, rise in rises.items():
        whole[name] = whole.get(name, 0.0) + rise
    return replace(
        scene,
        bodies=MappingProxyType(bodies),
        symbols=symbols,
        rises=MappingProxyType(whole),
        as_given=scene.as_given or scene,
    )


def risen(scene: Scene, surface: str, top: float, pose_of: PoseOf) -> dict[str, float]:
    """m by which a surface, and all that stands on it with the poses that `pose_of` says, rises where
    its top is at world z `top`, m.

    Objects right on it end at its top; what is stacked on them keeps its place on them.
    """
    found = {surface: top - scene.bodies[surface].top_z(pose_of(surface))}
    queue = [surface]
    while queue:
        base = scene.bodies[queue.pop(0)]
        for other in scene.bodies.values():
            if other.name in found or not _stands_on(other, base, pose_of):
                continue
            direct = base.name == surface and other.role == "object"
            bottom = other.bottom_z(pose_of(other.name))
            found[other.name] = top - bottom if direct else found[base.name]
            queue.append(other.name)
    return found


def level(scene: Scene, poses: Mapping[str, Pose]) -> dict[str, Pose]:
    """World poses of objects in the raised scene, as they would be in the scene as it was given."""
    found: dict[str, Pose] = {}
    for name, pose in poses.items():
        rises = [
            rise
            for surface, rise in scene.rises.items()
            if surface in scene.surfaces
            and _stands_on(
                scene.bodies[name],
                scene.bodies[surface],
                lambda other, name=name, pose=pose: (
                    pose if other == name else scene.bodies[other].pose_world
                ),
            )
        ]
        found[name] = pose.translated((0.0, 0.0, -max(rises, default=0.0, key=abs)))
    return found


def _stands_on(other: Body, base: Body, pose_of: PoseOf) -> bool:
    if other.name == base.name:
        return False
    pose, below = pose_of(other.name), pose_of(base.name)
    x, y, _ = pose.apply(other.centre).tolist()
    if not base.covers(x, y, below):
        return False
    bottom, top = other.bottom_z(pose), base.top_z(below)
    if base.role == "surface":
        return abs(bottom - top) < RESTING
    # In a bowl or on a tray: it begins somewhere within the height of what carries it.
    return base.bottom_z(below) + INSIDE < bottom < top + RESTING


def _body(body: Body, rise: float) -> Body:
    up = Pose.of((0.0, 0.0, rise))
    known = dict(body.known)
    if "height" in known:
        known["height"] = (known["height"][0] + rise,)
    return replace(
        body,
        pose_world=up @ body.pose_world,
        tipped=up @ body.tipped @ up.inverse(),
        known=known,
    )


def _places(scene: Scene, rises: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    """Named poses that belong to no object or surface, and m by which the surface below each rises."""
    for name, pose in scene.symbols.poses.items():
        if name in scene.symbols.subjects:
            continue
        x, y, z = pose.position.tolist()
        below = [
            body
            for body in scene.surfaces.values()
            if body.covers(x, y) and body.top_z() < z + BELOW
        ]
        support = max(below, key=lambda body: body.top_z(), default=None)
        if support is not None and support.name in rises:
            yield name, rises[support.name]
