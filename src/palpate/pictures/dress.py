"""Looks: visual shapes of bodies for pictures alone, added to a copy of the scene.

A scene states a look in MJCF, `<custom><text name="look:bottle" data="bottle WATER"/>`: the body's
name, a name of `LOOKS`, and the words on it or its content. Collision shapes, masses and joints stay as
they are, and a run without pictures does not use looks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import mujoco
import numpy as np

from palpate.errors import unknown_name
from palpate.geometry.pose import Array
from palpate.pictures.looks import boxes, things
from palpate.pictures.looks.mesh import Fit, Part
from palpate.pictures.renderer import CORNERS, SCENERY, Pixels, geom_rgba

WORD = "look:"
"""Prefix of the `<text>` that states a body's look."""
HIDDEN, SHOWN = 3, 2
"""Groups of shapes for collisions alone, and of those that are drawn."""

Looks = Mapping[str, str]
"""By the body's name."""

LOOKS: Mapping[str, Callable[[Fit, str], list[Part]]] = {
    "ball": things.ball,
    "block": boxes.block,
    "board": boxes.board,
    "bottle": things.bottle,
    "bowl": things.bowl,
    "candle": things.candle,
    "carton": boxes.carton,
    "cloth": things.cloth,
    "cup": things.cup,
    "hammer": things.hammer,
    "mug": things.mug,
    "open_box": boxes.open_box,
    "shut_box": boxes.shut,
    "soap": things.soap,
    "table": boxes.table,
    "thermometer": things.thermometer,
    "tin": things.tin,
}
TABLE = "table"
"""The look of supports. It is fitted to the largest shape alone: the top, without its legs."""


def looks_in(spec: mujoco.MjSpec) -> dict[str, str]:
    """Looks that a scene states for its bodies."""
    texts: list[mujoco.MjsText] = list(spec.texts)
    return {text.name.removeprefix(WORD): text.data for text in texts if text.name.startswith(WORD)}


def parts_of(look: str, fit: Fit) -> list[Part]:
    """The parts of a look in the body's frame: `look` is its name and, after a blank, the words on it
    or its content.

    Raises:
        InputError: unknown look; the message lists the valid ones.
    """
    name, _, words = look.partition(" ")
    if name not in LOOKS:
        raise unknown_name("look", name, LOOKS)
    parts = LOOKS[name](fit, words.strip())
    return [replace(part, mesh=part.mesh.moved(fit.centre)) for part in parts]


def dress(spec: mujoco.MjSpec, looks: Looks) -> None:
    """Give the bodies of `spec` that `looks` names their shapes for pictures, in place.

    Raises:
        InputError: unknown look.
    """
    bodies: list[mujoco.MjsBody] = list(spec.bodies)
    here = {body.name: body for body in bodies if body.name != spec.worldbody.name}
    worn = {name: look for name, look in looks.items() if name in here}
    if not worn:
        return
    plain = spec.compile()
    data = mujoco.MjData(plain)
    mujoco.mj_kinematics(plain, data)
    for name, look in worn.items():
        fit = _fit(plain, data, name, look)
        if fit is None:
            continue
        geoms: list[mujoco.MjsGeom] = list(here[name].geoms)
        for geom in geoms:
            geom.group = HIDDEN
        for number, part in enumerate(parts_of(look, fit)):
            _add(spec, here[name], f"{WORD}{name}:{number}", part)


def _fit(model: mujoco.MjModel, data: mujoco.MjData, name: str, look: str) -> Fit | None:
    """Box that a look of the body fills; None for a body without shapes."""
    body = model.body(name)
    geoms = range(int(body.geomadr[0]), int(body.geomadr[0] + body.geomnum[0]))
    if not geoms or geoms[0] < 0:
        return None
    largest = max(geoms, key=lambda geom: float(np.prod(model.geom_aabb[geom, 3:])))
    if look.partition(" ")[0] == TABLE:
        geoms = [largest]
    corners: list[Array] = []
    for geom in geoms:
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        local = model.geom_aabb[geom, :3] + CORNERS * model.geom_aabb[geom, 3:]
        corners.append(model.geom_pos[geom] + local @ turn.reshape(3, 3).T)
    points = np.concatenate(corners)
    low, high = points.min(axis=0), points.max(axis=0)
    # The floor is the lowest plane of the world.
    planes = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0)
    floor = model.geom_pos[planes, 2]
    above = float(data.body(name).xpos[2]) - float(floor.min()) if len(floor) else 0.0
    red, green, blue = (float(value) for value in geom_rgba(model, largest)[:3])
    drop = max(0.0, above + float(low[2]))
    return Fit((low + high) / 2, (high - low) / 2, (red, green, blue), drop)


def _add(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, part: Part) -> None:
    """Add a part to a body as a mesh with its material."""
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
        # MuJoCo counts a picture's rows from the top.
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
    """Give a material a texture with the same name."""
    texture = spec.add_texture(name=material.name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.height, texture.width, texture.nchannel = pixels.shape
    texture.data = np.ascontiguousarray(pixels).tobytes()
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = material.name
