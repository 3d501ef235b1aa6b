"""Visual shapes of bodies for pictures alone, added to a copy of the scene.

A scene says it in MJCF's own words, `<custom><text name="look:bottle" data="bottle WATER"/>`: the
body's name, a name from `looks.catalogue`, and what is written on it or what is in it. Collision
shapes, masses and everything that moves stay as they are, and a run without pictures knows nothing
of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np

from palpate.geometry.pose import Array
from palpate.pictures.looks.catalogue import parts_of
from palpate.pictures.looks.part import Colour, Fit, Part

WORD = "look:"
"""Prefix of the `<text>` that states a body's look."""
HIDDEN = 3
"""The group of shapes that are there for collisions, and not drawn."""
SHOWN = 2
"""And of those that are drawn."""

Looks = Mapping[str, str]
"""By the body's name."""


def looks_in(spec: mujoco.MjSpec) -> dict[str, str]:
    """Looks that a scene states for its bodies."""
    texts: list[mujoco.MjsText] = list(spec.texts)
    return {text.name.removeprefix(WORD): text.data for text in texts if text.name.startswith(WORD)}


def dress(spec: mujoco.MjSpec, looks: Looks) -> None:
    """Give the bodies of `spec` that `looks` names their shapes for pictures, in place.

    Raises:
        InputError: there is no such look.
    """
    here = {body.name: body for body in _bodies(spec)}
    worn = {name: look for name, look in looks.items() if name in here}
    if not worn:
        return
    plain = spec.compile()
    floor = _floor(plain)
    for name, look in worn.items():
        fit = _fit(plain, name, floor)
        if fit is None:
            continue
        for geom in _geoms(here[name]):
            geom.group = HIDDEN
        for number, part in enumerate(parts_of(look, fit)):
            _add(spec, here[name], f"look:{name}:{number}", part)


def _bodies(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    bodies: list[mujoco.MjsBody] = list(spec.bodies)
    return [body for body in bodies if body.name != spec.worldbody.name]


def _geoms(body: mujoco.MjsBody) -> list[mujoco.MjsGeom]:
    return list(body.geoms)


def _add(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, part: Part) -> None:
    """Add a surface in the body's own frame."""
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
        # MuJoCo counts a picture's rows from its head.
        mesh.usertexcoord = np.column_stack([part.mesh.uv[:, 0], 1 - part.mesh.uv[:, 1]]).ravel()
        mesh.userfacetexcoord = corners
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = _texture(spec, name, part.print)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=name,
        mass=0.0,
        contype=0,
        conaffinity=0,
        group=SHOWN,
    )


def _texture(spec: mujoco.MjSpec, name: str, pixels: np.ndarray) -> str:
    """The name of a texture of these pixels."""
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.height, texture.width, texture.nchannel = pixels.shape
    texture.data = np.ascontiguousarray(pixels).tobytes()
    return name


def _fit(model: mujoco.MjModel, name: str, floor: float | None) -> Fit | None:
    """Space for a look of the body; None for a body without shapes."""
    body = model.body(name)
    geoms = range(int(body.geomadr[0]), int(body.geomadr[0] + body.geomnum[0]))
    if not geoms or geoms[0] < 0:
        return None
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    above = 0.0 if floor is None else float(data.body(name).xpos[2]) - floor
    largest = max(geoms, key=lambda geom: float(np.prod(model.geom_aabb[geom, 3:])))
    colour = _colour(model, largest)
    main = _around([_corners(model, largest)], colour, above)
    return replace(_around([_corners(model, geom) for geom in geoms], colour, above), main=main)


def _around(corners: list[Array], colour: Colour, above: float) -> Fit:
    """The box around points, with the body's frame so far `above` the floor, m."""
    points = np.concatenate(corners)
    low, high = points.min(axis=0), points.max(axis=0)
    return Fit((low + high) / 2, (high - low) / 2, colour, max(0.0, above + float(low[2])))


def _corners(model: mujoco.MjModel, geom: int) -> Array:
    """(8, 3) of the box around a geom, in its body's frame."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    local = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    return model.geom_pos[geom] + local @ turn.reshape(3, 3).T


def _colour(model: mujoco.MjModel, geom: int) -> Colour:
    """A geom's own colour, or its material's."""
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return float(rgba[0]), float(rgba[1]), float(rgba[2])


def _floor(model: mujoco.MjModel) -> float | None:
    """World z of the lowest plane, m."""
    planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    heights = model.geom_pos[planes & (model.geom_bodyid == 0), 2]
    return float(heights.min()) if len(heights) else None
