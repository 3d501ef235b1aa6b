"""Visual shapes of bodies for pictures, and the meshes of MuJoCo Menagerie."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from palpate.common.errors import unknown_name
from palpate.common.pose import Array
from palpate.perception import looks
from palpate.perception.meshes import LookBox, LookPart
from palpate.perception.renderer import CORNERS, SCENERY, Pixels, geom_rgba
from palpate.robots.description import PREFIX

WORD = "look:"
"""Prefix of the `<text>` element with a body's look."""
HIDDEN, SHOWN = 3, 2
"""Geom groups of hidden collision shapes and of visible shapes."""

Looks = Mapping[str, str]
"""Looks by body name."""

LOOKS: Mapping[str, Callable[[LookBox, str], list[LookPart]]] = {
    "ball": looks.ball,
    "block": looks.block,
    "board": looks.board,
    "bottle": looks.bottle,
    "bowl": looks.bowl,
    "candle": looks.candle,
    "carton": looks.carton,
    "cloth": looks.cloth,
    "cup": looks.cup,
    "hammer": looks.hammer,
    "mug": looks.mug,
    "open_box": looks.open_box,
    "shut_box": looks.shut,
    "soap": looks.soap,
    "table": looks.table,
    "thermometer": looks.thermometer,
    "tin": looks.tin,
}
TABLE = "table"
"""Look of supports. It is fitted to the largest shape alone, the table top without legs."""


def looks_in(spec: mujoco.MjSpec) -> dict[str, str]:
    """Return the looks that a scene states for its bodies."""
    texts: list[mujoco.MjsText] = list(spec.texts)
    return {text.name.removeprefix(WORD): text.data for text in texts if text.name.startswith(WORD)}


def parts_of(look: str, fit: LookBox) -> list[LookPart]:
    """Return the parts of a look in the body frame.

    `look` is its name, optionally followed by a space and the text on it or its content.

    Raises:
        InputError: unknown look; the message lists the valid ones.
    """
    name, _, words = look.partition(" ")
    if name not in LOOKS:
        raise unknown_name("look", name, LOOKS)
    parts = LOOKS[name](fit, words.strip())
    return [replace(part, mesh=part.mesh.moved(fit.centre)) for part in parts]


def dress(spec: mujoco.MjSpec, looks: Looks) -> None:
    """Add the visual shapes of `looks` to the named bodies of `spec`, in place.

    Raises:
        InputError: unknown look.
    """
    bodies: list[mujoco.MjsBody] = list(spec.bodies)
    here = {body.name: body for body in bodies if body.name != spec.worldbody.name}
    worn = {name: look for name, look in looks.items() if name in here}
    if not worn:
        return
    # Compile once to obtain the bounding boxes of the bodies.
    plain = spec.compile()
    data = mujoco.MjData(plain)
    mujoco.mj_kinematics(plain, data)
    for name, look in worn.items():
        fit = _fit(plain, data, name, look)
        if fit is None:
            continue
        # Hide the collision shapes and add the parts of the look.
        geoms: list[mujoco.MjsGeom] = list(here[name].geoms)
        for geom in geoms:
            geom.group = HIDDEN
        for number, part in enumerate(parts_of(look, fit)):
            _add(spec, here[name], f"{WORD}{name}:{number}", part)


def _fit(model: mujoco.MjModel, data: mujoco.MjData, name: str, look: str) -> LookBox | None:
    """Return the box for a body's look; None for a body without shapes."""
    body = model.body(name)
    geoms = range(int(body.geomadr[0]), int(body.geomadr[0] + body.geomnum[0]))
    if not geoms or geoms[0] < 0:
        return None
    # The largest shape gives the colour; a table is fitted to it alone.
    largest = max(geoms, key=lambda geom: float(np.prod(model.geom_aabb[geom, 3:])))
    if look.partition(" ")[0] == TABLE:
        geoms = [largest]
    # Bounding box of all shapes in the body frame.
    corners: list[Array] = []
    for geom in geoms:
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        local = model.geom_aabb[geom, :3] + CORNERS * model.geom_aabb[geom, 3:]
        corners.append(model.geom_pos[geom] + local @ turn.reshape(3, 3).T)
    points = np.concatenate(corners)
    low, high = points.min(axis=0), points.max(axis=0)
    # The floor is the lowest plane of the world; the drop is the height of the box above it.
    planes = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0)
    floor = model.geom_pos[planes, 2]
    above = float(data.body(name).xpos[2]) - float(floor.min()) if len(floor) else 0.0
    red, green, blue = (float(value) for value in geom_rgba(model, largest)[:3])
    drop = max(0.0, above + float(low[2]))
    return LookBox((low + high) / 2, (high - low) / 2, (red, green, blue), drop)


def _add(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, part: LookPart) -> None:
    """Add a part to a body as a mesh with a material."""
    mesh = spec.add_mesh(name=name)
    mesh.uservert = part.mesh.vertices.ravel()
    mesh.userface = corners = part.mesh.faces.ravel().tolist()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    material = spec.add_material(
        name=name,
        rgba=[*part.colour, 1.0 - part.see_through],
        specular=0.5 * part.shine,
        shininess=0.2 + 0.7 * part.shine,
    )
    if part.print is not None:
        # MuJoCo counts texture rows from the top, so flip v.
        mesh.usertexcoord = np.column_stack([part.mesh.uv[:, 0], 1 - part.mesh.uv[:, 1]]).ravel()
        mesh.userfacetexcoord = corners
        add_texture(spec, material, part.print)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=name,
        group=SHOWN,
        **SCENERY,
    )


def add_texture(spec: mujoco.MjSpec, material: mujoco.MjsMaterial, pixels: Pixels) -> None:
    """Add a texture with the material's name to a material."""
    texture = spec.add_texture(name=material.name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.height, texture.width, texture.nchannel = pixels.shape
    texture.data = np.ascontiguousarray(pixels).tobytes()
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = material.name


# Meshes of MuJoCo Menagerie for an arm in pictures, if they are installed.


log = logging.getLogger(__name__)

PANDA, IIWA = "franka_emika_panda", "kuka_iiwa_14"
FILES = {PANDA: "panda.xml", IIWA: "iiwa14.xml"}
SAME = 1e-3
"""m, and quaternion components. Maximum difference between body frames of the same arm."""
MARK = "menagerie:"
"""Prefix of the names of added meshes and materials."""

HAND = ("hand", "left_finger", "right_finger")
BODIES = {
    **{f"fr3_link{i}": (PANDA, f"link{i}") for i in range(8)},
    "iiwa_link0": (IIWA, "base"),
    **{f"iiwa_link{i}": (IIWA, f"link{i}") for i in range(1, 8)},
    **{arm + part: (PANDA, part) for arm in ("", "iiwa_") for part in HAND},
}
"""Menagerie model and body name of each of our bodies. A Research 3 has the links of a Panda; the
hand is the same on all arms.
"""


def shape_arm(spec: mujoco.MjSpec) -> None:
    """Replace the shapes of the arm in `spec` by its meshes, in place.

    A body keeps its own shapes if its mesh is not installed or belongs to another arm.
    """
    bodies: list[mujoco.MjsBody] = list(spec.bodies)
    for body in bodies:
        # Find the body of the same name in the menagerie, in the same frame.
        model, name = BODIES.get(body.name.removeprefix(PREFIX), ("", ""))
        source = _source(model) if model else None
        theirs = None if source is None else source.body(name)
        if source is None or theirs is None or not _same_frame(body, theirs):
            continue
        # Hide the own shapes and copy the visual meshes.
        own: list[mujoco.MjsGeom] = list(body.geoms)
        for geom in own:
            geom.group = HIDDEN
        meshes: list[mujoco.MjsGeom] = list(theirs.geoms)
        for geom in meshes:
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH and not (geom.contype or geom.conaffinity):
                _add_mesh(spec, body, source, geom)


def _same_frame(one: mujoco.MjsBody, other: mujoco.MjsBody) -> bool:
    """True if two bodies have the same pose in their parents."""
    # The poses of base and hand depend on the arm's description, so they are not compared.
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
    # Several geoms share a mesh and a material: add each once.
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
    """Return a model of the menagerie; None if it is not installed or not readable."""
    try:
        import mujoco_menagerie as menagerie  # pyright: ignore[reportMissingModuleSource]
    except ImportError:
        return None
    # Search the local cache only, without a download.
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
