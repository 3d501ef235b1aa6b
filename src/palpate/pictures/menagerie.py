"""The proper shape of an arm: the meshes of MuJoCo Menagerie, where they are on this computer.

They are for pictures alone, on a copy of the scene; an arm moves and collides as its own description
says. Nothing is downloaded here: `pip install 'palpate[menagerie]'`, then
`mujoco-menagerie prefetch franka_emika_panda`, or MENAGERIE_ROOT at a checkout, brings them. Without, the arm
is drawn by its own simple shapes.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from palpate.robots.model import PREFIX

log = logging.getLogger(__name__)

PANDA, IIWA = "franka_emika_panda", "kuka_iiwa_14"
FILES = {PANDA: "panda.xml", IIWA: "iiwa14.xml"}
LINKS = 8
"""Of an arm, the base among them."""
SHOWN, HIDDEN = 2, 3
"""Groups of shapes that are drawn, and that are not."""
SAME = 1e-3
"""m, and of a quaternion's parts: frames that differ by more are those of another arm."""
MARK = "menagerie:"


def _bodies() -> dict[str, tuple[str, str]]:
    """By our name of a body, the model in which it has its shape, and its name there. A Research 3 has
    a Panda's links; the hand is the same on all of ours."""
    found = {f"fr3_link{i}": (PANDA, f"link{i}") for i in range(LINKS)}
    found |= {f"iiwa_link{i}": (IIWA, f"link{i}" if i else "base") for i in range(LINKS)}
    for ours in ("hand", "left_finger", "right_finger"):
        found[ours] = found[f"iiwa_{ours}"] = (PANDA, ours)
    return found


BODIES = _bodies()


def shape_arm(spec: mujoco.MjSpec) -> None:
    """Give the arm in `spec`, if there is one, its meshes, in place; leave it as it is where they are
    not to be had, or are of another arm."""
    for body in _of_an_arm(spec):
        model, name = BODIES[body.name.removeprefix(PREFIX)]
        source = _source(model)
        there = None if source is None else source.body(name)
        if source is None or there is None or not _alike(body, there):
            continue
        for geom in _geoms(body):
            geom.group = HIDDEN
        for geom in _geoms(there):
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH and not (geom.contype or geom.conaffinity):
                _draw(spec, body, source, geom)


def _of_an_arm(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    bodies: list[mujoco.MjsBody] = list(spec.bodies)
    return [body for body in bodies if body.name.removeprefix(PREFIX) in BODIES]


def _geoms(body: mujoco.MjsBody) -> list[mujoco.MjsGeom]:
    return list(body.geoms)


def _alike(one: mujoco.MjsBody, other: mujoco.MjsBody) -> bool:
    """True if two bodies have the same frame in their parents; a base stands anywhere, and a hand
    is mounted as its arm wants it."""
    if other.name in ("link0", "base", "hand"):
        return True
    apart = np.abs(np.array(one.pos) - other.pos).max()
    aligned = abs(float(_unit(one.quat) @ _unit(other.quat)))
    return bool(apart < SAME and aligned > 1 - SAME)


def _unit(quaternion: object) -> np.ndarray:
    values = np.asarray(quaternion, dtype=np.float64)
    return values / np.linalg.norm(values)


def _draw(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, source: mujoco.MjSpec, geom: mujoco.MjsGeom
) -> None:
    """Add a mesh of the source to a body, in its own colour."""
    mesh, material = source.mesh(geom.meshname), source.material(geom.material)
    assert mesh is not None
    named = f"{MARK}{source.modelname}:{geom.meshname}"
    if spec.mesh(named) is None:
        copied = spec.add_mesh(name=named)
        copied.file, copied.scale = str(_file(source, mesh)), mesh.scale
        copied.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=named,
        pos=geom.pos,
        quat=geom.quat,
        material=_paint(spec, geom.rgba if material is None else material.rgba),
        mass=0.0,
        contype=0,
        conaffinity=0,
        group=SHOWN,
    )


def _paint(spec: mujoco.MjSpec, rgba: Sequence[float] | np.ndarray) -> str:
    """The name of a material of a colour, which is that of paint."""
    named = MARK + ",".join(f"{part:.3f}" for part in rgba)
    if spec.material(named) is None:
        spec.add_material(name=named, rgba=rgba, specular=0.35, shininess=0.5)
    return named


def _file(source: mujoco.MjSpec, mesh: mujoco.MjsMesh) -> Path:
    return Path(source.modelfiledir) / source.meshdir / mesh.file


@cache
def _source(model: str) -> mujoco.MjSpec | None:
    """A model of the menagerie; None where it is not on this computer, or cannot be read."""
    folder = next(_folders(model), None)
    if folder is None:
        return None
    try:
        return mujoco.MjSpec.from_file(str(folder / FILES[model]))
    except (ValueError, OSError) as error:
        log.warning("the arm is drawn without meshes: %s", error)
        return None


def _folders(model: str) -> Iterator[Path]:
    """Folders in which the package keeps its models."""
    try:
        import mujoco_menagerie as menagerie  # pyright: ignore[reportMissingModuleSource]
    except ImportError:
        return
    kept, robot = menagerie.Cache(), menagerie.get(model)
    places = [kept.root / model] if kept.root else []
    if kept.is_cached(robot):
        places.append(kept.model_path(robot))
    for place in places:
        if (place / FILES[model]).is_file():
            yield place
