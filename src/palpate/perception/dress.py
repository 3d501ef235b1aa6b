"""Visual shapes of bodies for pictures: the looks in `assets`, and the meshes of MuJoCo Menagerie."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from palpate.common.errors import unknown_name
from palpate.common.pose import Array
from palpate.perception import prints
from palpate.perception.prints import ASSETS
from palpate.perception.renderer import CORNERS, SCENERY, Pixels, geom_rgba
from palpate.robots.description import PREFIX

WORD = "look:"  # Prefix of the `<text>` element with a body's look
HIDDEN, SHOWN = 3, 2  # Geom groups of hidden collision shapes and of visible shapes

Looks = Mapping[str, str]  # Looks by body name

# Look of supports, and its mesh below the top. The look is fitted to the largest shape alone, the
# table top without legs.
TABLE, FRAME = "table", "table_frame"
SHORTEST = 0.15  # m. Height below which a table is drawn without its frame.
# Ratio of the sides, from which on a look is turned so that its longer side is the box's.
LONGER = 1.001
# Prefix of materials in the body's own colour, material of a content, class of round looks.
OWN, CONTENT, ROUND = "own_", "content", "round"
# Textures that are drawn with the words of a look and the colour of the body.
PRINTS: Mapping[str, Callable[[str, prints.Ink], Pixels]] = {
    "label": prints.label,
    "carton": prints.carton,
    "sign": prints.sign,
    "paper_sign": lambda words, _: prints.sign(words, prints.PAPER),
}


@dataclass(frozen=True, slots=True, eq=False)
class LookBox:
    """Box for a look around a body's shapes, in the body frame."""

    centre: Array  # (3,) m
    half: Array  # (3,) half extents, m
    colour: Array  # (3,) red, green and blue of the largest shape, 0 to 1
    drop: float = 0.0  # distance from the lower face of the box to the floor, m


@cache
def look_catalogue() -> Any:
    """Load the looks as an `MjSpec`: one body each, which reaches from -1 to 1 along each axis."""
    # The stubs of MuJoCo 4.0 lack most attributes of materials and textures.
    return mujoco.MjSpec.from_file(str(ASSETS / "looks.xml"))


def looks_in(spec: mujoco.MjSpec) -> dict[str, str]:
    """Return the looks that a scene states for its bodies."""
    texts: list[mujoco.MjsText] = list(spec.texts)
    return {text.name.removeprefix(WORD): text.data for text in texts if text.name.startswith(WORD)}


def dress(spec: mujoco.MjSpec, looks: Looks) -> None:
    """Add the visual shapes of `looks` to the named bodies of `spec`, in place."""
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
        # Hide the collision shapes and add those of the look.
        geoms: list[mujoco.MjsGeom] = list(here[name].geoms)
        for geom in geoms:
            geom.group = HIDDEN
        _add_look(spec, here[name], look, fit)


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
    drop = max(0.0, above + float(low[2]))
    return LookBox((low + high) / 2, (high - low) / 2, geom_rgba(model, largest)[:3], drop)


def _add_look(spec: mujoco.MjSpec, body: mujoco.MjsBody, look: str, fit: LookBox) -> None:
    """Add the meshes of a look to a body.

    `look` is its name, optionally followed by a space and the text on it or its content.
    """
    kind, _, words = look.partition(" ")
    looks, words = look_catalogue(), words.strip()
    found = looks.body(kind)
    if found is None or kind == looks.worldbody.name:
        raise unknown_name("look", kind, [body.name for body in looks.worldbody.bodies])
    # The longer side of the look is that of the box. Round looks keep the ratio of their sides.
    turned = fit.half[1] > LONGER * fit.half[0]
    x, y, z = fit.half[[1, 0, 2]] if turned else fit.half
    quat = np.array([1.0, 0.0, 0.0, 1.0 if turned else 0.0])
    if found.childclass == ROUND:
        x = y = min(x, y)
    shapes: list[mujoco.MjsGeom] = list(found.geoms)
    for number, geom in enumerate(shapes):
        name = f"{WORD}{body.name}:{number}"
        material = _paint(spec, name, looks, geom.material, words, fit.colour)
        scale, place = [x, y, z], fit.centre
        if geom.meshname == FRAME:
            scale, place = [x, y, fit.drop], fit.centre - [0, 0, z]
        if material is not None and not (geom.meshname == FRAME and fit.drop < SHORTEST):
            _copy_mesh(spec, name, looks, geom.meshname, scale)
            _add_visual(body, name, name, material, place, quat)


def _paint(
    spec: mujoco.MjSpec, name: str, looks: Any, material: str, words: str, colour: Array
) -> str | None:
    """Copy a material of the looks; return its name, or None if the words leave nothing to paint."""
    # A content is chosen by the words, and a sign without words is left out.
    source = looks.material(f"{CONTENT}_{words}" if material == CONTENT else material)
    texture = "" if source is None else source.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB]
    if source is None or (texture.endswith("sign") and not words):
        return None
    rgba = np.array(source.rgba)
    if material.startswith(OWN):
        rgba[:3] *= colour
    painted = spec.add_material(
        name=name, rgba=rgba, specular=source.specular, shininess=source.shininess
    )
    if texture in PRINTS:
        red, green, blue = (round(255 * value) for value in colour.tolist())
        add_texture(spec, painted, PRINTS[texture](words, (red, green, blue)))
    elif texture:
        add_texture(spec, painted, prints.picture(texture))
    return name


def add_texture(spec: mujoco.MjSpec, material: mujoco.MjsMaterial, pixels: Pixels) -> None:
    """Add a texture with the material's name to a material."""
    texture = spec.add_texture(name=material.name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.height, texture.width, texture.nchannel = pixels.shape
    texture.data = np.ascontiguousarray(pixels).tobytes()
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = material.name


def _copy_mesh(
    spec: mujoco.MjSpec, name: str, source: Any, mesh: str, scale: Sequence[float] = (1.0, 1.0, 1.0)
) -> None:
    """Add a mesh of another model under a new name, enlarged by `scale` along each axis."""
    copied, theirs = spec.add_mesh(name=name), source.mesh(mesh)
    copied.file = str(Path(source.modelfiledir) / source.meshdir / theirs.file)
    copied.scale = theirs.scale * scale
    copied.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def _add_visual(
    body: mujoco.MjsBody, name: str, mesh: str, material: str, pos: Array, quat: Array
) -> None:
    """Add a mesh to a body as a visible shape without mass and collisions."""
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=mesh,
        material=material,
        pos=pos,
        quat=quat,
        group=SHOWN,
        **SCENERY,
    )


# Meshes of MuJoCo Menagerie for an arm in pictures, if they are installed.


log = logging.getLogger(__name__)

PANDA, IIWA = "franka_emika_panda", "kuka_iiwa_14"
FILES = {PANDA: "panda.xml", IIWA: "iiwa14.xml"}
SAME = 1e-3  # m, and quaternion components. Maximum difference between body frames of the same arm.
MARK = "menagerie:"  # Prefix of the names of added meshes and materials

HAND = ("hand", "left_finger", "right_finger")
# Menagerie model and body name of each of our bodies. A Research 3 has the links of a Panda; the
# hand is the same on all arms.
BODIES = {
    **{f"{arm}_link{i}": (PANDA, f"link{i}") for arm in ("fr3", "panda") for i in range(8)},
    "iiwa_link0": (IIWA, "base"),
    **{f"iiwa_link{i}": (IIWA, f"link{i}") for i in range(1, 8)},
    **{arm + part: (PANDA, part) for arm in ("", "iiwa_") for part in HAND},
}


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
    # Several geoms share a mesh and a material: add each once.
    name = f"{MARK}{source.modelname}:{geom.meshname}"
    if spec.mesh(name) is None:
        _copy_mesh(spec, name, source, geom.meshname)
    material = source.material(geom.material)
    rgba = geom.rgba if material is None else material.rgba
    paint = MARK + ",".join(f"{part:.3f}" for part in rgba)
    if spec.material(paint) is None:
        spec.add_material(name=paint, rgba=rgba, specular=0.35, shininess=0.5)
    _add_visual(body, "", name, paint, geom.pos, geom.quat)


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
