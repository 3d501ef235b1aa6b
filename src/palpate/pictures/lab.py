"""The room around a workplace, and its light: so that a picture looks like a place, and nothing in it
is black or burnt out. Nothing here can be touched."""

from __future__ import annotations

import mujoco
import numpy as np

from palpate.geometry.pose import Array
from palpate.pictures.looks.prints import concrete

ROOM = "world"
"""The body whose look is the room."""
LAB = "lab"
FLOOR = "palpate_floor"
WALL_TINT, FLOOR_TINT = (0.86, 0.88, 0.89, 1.0), (0.74, 0.76, 0.78, 1.0)
BEHIND, BESIDE, BEYOND = -1.15, 1.75, 0.5
"""m: where the walls stand, behind the arm and to its left; and how far, at least, from any thing."""
HEIGHT, LENGTH = 3.0, 9.0
"""m: of the walls."""
PANEL, GAP = 1.1, 0.012
"""m: the width of a wall's panels, and of the joint between two."""
DOWN, AMBIENT, HEADLIGHT = 0.75, 0.36, 0.14
"""m from a table to the floor, where a scene has none; shares of light from everywhere, and from
where one looks."""

LAMPS = (
    ((0.50, -1.35, 2.35), 0.22),
    ((0.59, -1.27, 2.38), 0.22),
    ((0.44, -1.25, 2.32), 0.22),
)
"""m from the middle of the things, and brightness: one lamp as three beside each other, whose shadows
make one with a soft edge."""
INNER = 0.35
"""Share of the lamp's cone within which things cast shadows: the arm and what it works on stand in it,
and each gets more of the shadow map."""
WINDOW = ((0.4, 2.4, 1.6), (0.2, -0.9, -0.75), 0.20)
"""A window at the other side: from where, whereto, how bright. It casts no shadow."""


def furnish(spec: mujoco.MjSpec, things: Array, soft: bool = True) -> None:
    """Put the room around `things`, corners (n, 3) m of what stands in it, with a lamp, `soft` or
    single, and a window. The scene's own lights go."""
    low, high = things.min(axis=0), things.max(axis=0)
    floor = _floor(spec, float(low[2]))
    _walls(spec, floor, min(BEHIND, low[0] - BEYOND), max(BESIDE, high[1] + BEYOND))
    for light in _lights(spec):
        spec.delete(light)
    spec.visual.map.shadowscale = INNER
    head = spec.visual.headlight
    head.ambient[:], head.diffuse[:], head.specular[:] = AMBIENT, HEADLIGHT, 0.0
    target = np.array([*((low + high) / 2)[:2], low[2]])
    lamps = LAMPS if soft else ((LAMPS[0][0], sum(bright for _, bright in LAMPS)),)
    for number, (place, bright) in enumerate(lamps):
        spec.worldbody.add_light(
            name=f"palpate_lamp_{number}",
            pos=target + place,
            dir=-np.array(place),
            diffuse=[bright, 0.985 * bright, 0.95 * bright],
            specular=[bright / 2] * 3,
            ambient=[0, 0, 0],
            cutoff=70,
            exponent=1,
            castshadow=True,
        )
    place, way, bright = WINDOW
    spec.worldbody.add_light(
        name="palpate_window",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=place,
        dir=way,
        diffuse=[0.92 * bright, 0.97 * bright, bright],
        specular=[0, 0, 0],
        ambient=[0, 0, 0],
        castshadow=False,
    )


def _lights(spec: mujoco.MjSpec) -> list[mujoco.MjsLight]:
    return list(spec.lights)


def _floor(spec: mujoco.MjSpec, table: float) -> float:
    """World z of the floor, which gets a surface; one is put in where there is none."""
    texture = spec.add_texture(name=FLOOR, type=mujoco.mjtTexture.mjTEXTURE_2D)
    pixels = concrete()
    texture.height, texture.width, texture.nchannel = pixels.shape
    texture.data = pixels.tobytes()
    material = spec.add_material(
        name=FLOOR, rgba=FLOOR_TINT, specular=0.1, shininess=0.1, texrepeat=[0.5, 0.5]
    )
    material.texuniform = True
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = FLOOR
    planes = [geom for geom in spec.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
    for plane in planes:
        plane.material = FLOOR
    if planes:
        return float(min(plane.pos[2] for plane in planes))
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[5, 5, 0.1],
        pos=[0, 0, table - DOWN],
        material=FLOOR,
        contype=0,
        conaffinity=0,
    )
    return table - DOWN


def _walls(spec: mujoco.MjSpec, floor: float, behind: float, beside: float) -> None:
    """A wall of panels at x = `behind`, another at y = `beside`, m."""
    spec.add_material(name="palpate_wall", rgba=WALL_TINT, specular=0.05, shininess=0.1)
    spec.add_material(name="palpate_skirting", rgba=[0.45, 0.47, 0.50, 1], specular=0.1)
    half = (PANEL - GAP) / 2
    for number in range(-4, 5):
        middle = number * PANEL
        _wall(spec, "wall", [behind, middle, floor + HEIGHT / 2], [0.02, half, HEIGHT / 2])
        _wall(spec, "wall", [middle, beside, floor + HEIGHT / 2], [half, 0.02, HEIGHT / 2])
    _wall(spec, "skirting", [behind, 0, floor + 0.05], [0.032, LENGTH / 2, 0.05])
    _wall(spec, "skirting", [0, beside, floor + 0.05], [LENGTH / 2, 0.032, 0.05])
    _wall(spec, "skirting", [behind - 0.03, 0, floor + HEIGHT / 2], [0.02, LENGTH / 2, HEIGHT / 2])
    _wall(spec, "skirting", [0, beside + 0.03, floor + HEIGHT / 2], [LENGTH / 2, 0.02, HEIGHT / 2])


def _wall(spec: mujoco.MjSpec, kind: str, pos: list[float], size: list[float]) -> None:
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=pos,
        size=size,
        material=f"palpate_{kind}",
        mass=0.0,
        contype=0,
        conaffinity=0,
    )
