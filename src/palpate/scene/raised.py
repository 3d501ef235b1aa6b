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
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

GUESS = 0.055
"""m by which a surface of unknown height, and what stands on it, may be higher or lower than the scene
has it: the 50 mm that the documentation promises, and 5 mm for poses and for the touch itself."""
INSIDE = 0.001
"""m: what begins this far above the bottom of an object, within its height, stands on it or in it."""
BELOW = 0.05
"""m that a named place may be below the top of the surface that it belongs to."""

TEMPORARY = "_temporary"

PoseOf = Callable[[str], Pose]
"""World pose of the frame of an object or a surface."""


def learned(scene: Scene, parameter: Parameter, value: tuple[float, ...]) -> Scene:
    """The scene once a parameter has been measured: a surface is as high as its measured height, and
    what stands on it moves with it; a scene seen in a picture gets new shapes."""
    if parameter.quantity != "height" or parameter.object not in scene.surfaces:
        return scene
    if scene.refit is not None:
        return scene.refit(parameter.object, value[0])
    return raised(scene, parameter.object, value[0])


def moves(scene: Scene, parameter: Parameter) -> bool:
    """True if measuring a parameter moves a surface of the scene, and nothing else about it."""
    is_height = parameter.quantity == "height" and parameter.object in scene.surfaces
    return is_height and scene.refit is None


def as_measured(scene: Scene, trace: Trace) -> Scene:
    """The scene with its surfaces as high as the trace has measured them, for the estimates of what
    stands on them."""
    if scene.refit is not None:
        return scene
    heights = [Parameter(name, "height") for name in scene.surfaces]
    touched = [one for one in heights if trace.converted(one) is not None]
    found = [one for one in estimate_all(touched, trace, scene.bodies) if one.identified]
    return at_heights(scene, {one.parameter: tuple(one.values.tolist()) for one in found})


def beyond(scene: Scene, name: str) -> str | None:
    """Reason, with a remedy, why an object must not be touched in the raised scene: its surface is
    farther from its stated height than a guess may be; None if it may."""
    rise = scene.rises.get(name, 0.0)
    if abs(rise) <= GUESS:
        return None
    side, z = "higher" if rise > 0 else "lower", float(scene.body(name).pose_world.position[2])
    return (
        f"what '{name}' stands on was measured {1e3 * abs(rise):.0f} mm {side} than the scene has it, "
        f"more than the 50 mm by which a guess may be off; write z {z:.3f} for '{name}' and run again"
    )


def is_open(scene: Scene, surface: str | None) -> bool:
    """True for a surface whose height the scene does not state."""
    body = scene.surfaces.get(surface or "")
    return body is not None and "height" in body.missing


def at_heights(scene: Scene, values: Mapping[Parameter, tuple[float, ...]]) -> Scene:
    """The scene with the surfaces of which `values` has a height at that height, world z in m."""
    for parameter, value in values.items():
        if parameter.quantity == "height" and parameter.object in scene.surfaces:
            scene = raised(scene, parameter.object, value[0])
    return scene


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
    for other in sorted(scene.bodies.values(), key=lambda body: body.bottom_z(pose_of(body.name))):
        base = _support(scene, other, pose_of)
        if other.name in found or base is None or base.name not in found:
            continue
        direct = base.name == surface and other.role == "object"
        bottom = other.bottom_z(pose_of(other.name))
        found[other.name] = top - bottom if direct else found[base.name]
    return found


def level(scene: Scene, poses: Mapping[str, Pose]) -> dict[str, Pose]:
    """World poses of objects in the raised scene, as they would be in the given one."""

    def pose_of(name: str) -> Pose:
        return poses.get(name) or scene.bodies[name].pose_world

    found: dict[str, Pose] = {}
    for name, pose in poses.items():
        base = _support(scene, scene.bodies[name], pose_of)
        rise = 0.0 if base is None else scene.rises.get(base.name, 0.0)
        found[name] = pose.translated((0.0, 0.0, -rise))
    return found


def _support(scene: Scene, body: Body, pose_of: PoseOf) -> Body | None:
    """Support of a body: an object below it, else the surface below."""
    below = [base for base in scene.bodies.values() if _stands_on(body, base, pose_of)]
    carriers = [base for base in below if base.role == "object"] or below
    return max(carriers, key=lambda base: base.top_z(pose_of(base.name)), default=None)


def _stands_on(other: Body, base: Body, pose_of: PoseOf) -> bool:
    if other.name == base.name or (other.role, base.role) == ("surface", "object"):
        return False
    pose, below = pose_of(other.name), pose_of(base.name)
    x, y, _ = pose.apply(other.centre).tolist()
    bottom, top = other.bottom_z(pose), base.top_z(below)
    if not base.covers(x, y, below) or bottom < base.bottom_z(below) + INSIDE:
        return False
    # In a bowl or on a tray: it begins somewhere within the height of what carries it.
    return bottom < top + RESTING if base.role == "object" else abs(bottom - top) < RESTING


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
    """Named poses that belong to no object or surface, and free spots for objects, which may be on
    another surface, with m by which the surface below each rises."""
    for name, pose in scene.symbols.poses.items():
        if name in scene.symbols.subjects and not name.endswith(TEMPORARY):
            continue
        x, y, z = pose.position.tolist()
        below = [
            body
            for body in scene.surfaces.values()
            if body.covers(x, y) and body.top_z() < z + BELOW
        ]
        support = max(below, key=lambda body: body.top_z(), default=None)
        yield name, 0.0 if support is None else rises.get(support.name, 0.0)
