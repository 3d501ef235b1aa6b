"""Loading of a scene from a file or from text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from palpate.geometry.pose import Pose
from palpate.mjcf.document import Document, Texts, read_text
from palpate.mjcf.reading import parse_document, reparsed
from palpate.quantities.catalogue import Catalogue, catalogue
from palpate.robots.description import RobotDescription
from palpate.robots.registry import load_description
from palpate.scene.named.derive import derive_symbols
from palpate.scene.poses import ObjectEntry, Poses, parse_poses, read_poses
from palpate.scene.raised import level, raised
from palpate.scene.resolve import resolve
from palpate.scene.scene import Scene

NOTHING = Catalogue(())
"""Catalogue of a simulated world: nothing in it is unknown, so that no prior fills it."""


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
        quantities: all installed ones unless given.
        root: folder outside of which no file is read; by default the nearest common folder of the
            scene and its files.
        robot_body: root bodies of the scene's own robots, or `none`; by default they are found.

    Raises:
        InputError: malformed XML, entities, missing or escaping files, names that do not match.
    """
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
    """Read a scene as `load_scene`, from text; relative file names start at `folder`, `poses` are
    YAML or parsed.

    Raises:
        InputError: as `load_scene`.
    """
    document = parse_document(text, folder, robots=robot_body)
    given = parse_poses(poses) if isinstance(poses, str) else poses or Poses()
    return _scene(document, None, given, arm, quantities)


def as_world(scene: Scene) -> Scene:
    """The scene as a simulated world, exactly as MuJoCo compiles it: what it leaves out has MuJoCo's
    default, and nothing in it is unknown.

    Raises:
        InputError: a value is written `?`.
    """
    if not scene.catalogue:
        return scene
    resolved = scene.resolved
    document = reparsed(Texts(scene.text), resolved.document)
    return _scene(document, scene.path, resolved.poses, scene.arm, NOTHING)


def scene_from_text(
    text: str | Texts, like: Scene, elsewhere: Mapping[str, Pose] | None = None
) -> Scene:
    """Read another version of a scene's MJCF (its twin), with the same folder, poses and arm;
    `elsewhere` are new poses of body frames in the world.

    Raises:
        InputError: as `load_scene`.
    """
    texts = Texts(text) if isinstance(text, str) else text
    objects: dict[str, ObjectEntry] = {}
    for name, pose in (elsewhere or {}).items():
        entry = {"pos": pose.position.tolist(), "quat": pose.quaternion.tolist()}
        objects[name] = ObjectEntry.model_validate(entry)
    return _reread(texts, like, objects)


def replaced(scene: Scene, objects: Mapping[str, ObjectEntry]) -> Scene:
    """The scene with these entries of `objects` in its poses.yaml; the rest of the file stays.

    Raises:
        InputError: as `load_scene`.
    """
    return _reread(Texts(scene.text), scene, objects)


def rearranged(scene: Scene, poses: Mapping[str, Pose]) -> Scene:
    """The scene with new `poses` of body frames in the world; measured heights of its surfaces are
    kept."""
    given = scene_from_text(scene.text, scene, level(scene, poses))
    for surface in [name for name in scene.rises if name in scene.surfaces]:
        given = raised(given, surface, scene.body(surface).top_z())
    return given


def _reread(texts: Texts, like: Scene, objects: Mapping[str, ObjectEntry]) -> Scene:
    document = reparsed(texts, like.resolved.document)
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
