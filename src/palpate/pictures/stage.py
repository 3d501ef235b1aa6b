"""A scene as it is drawn: dressed, in its room, and lit. Its configurations are the scene's own."""

from __future__ import annotations

import mujoco

from palpate.geometry.pose import Array
from palpate.pictures.dress import Looks, dress, looks_in
from palpate.pictures.framing import extent
from palpate.pictures.lab import LAB, ROOM, furnish
from palpate.pictures.menagerie import shape_arm

UNSEEN = 5
"""The group of what is not drawn."""
TABLE = "table"
"""The look of what things stand on."""


def staged(spec: mujoco.MjSpec, looks: Looks | None = None, *, soft: bool = True) -> mujoco.MjModel:
    """`spec`, which stays as it is, as a model for pictures: `looks` of its bodies (what the scene
    itself says of them, unless given), around it the room, where the scene wants it or has neither
    floor nor light; in its own room with `soft` shadows or, in half the time, hard ones.

    Raises:
        InputError: there is no such look.
    """
    drawn = spec.copy()
    worn = looks_in(spec) if looks is None else looks
    things = loose_things(spec)
    dress(drawn, worn)
    shape_arm(drawn)
    if worn.get(ROOM) == LAB:
        furnish(drawn, things, soft)
    elif _is_bare(drawn):
        furnish(drawn, things, soft=False)
    else:
        _light(drawn)
    model = drawn.compile()
    # Sites mark places: there is nothing to be seen of them.
    model.site_group[:] = UNSEEN
    return model


def loose_things(spec: mujoco.MjSpec) -> Array:
    """Corners (n, 3), m, of what can move freely, else of what has a look and is no table, else of
    everything."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    others = [name for name, look in looks_in(spec).items() if look not in (LAB, TABLE)]
    return extent(model, data, free_bodies(model) or others)


def ground_level(spec: mujoco.MjSpec, things: Array) -> float:
    """World z of the top of what looks like a table, m, else of the foot of the things."""
    tables = [name for name, look in looks_in(spec).items() if look == TABLE]
    if not tables:
        return float(things[:, 2].min())
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return float(extent(model, data, tables)[:, 2].max())


def free_bodies(model: mujoco.MjModel) -> list[str]:
    """The names of what can move freely."""
    joints = range(model.njnt)
    free = [i for i in joints if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE]
    return [model.body(int(model.jnt_bodyid[i])).name for i in free]


def _is_bare(spec: mujoco.MjSpec) -> bool:
    """True if nothing is said of light and floor."""
    planes = [g for g in spec.worldbody.geoms if g.type == mujoco.mjtGeom.mjGEOM_PLANE]
    return not (list(spec.lights) or planes or _has_sky(spec))


def _has_sky(spec: mujoco.MjSpec) -> bool:
    textures: list[mujoco.MjsTexture] = list(spec.textures)
    return any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in textures)


def _light(spec: mujoco.MjSpec) -> None:
    """Add what a picture needs and the scene lacks: a sky, a lamp with shadow."""
    if not _has_sky(spec):
        spec.add_texture(
            name="palpate_sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.90, 0.93, 0.96],
            rgb2=[0.62, 0.70, 0.79],
            width=128,
            height=768,
        )
    if not list(spec.lights):
        spec.worldbody.add_light(
            name="palpate_lamp",
            pos=[0.6, -0.8, 2.6],
            dir=[-0.1, 0.3, -1.0],
            diffuse=[0.6, 0.6, 0.6],
            specular=[0.2, 0.2, 0.2],
            castshadow=True,
        )
