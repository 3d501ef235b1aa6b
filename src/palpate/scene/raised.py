"""A scene raised to the measured heights of its surfaces, or with a thing where touch found it.

With a surface of unknown height move, by the same distance: objects on it, objects stacked on those,
and named poses that belong to them or are above it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body
from palpate.mjcf.shapes import RESTING
from palpate.parameter import Parameter
from palpate.quantities.estimators import estimate_all
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

GUESS = 0.055
"""m: largest error of the height of a surface of unknown height: the documented 50 mm, and 5 mm for
poses and for the touch."""
INSIDE = 0.001
"""m: a body within an object's height that begins this far above its bottom stands on or in it."""
BELOW = 0.05
"""m: largest depth of a named pose below the top of its surface."""

TEMPORARY = "_temporary"

PoseOf = Callable[[str], Pose]
"""World pose of the frame of a body, by name."""


def learned(scene: Scene, parameter: Parameter, value: tuple[float, ...]) -> Scene:
    """The scene after a measurement: a surface of measured height, and what stands on it, is moved; a
    scene from a picture is fitted again."""
    if parameter.quantity != "height" or parameter.object not in scene.surfaces:
        return scene
    if scene.refit is not None:
        return scene.refit(parameter.object, value[0])
    return raised(scene, parameter.object, value[0])


def moves(scene: Scene, parameter: Parameter) -> bool:
    """True if measuring a parameter raises or lowers a surface without fitting the scene again."""
    is_height = parameter.quantity == "height" and parameter.object in scene.surfaces
    return is_height and scene.refit is None


def as_measured(scene: Scene, trace: Trace) -> Scene:
    """The scene with its surfaces at the heights measured in a trace, for estimates of the objects on
    them."""
    if scene.refit is not None:
        return scene
    heights = [Parameter(name, "height") for name in scene.surfaces]
    touched = [one for one in heights if trace.converted(one) is not None]
    found = [one for one in estimate_all(touched, trace, scene.bodies) if one.identified]
    return at_heights(scene, {one.parameter: tuple(one.values.tolist()) for one in found})


def beyond(scene: Scene, name: str) -> str | None:
    """Reason, with a remedy, why an object must not be touched: its surface was measured too far from
    the guessed height; else None."""
    rise = scene.rises.get(name, 0.0)
    if abs(rise) <= GUESS:
        return None
    side, z = "higher" if rise > 0 else "lower", float(scene.body(name).pose_world.position[2])
    return (
        f"what '{name}' stands on was measured {1e3 * abs(rise):.0f} mm {side} than the scene has it, "
        f"more than the 50 mm by which a guess may be off; write z {z:.3f} for '{name}' and run again"
    )


def is_open(scene: Scene, surface: str | None) -> bool:
    """True if the scene does not state the height of a surface."""
    body = scene.surfaces.get(surface or "")
    return body is not None and "height" in body.missing


def at_heights(scene: Scene, values: Mapping[Parameter, tuple[float, ...]]) -> Scene:
    """The scene with surfaces at the heights in `values`, world z in m."""
    for parameter, value in values.items():
        if parameter.quantity == "height" and parameter.object in scene.surfaces:
            scene = raised(scene, parameter.object, value[0])
    return scene


def raised(scene: Scene, surface: str, top: float) -> Scene:
    """The scene with the top of a surface, and what stands on it, moved to world z `top`, m."""
    rises = risen(scene, surface, top, lambda name: scene.bodies[name].pose_world)
    bodies = dict(scene.bodies)
    for name, rise in rises.items():
        body, up = bodies[name], Pose.of((0.0, 0.0, rise))
        known = dict(body.known)
        if "height" in known:
            known["height"] = (known["height"][0] + rise,)
        bodies[name] = replace(
            body,
            pose_world=up @ body.pose_world,
            tipped=up @ body.tipped @ up.inverse(),
            known=known,
        )
    places = dict(_places(scene, rises))

    def lifted(name: str, pose: Pose) -> Pose:
        of_subject = rises.get(scene.symbols.subjects.get(name, ""), 0.0)
        return pose.translated((0.0, 0.0, places.get(name, of_subject)))

    symbols = scene.symbols.moved(lifted)
    whole = dict(scene.rises)  # a surface may be measured more than once
    for name, rise in rises.items():
        whole[name] = whole.get(name, 0.0) + rise
    return replace(
        scene,
        bodies=MappingProxyType(bodies),
        symbols=symbols,
        rises=MappingProxyType(whole),
        as_given=scene.as_given or scene,
    )


def corrected(scene: Scene, name: str, step: Pose, covariance: Array | None = None) -> Scene:
    """The scene with a body, and the named poses that belong to it, moved by `step` in the world, and as sure as a
    `covariance` (6, 6) says, if one is given. A place where it is put down meanwhile stays: only its height
    follows."""
    body = scene.bodies[name]
    there = step @ body.pose_world
    moved = replace(
        body,
        pose_world=there,
        tipped=step @ body.tipped @ step.inverse(),
        covariance=body.covariance if covariance is None else covariance,
    )
    rise = (0.0, 0.0, float(there.position[2] - body.pose_world.position[2]))

    def to(symbol: str, pose: Pose) -> Pose:
        if scene.symbols.subjects.get(symbol) != name:
            return pose
        return pose.translated(rise) if symbol.endswith(TEMPORARY) else step @ pose

    return replace(
        scene,
        bodies=MappingProxyType({**scene.bodies, name: moved}),
        symbols=scene.symbols.moved(to),
        as_given=scene.as_given or scene,
    )


def risen(scene: Scene, surface: str, top: float, pose_of: PoseOf) -> dict[str, float]:
    """Rise, m, of a surface whose top moves to world z `top`, m, and of each body on it, at the poses
    of `pose_of`. The bottom of an object directly on it moves to `top`; an object stacked on another
    keeps its place on it."""
    found = {surface: top - scene.bodies[surface].top_z(pose_of(surface))}
    # From the lowest bottom upwards: a support is raised before what stands on it.
    for other in sorted(scene.bodies.values(), key=lambda body: body.bottom_z(pose_of(body.name))):
        base = _support(scene, other, pose_of)
        if other.name in found or base is None or base.name not in found:
            continue
        direct = base.name == surface and other.role == "object"
        bottom = other.bottom_z(pose_of(other.name))
        found[other.name] = top - bottom if direct else found[base.name]
    return found


def level(scene: Scene, poses: Mapping[str, Pose]) -> dict[str, Pose]:
    """Convert world poses of objects in the raised scene to those in the scene as given."""

    def pose_of(name: str) -> Pose:
        return poses.get(name) or scene.bodies[name].pose_world

    found: dict[str, Pose] = {}
    for name, pose in poses.items():
        base = _support(scene, scene.bodies[name], pose_of)
        rise = 0.0 if base is None else scene.rises.get(base.name, 0.0)
        found[name] = pose.translated((0.0, 0.0, -rise))
    return found


def _support(scene: Scene, body: Body, pose_of: PoseOf) -> Body | None:
    """The highest object that a body stands on, else the highest surface."""
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
    # In a bowl or on a tray, the bottom is within the height of the support.
    return bottom < top + RESTING if base.role == "object" else abs(bottom - top) < RESTING


def _places(scene: Scene, rises: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    """Yield named poses without an object or surface, and temporary poses, which may be on another
    surface, with the rise of the surface below each, m."""
    for name, pose in scene.symbols.poses.items():
        if name in scene.symbols.subjects and not name.endswith(TEMPORARY):
            continue
        # A pose above a surface, or at most `BELOW` under its top, belongs to the highest such one.
        x, y, z = pose.position.tolist()
        below = [
            body
            for body in scene.surfaces.values()
            if body.covers(x, y) and body.top_z() < z + BELOW
        ]
        support = max(below, key=lambda body: body.top_z(), default=None)
        yield name, 0.0 if support is None else rises.get(support.name, 0.0)
