"""Loading of a scene, and a scene with measured heights and places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.estimation.quantities.catalogue import Catalogue, catalogue
from palpate.estimation.quantities.estimators import estimate_all
from palpate.mjcf.body import Body
from palpate.mjcf.document import Document, Texts, read_text
from palpate.mjcf.reading import parse_document, reparse
from palpate.mjcf.shapes import RESTING
from palpate.robots.description import RobotDescription
from palpate.robots.owner import load_description
from palpate.scene.named_poses import derive_symbols
from palpate.scene.poses import ObjectEntry, Poses, parse_poses, read_poses
from palpate.scene.resolve import resolve
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

# m, largest error of the believed height of a surface of unknown height. It is the documented 50
# mm, plus 5 mm for poses and for the touch.
GUESS = 0.055
# m above an object's bottom from which a body within its height rests on it or in it.
INSIDE = 0.001
BELOW = 0.05  # m, largest depth of a named pose below the top of its surface
TEMPORARY = "_temporary"
Places = Mapping[str, Pose]  # World poses of the frames of all bodies, by name


def apply_measurement(scene: Scene, parameter: Parameter, value: tuple[float, ...]) -> Scene:
    """The scene after a measurement.

    A surface of measured height is moved, and all bodies on it with it. A scene from a picture is
    fitted again.
    """
    if parameter.quantity != "height" or parameter.object not in scene.surfaces:
        return scene
    if scene.refit is not None:
        return scene.refit(parameter.object, value[0])
    return raise_surface(scene, parameter.object, value[0])


def moves(scene: Scene, parameter: Parameter) -> bool:
    """True if measuring a parameter raises or lowers a surface without fitting the scene again."""
    is_height = parameter.quantity == "height" and parameter.object in scene.surfaces
    return is_height and scene.refit is None


def scene_with_measurements(scene: Scene, trace: Trace) -> Scene:
    """The scene with its surfaces at the heights measured in a trace, for estimates of the objects on them."""
    if scene.refit is not None:
        return scene
    # Only surfaces that a plan touched, and whose estimate is identified, are moved.
    heights = [Parameter(name, "height") for name in scene.surfaces]
    touched = [item for item in heights if trace.converted(item) is not None]
    estimates = [item for item in estimate_all(touched, trace, scene.bodies) if item.identified]
    return at_heights(scene, {item.parameter: tuple(item.values.tolist()) for item in estimates})


def untouchable_reason(scene: Scene, name: str) -> str | None:
    """Reason, with a remedy, not to touch an object whose surface is far from the guessed height; else None."""
    rise = scene.rises.get(name, 0.0)
    if abs(rise) <= GUESS:
        return None
    side, z = "higher" if rise > 0 else "lower", float(scene.body(name).pose_world.position[2])
    return (
        f"the support of '{name}' was measured {1e3 * abs(rise):.0f} mm {side} than in the scene, more than "
        f"the allowed 50 mm; write z {z:.3f} for '{name}' and run again"
    )


def is_open(scene: Scene, surface: str | None) -> bool:
    """True if the scene does not state the height of a surface."""
    body = scene.surfaces.get(surface or "")
    return body is not None and "height" in body.missing


def at_heights(scene: Scene, values: Mapping[Parameter, tuple[float, ...]]) -> Scene:
    """The scene with surfaces at the heights in `values`, world z in m."""
    for parameter, value in values.items():
        if parameter.quantity == "height" and parameter.object in scene.surfaces:
            scene = raise_surface(scene, parameter.object, value[0])
    return scene


def raise_surface(scene: Scene, surface: str, top: float) -> Scene:
    """The scene with the top of a surface at world z `top`, m, and the bodies on it moved with it."""
    rises = compute_rises(scene, surface, top, scene.body_poses)
    # Move the bodies, and the poses at rest to which they would tip.
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
    # Move the named poses with their bodies, or with the surface below them.
    places = dict(_places(scene, rises))

    def lift_pose(name: str, pose: Pose) -> Pose:
        of_subject = rises.get(scene.symbols.subjects.get(name, ""), 0.0)
        return pose.translate((0.0, 0.0, places.get(name, of_subject)))

    symbols = scene.symbols.map_poses(lift_pose)
    whole = dict(scene.rises)  # rises add up: a surface may be measured more than once
    for name, rise in rises.items():
        whole[name] = whole.get(name, 0.0) + rise
    return replace(
        scene,
        bodies=MappingProxyType(bodies),
        symbols=symbols,
        rises=MappingProxyType(whole),
        as_given=scene.as_given or scene,
    )


def correct_body(scene: Scene, name: str, step: Pose, covariance: Array | None = None) -> Scene:
    """The scene with a body and its named poses moved by `step` in the world.

    A given `covariance` (6, 6) replaces that of the body's pose. A temporary place stays, and only its
    height follows.
    """
    body = scene.bodies[name]
    # The body and its pose at rest move by the same step: x' = S x, T' = S T S⁻¹.
    placed = step @ body.pose_world
    corrected = replace(
        body,
        pose_world=placed,
        tipped=step @ body.tipped @ step.inverse(),
        covariance=body.covariance if covariance is None else covariance,
    )
    # Named poses of the body follow; its temporary place keeps x and y.
    rise = (0.0, 0.0, float(placed.position[2] - body.pose_world.position[2]))

    def to(symbol: str, pose: Pose) -> Pose:
        if scene.symbols.subjects.get(symbol) != name:
            return pose
        return pose.translate(rise) if symbol.endswith(TEMPORARY) else step @ pose

    return replace(
        scene,
        bodies=MappingProxyType({**scene.bodies, name: corrected}),
        symbols=scene.symbols.map_poses(to),
        as_given=scene.as_given or scene,
    )


def compute_rises(scene: Scene, surface: str, top: float, places: Places) -> dict[str, float]:
    """Rise, m, of a surface and of each body on it, with the surface's top moved to world z `top`, m.

    Bodies are at the poses `places`. The bottom of an object directly on the surface moves to
    `top`. An object stacked on another one keeps its place on it.
    """
    # The surface itself rises by the difference of its tops.
    rises = {surface: top - scene.bodies[surface].top_z(places[surface])}
    # In the order of their bottoms, so that a support is raised before the bodies on it.
    for other in sorted(scene.bodies.values(), key=lambda body: body.bottom_z(places[body.name])):
        base = _support(scene, other, places)
        if other.name in rises or base is None or base.name not in rises:
            continue
        direct = base.name == surface and other.role == "object"
        bottom = other.bottom_z(places[other.name])
        rises[other.name] = top - bottom if direct else rises[base.name]
    return rises


def lower_poses(scene: Scene, poses: Mapping[str, Pose]) -> dict[str, Pose]:
    """Convert world poses of objects in the raised scene to those in the scene as given."""
    places = {**scene.body_poses, **poses}
    # Subtract the rise of the support of each object.
    lowered: dict[str, Pose] = {}
    for name, pose in poses.items():
        base = _support(scene, scene.bodies[name], places)
        rise = 0.0 if base is None else scene.rises.get(base.name, 0.0)
        lowered[name] = pose.translate((0.0, 0.0, -rise))
    return lowered


def _support(scene: Scene, body: Body, places: Places) -> Body | None:
    """The highest object below and in contact with a body, else the highest such surface."""
    # An object carries before a surface: a stacked object rests on its neighbour.
    below = [base for base in scene.bodies.values() if _stands_on(body, base, places)]
    carriers = [base for base in below if base.role == "object"] or below
    return max(carriers, key=lambda base: base.top_z(places[base.name]), default=None)


def _stands_on(other: Body, base: Body, places: Places) -> bool:
    """True if a body rests on another one, by centre and heights; a surface rests on no object."""
    if other.name == base.name or (other.role, base.role) == ("surface", "object"):
        return False
    pose, below = places[other.name], places[base.name]
    # The centre must be over the base, and the bottom at its top.
    x, y, _ = pose.apply(other.centre).tolist()
    bottom, top = other.bottom_z(pose), base.top_z(below)
    if not base.covers(x, y, below) or bottom < base.bottom_z(below) + INSIDE:
        return False
    # In a bowl or on a tray, the bottom is within the height of the support.
    return bottom < top + RESTING if base.role == "object" else abs(bottom - top) < RESTING


def _places(scene: Scene, rises: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    """Yield poses with the rise, m, of the surface below each."""
    # They are named poses without an object or surface, and temporary poses, which may be on
    # another surface.
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


# Loading of a scene from a file or text.


# Catalogue of a simulated world: no quantity is unknown, so no prior is used.
NO_QUANTITIES = Catalogue(())


def load_scene(
    path: Path,
    poses: Path | None = None,
    arm: RobotDescription | None = None,
    quantities: Catalogue | None = None,
    root: Path | None = None,
    robot_body: Sequence[str] = (),
) -> Scene:
    """Read an MJCF file, and optionally `poses.yaml`.

    Args:
        arm: arm of the plans; None for the default.
        quantities: catalogue of quantities; by default all installed ones.
        root: no file outside this folder is read; by default the nearest common folder of the scene
            and its files.
        robot_body: root bodies of the scene's own robots, or `none`; by default they are found.

    Raises:
        InputError: malformed XML, entities, missing or escaping files, names that do not match.
    """
    # Relative file names start at the scene's folder.
    path = Path(path)
    text = read_text(path)
    document = parse_document(text, path.resolve().parent, str(path), root, robot_body)
    given = Poses() if poses is None else read_poses(Path(poses))
    return _scene(document, path, given, arm, quantities)


def parse_scene(
    text: str,
    folder: Path | None = None,
    poses: str | Poses | None = None,
    arm: RobotDescription | None = None,
    quantities: Catalogue | None = None,
    robot_body: Sequence[str] = (),
) -> Scene:
    """Read a scene from text, as in `load_scene`.

    Relative file names start at `folder`. `poses` are YAML or parsed.
    """
    document = parse_document(text, folder, robots=robot_body)
    given = parse_poses(poses) if isinstance(poses, str) else poses or Poses()
    return _scene(document, None, given, arm, quantities)


def as_world(scene: Scene) -> Scene:
    """The scene as a simulated world, exactly as MuJoCo compiles it.

    Values that it leaves out have MuJoCo's defaults; a `?` is an `InputError`.
    """
    if not scene.catalogue:
        return scene
    # Parse the text again: a description without unknowns needs no priors.
    resolved = scene.resolved
    document = reparse(Texts(scene.text), resolved.document)
    return _scene(document, scene.path, resolved.poses, scene.arm, NO_QUANTITIES)


def scene_from_text(
    text: str | Texts, like: Scene, elsewhere: Mapping[str, Pose] | None = None
) -> Scene:
    """Read another version of a scene's MJCF, e.g. its twin, with the same folder, poses and arm.

    `elsewhere` are new poses of body frames in the world.
    """
    texts = Texts(text) if isinstance(text, str) else text
    # Convert the poses into entries of poses.yaml, which take precedence over the file.
    objects: dict[str, ObjectEntry] = {}
    for name, pose in (elsewhere or {}).items():
        entry = {"pos": pose.position.tolist(), "quat": pose.quaternion.tolist()}
        objects[name] = ObjectEntry.model_validate(entry)
    return _reread(texts, like, objects)


def replace_objects(scene: Scene, objects: Mapping[str, ObjectEntry]) -> Scene:
    """The scene with these entries of `objects` in its poses.yaml; the rest of the file stays."""
    return _reread(Texts(scene.text), scene, objects)


def rearrange(scene: Scene, poses: Mapping[str, Pose]) -> Scene:
    """The scene with new `poses` of body frames in the world, and its measured heights."""
    # Read the scene at its given heights, then raise the surfaces to the measured ones.
    given = scene_from_text(scene.text, scene, lower_poses(scene, poses))
    for surface in [name for name in scene.rises if name in scene.surfaces]:
        given = raise_surface(given, surface, scene.body(surface).top_z())
    return given


def _reread(texts: Texts, like: Scene, objects: Mapping[str, ObjectEntry]) -> Scene:
    # Keep folder and robots of the document, and merge the new entries into its poses.
    document = reparse(texts, like.resolved.document)
    known = like.resolved.poses
    poses = known.model_copy(update={"objects": {**known.objects, **objects}})
    return _scene(document, like.path, poses, like.arm, like.catalogue)


def _scene(
    document: Document,
    path: Path | None,
    poses: Poses,
    arm: RobotDescription | None,
    quantities: Catalogue | None,
) -> Scene:
    # Resolve the unknowns first: named poses depend on the completed geometry.
    arm = arm or load_description()
    resolved = resolve(document, poses, catalogue() if quantities is None else quantities)
    bodies = resolved.bodies()
    base = resolved.shapes.base()
    return Scene(
        text=document.text,
        path=path,
        bodies=MappingProxyType(bodies),
        symbols=derive_symbols(resolved, bodies, base, arm),
        arm=arm,
        pose_world_base=base,
        gravity=float(np.linalg.norm(resolved.shapes.model.opt.gravity)),
        priors=MappingProxyType(resolved.means()),
        resolved=resolved,
    )
