"""A scene from a file or from text."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from palpate.geometry.pose import Pose
from palpate.mjcf.document import Document, parse_document, read_text
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.robots.description import RobotDescription
    from palpate.scene.poses import Poses


def load_scene(path: Path, poses: Path | None = None, arm: RobotDescription | None = None) -> Scene:
    """Read an MJCF file, and optionally `poses.yaml`; `arm` is what touches it, None the default.

    Raises:
        InputError: malformed XML, entities, missing or escaping files, names that do not match.
    """
    from palpate.scene.poses import read_poses

    path = Path(path)
    text = read_text(path)
    document = parse_document(text, path.resolve().parent, str(path))
    entries = read_poses(Path(poses)) if poses is not None else None
    return _scene(document, path, entries, arm)


def parse_scene(
    text: str,
    folder: Path | None = None,
    poses: str | Poses | None = None,
    arm: RobotDescription | None = None,
) -> Scene:
    """As `load_scene`, from text; `folder` is where relative file names start, `poses` YAML or read
    already.

    Raises:
        InputError: as `load_scene`.
    """
    from palpate.scene.poses import parse_poses

    entries = parse_poses(poses) if isinstance(poses, str) else poses
    return _scene(parse_document(text, folder), None, entries, arm)


def scene_from_text(text: str, like: Scene) -> Scene:
    """Another version of a scene's MJCF (its twin), with the same folder, poses and arm.

    Raises:
        InputError: as `load_scene`.
    """
    document = parse_document(text, like.source.document.folder)
    return _scene(document, like.path, like.source.poses, like.arm)


def rearranged(scene: Scene, poses: Mapping[str, Pose]) -> Scene:
    """The scene with some objects standing elsewhere: `poses` are of their body frames in the
    world."""
    from palpate.scene.poses import PoseEntry

    now = {
        name: PoseEntry.model_validate(
            {"pos": pose.position.tolist(), "quat": pose.quaternion.tolist()}
        )
        for name, pose in poses.items()
    }
    known = scene.source.poses
    document = parse_document(scene.text, scene.source.document.folder)
    entries = known.model_copy(update={"objects": {**known.objects, **now}})
    return _scene(document, scene.path, entries, scene.arm)


def _scene(
    document: Document,
    path: Path | None,
    poses: Poses | None,
    arm: RobotDescription | None,
) -> Scene:
    from palpate.robots.registry import load_description
    from palpate.scene.named_poses import derive_symbols
    from palpate.scene.poses import Poses
    from palpate.scene.resolve import resolve

    resolved = resolve(document, poses or Poses())
    bodies = {body.name: body for body in resolved.bodies()}
    base = resolved.shapes.base()
    arm = arm or load_description()
    return Scene(
        text=document.text,
        path=path,
        bodies=MappingProxyType(bodies),
        symbols=derive_symbols(resolved, bodies, base, arm),
        arm=arm,
        pose_world_base=base,
        gravity=float(np.linalg.norm(resolved.shapes.model.opt.gravity)),
        priors=MappingProxyType(resolved.priors),
        source=resolved.source,
    )
