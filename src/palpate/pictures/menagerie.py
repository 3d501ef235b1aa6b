"""The meshes of MuJoCo Menagerie for an arm in pictures, where they are on this computer.

They are put on a copy of the scene; an arm moves and collides by its own description. Nothing is
downloaded here: `pip install 'palpate[menagerie]'`, then `mujoco-menagerie prefetch
franka_emika_panda`, or MENAGERIE_ROOT at a checkout, brings them. Without, the arm is drawn by its own
simple shapes.
"""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from palpate.pictures.dress import HIDDEN, SHOWN
from palpate.pictures.renderer import SCENERY
from palpate.robots.model import PREFIX

log = logging.getLogger(__name__)

PANDA, IIWA = "franka_emika_panda", "kuka_iiwa_14"
FILES = {PANDA: "panda.xml", IIWA: "iiwa14.xml"}
SAME = 1e-3
"""m, and of a quaternion's parts: frames that differ by more belong to another arm."""
MARK = "menagerie:"
"""Prefix of the names of added meshes and materials."""

HAND = ("hand", "left_finger", "right_finger")
BODIES = {
    **{f"fr3_link{i}": (PANDA, f"link{i}") for i in range(8)},
    "iiwa_link0": (IIWA, "base"),
    **{f"iiwa_link{i}": (IIWA, f"link{i}") for i in range(1, 8)},
    **{arm + part: (PANDA, part) for arm in ("", "iiwa_") for part in HAND},
}
"""By our name of a body, the model in which it has its shape, and its name there. A Research 3 has a
Panda's links; the hand is the same on all of ours."""


def shape_arm(spec: mujoco.MjSpec) -> None:
    """Give the arm in `spec`, if there is one, its meshes, in place; a body whose mesh is not installed,
    or belongs to another arm, keeps its own shapes."""
    bodies: list[mujoco.MjsBody] = list(spec.bodies)
    for body in bodies:
        model, name = BODIES.get(body.name.removeprefix(PREFIX), ("", ""))
        source = _source(model) if model else None
        theirs = None if source is None else source.body(name)
        if source is None or theirs is None or not _same_frame(body, theirs):
            continue
        own: list[mujoco.MjsGeom] = list(body.geoms)
        for geom in own:
            geom.group = HIDDEN
        meshes: list[mujoco.MjsGeom] = list(theirs.geoms)
        for geom in meshes:
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH and not (geom.contype or geom.conaffinity):
                _add_mesh(spec, body, source, geom)


def _same_frame(one: mujoco.MjsBody, other: mujoco.MjsBody) -> bool:
    """Test for the same pose in the parent body."""
    # A base may stand anywhere, and a hand is mounted by its arm's description.
    if other.name in ("link0", "base", "hand"):
        return True
    apart = np.abs(np.array(one.pos) - other.pos).max()
    quats = [np.asarray(body.quat, dtype=np.float64) for body in (one, other)]
    mine, theirs = (quat / np.linalg.norm(quat) for quat in quats)
    return bool(apart < SAME and abs(float(mine @ theirs)) > 1 - SAME)


def _add_mesh(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, source: mujoco.MjSpec, geom: mujoco.MjsGeom
) -> None:
    """Add a mesh of the source to a body, in its own colour."""
    mesh, material = source.mesh(geom.meshname), source.material(geom.material)
    assert mesh is not None
    name = f"{MARK}{source.modelname}:{geom.meshname}"
    if spec.mesh(name) is None:
        copied = spec.add_mesh(name=name)
        copied.file = str(Path(source.modelfiledir) / source.meshdir / mesh.file)
        copied.scale = mesh.scale
        copied.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    rgba = geom.rgba if material is None else material.rgba
    paint = MARK + ",".join(f"{part:.3f}" for part in rgba)
    if spec.material(paint) is None:
        spec.add_material(name=paint, rgba=rgba, specular=0.35, shininess=0.5)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        pos=geom.pos,
        quat=geom.quat,
        material=paint,
        group=SHOWN,
        **SCENERY,
    )


@cache
def _source(model: str) -> mujoco.MjSpec | None:
    """A model of the menagerie; None where it is not on this computer, or cannot be read."""
    try:
        import mujoco_menagerie as menagerie  # pyright: ignore[reportMissingModuleSource]
    except ImportError:
        return None
    kept, robot = menagerie.Cache(), menagerie.get(model)
    folders = [kept.root / model] if kept.root else []
    if kept.is_cached(robot):
        folders.append(kept.model_path(robot))
    for folder in folders:
        file = folder / FILES[model]
        if file.is_file():
            try:
                return mujoco.MjSpec.from_file(str(file))
            except (ValueError, OSError) as error:
                log.warning("the arm is drawn without meshes: %s", error)
                return None
    return None
