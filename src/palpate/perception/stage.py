"""A scene as it is drawn, and still pictures of it."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from palpate.common.pose import Array
from palpate.perception.dress import TABLE, Looks, add_texture, dress, looks_in, shape_arm
from palpate.perception.prints import concrete
from palpate.perception.renderer import AMBIENT as LEAST
from palpate.perception.renderer import (
    SCENERY,
    Painter,
    extent,
    forward_data,
    geom_corners,
    pad_box,
    png,
)

if TYPE_CHECKING:
    from palpate.scene.poses import CameraEntry


UNSEEN = 5
"""Group of what is not drawn."""
ROOM, LAB = "world", "lab"
"""The body whose look is the room, and that look."""
FLOOR = "palpate_floor"
WALL_TINT, FLOOR_TINT = (0.86, 0.88, 0.89, 1.0), (0.74, 0.76, 0.78, 1.0)
BEHIND, BESIDE, BEYOND = -1.15, 1.75, 0.5
"""Places of the walls, behind the arm and to its left, and their least distance from any object, m."""
HEIGHT, LENGTH = 3.0, 9.0
"""Of the walls, m."""
PANEL, GAP = 1.1, 0.012
"""Width of a wall's panels, and of the joint between two, m."""
DOWN = 0.75
"""From a table to the floor, where a scene has none, m."""
AMBIENT, HEADLIGHT = 0.36, 0.14
"""Shares of light from everywhere, and from the camera."""
LAMPS = (
    ((0.50, -1.35, 2.35), 0.22),
    ((0.59, -1.27, 2.38), 0.22),
    ((0.44, -1.25, 2.32), 0.22),
)
"""m from the middle of the objects, and brightness: one lamp as three beside each other, whose shadows
make one with a soft edge."""
INNER = 0.35
"""Share of the lamp's cone within which objects cast shadows: the arm and its workspace are in it, and
each gets more of the shadow map."""
FULL = 1.0
"""Most light on what faces upward: with more, all that is white is the same white."""
RESTING = 0.02
"""Most height of a table's top above the lowest point of what stands on it, m."""
FURNITURE, NEARBY = 0.5, 0.4
"""Largest extent of what is fixed and in view as a whole, and its distance from what is loose, m."""
WINDOW = ((0.4, 2.4, 1.6), (0.2, -0.9, -0.75), 0.20)
"""A window at the other side: place, direction, brightness. It casts no shadow."""


def build_stage(
    spec: mujoco.MjSpec, looks: Looks | None = None, *, soft: bool = True
) -> mujoco.MjModel:
    """A model for pictures of `spec`, which is not changed: with `looks` of its bodies (default: those
    that the scene states), and with the room where the scene states it or has neither floor nor light.
    `soft` shadows take twice the time of hard ones.

    Raises:
        InputError: unknown look.
    """
    drawn = spec.copy()
    worn = looks_in(spec) if looks is None else looks
    things = loose_things(spec)
    dress(drawn, worn)
    shape_arm(drawn)
    lights: list[mujoco.MjsLight] = list(drawn.lights)
    textures: list[mujoco.MjsTexture] = list(drawn.textures)
    has_sky = any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in textures)
    if worn.get(ROOM) == LAB:
        _furnish(drawn, things, soft)
    elif not (lights or has_sky or _planes(drawn)):
        _furnish(drawn, things, soft=False)
    else:
        if not has_sky:
            drawn.add_texture(
                name="palpate_sky",
                type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
                builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
                rgb1=[0.90, 0.93, 0.96],
                rgb2=[0.62, 0.70, 0.79],
                width=128,
                height=768,
            )
        if not lights:
            drawn.worldbody.add_light(
                name="palpate_lamp",
                pos=[0.6, -0.8, 2.6],
                dir=[-0.1, 0.3, -1.0],
                diffuse=[0.6, 0.6, 0.6],
                specular=[0.2, 0.2, 0.2],
                castshadow=True,
            )
        _expose(drawn)
    model = drawn.compile()
    # Sites mark places: they are not drawn.
    model.site_group[:] = UNSEEN
    return model


def _expose(spec: mujoco.MjSpec) -> None:
    """Dim lamps of `spec` that add up to more than a white table top can show, in place: it would be as
    white as the white cup on it."""
    head = spec.visual.headlight
    lights: list[mujoco.MjsLight] = list(spec.lights)
    shining = [light.diffuse * max(0.0, -light.dir[2]) for light in lights]
    lamps = float(np.max(np.sum([head.diffuse, *shining], axis=0)))
    share = (FULL - max(LEAST, float(np.max(head.ambient)))) / max(lamps, 1e-9)
    for light in (head, *lights):
        light.diffuse[:] = min(1.0, max(share, 0.0)) * light.diffuse
        light.specular[:] = min(1.0, max(share, 0.0)) * light.specular


def loose_things(spec: mujoco.MjSpec) -> Array:
    """Corners (n, 3), m, of the bodies with a free joint, else of those with a look other than a
    table's, else of everything."""
    model = spec.compile()
    others = [name for name, look in looks_in(spec).items() if look not in (LAB, TABLE)]
    return _extent(model, _free_bodies(model) or others)


def things_in_view(spec: mujoco.MjSpec, names: Collection[str] = ()) -> Array:
    """`loose_things`, with those of the bodies `names` that are small and beside them: shelves, trays,
    drawers."""
    model, found = spec.compile(), loose_things(spec)
    for name in names:
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) < 0:
            continue
        points = _extent(model, [name])
        gap = np.maximum(
            points.min(axis=0) - found.max(axis=0), found.min(axis=0) - points.max(axis=0)
        )
        if fits_in_view(points) and gap.max() <= NEARBY:
            found = np.concatenate([found, points])
    return found


def fits_in_view(points: Array) -> bool:
    """True if a body with these corners (n, 3) m is seen as a whole: no table, no wall."""
    return bool(np.ptp(points, axis=0).max() <= FURNITURE)


def ground_below(spec: mujoco.MjSpec) -> Array:
    """Corners (8, 3), m, of the shape with the largest footprint of those that are no higher than what
    is loose: the table top. Without one, of the ground around what is loose."""
    model = spec.compile()
    data, free = forward_data(model), _free_bodies(model)
    loose = _extent(model, free) if free else np.zeros((1, 3))
    level = float(loose[:, 2].min())
    found = pad_box(loose * [1.0, 1.0, 0.0] + [0.0, 0.0, level], (1.0, 1.0, 0.0), (1.0, 1.0, 0.0))
    widest = 0.0
    for geom in range(model.ngeom):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        box = geom_corners(model, data, geom)
        width, depth, _ = (box.max(axis=0) - box.min(axis=0)).tolist()
        footprint = width * depth
        if footprint > widest and (not free or box[:, 2].max() <= level + RESTING):
            found, widest = box, footprint
    return found


def _extent(model: mujoco.MjModel, names: list[str]) -> Array:
    return extent(model, forward_data(model), names)


def _free_bodies(model: mujoco.MjModel) -> list[str]:
    """Names of the bodies with a free joint."""
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    return [model.body(int(model.jnt_bodyid[joint])).name for joint in free]


def _planes(spec: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    return [geom for geom in spec.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]


def _furnish(spec: mujoco.MjSpec, things: Array, soft: bool) -> None:
    """Put the room around corners (n, 3) m of what is in it, with a lamp, `soft` or single, and a
    window, in place of the scene's own lights."""
    low, high = things.min(axis=0), things.max(axis=0)
    floor = _floor(spec, float(low[2]))
    _walls(spec, floor, min(BEHIND, low[0] - BEYOND), max(BESIDE, high[1] + BEYOND))
    lights: list[mujoco.MjsLight] = list(spec.lights)
    for light in lights:
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


def _floor(spec: mujoco.MjSpec, table: float) -> float:
    """Paint the planes of the world, or add one below `table`, m; return the z of the lowest, m."""
    material = spec.add_material(
        name=FLOOR, rgba=FLOOR_TINT, specular=0.1, shininess=0.1, texrepeat=[0.5, 0.5]
    )
    material.texuniform = True
    add_texture(spec, material, concrete())
    planes = _planes(spec)
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
    """Build a wall of panels at x = `behind`, another at y = `beside`, m."""
    wall, skirting = "palpate_wall", "palpate_skirting"
    spec.add_material(name=wall, rgba=WALL_TINT, specular=0.05, shininess=0.1)
    spec.add_material(name=skirting, rgba=[0.45, 0.47, 0.50, 1], specular=0.1)
    half, middle, foot = (PANEL - GAP) / 2, floor + HEIGHT / 2, floor + 0.05
    for number in range(-4, 5):
        place = number * PANEL
        add_box(spec, wall, [behind, place, middle], [0.02, half, HEIGHT / 2])
        add_box(spec, wall, [place, beside, middle], [half, 0.02, HEIGHT / 2])
    add_box(spec, skirting, [behind, 0, foot], [0.032, LENGTH / 2, 0.05])
    add_box(spec, skirting, [0, beside, foot], [LENGTH / 2, 0.032, 0.05])
    # Dark sheets behind the panels show in the joints.
    add_box(spec, skirting, [behind - 0.03, 0, middle], [0.02, LENGTH / 2, HEIGHT / 2])
    add_box(spec, skirting, [0, beside + 0.03, middle], [LENGTH / 2, 0.02, HEIGHT / 2])


def add_box(spec: mujoco.MjSpec, material: str, pos: list[float], size: list[float]) -> None:
    """Add a box to the world that is seen and collides with nothing."""
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(type=box, pos=pos, size=size, material=material, **SCENERY)


# Still pictures, as PNG: a simulated workspace, the scene before and after, a moment of the run.
# All raise RuntimeError without a usable OpenGL.


CAMERA = "workspace"
"""Name of the world's own camera."""
TAKEN = "palpate_camera"
"""Name of the camera of `poses.yaml` in the simulated world."""
WORKSPACE = (1024, 768)
"""Width and height of the workspace's picture, pixels."""
FROM_ABOVE, ABOVE = -30.0, 0.05
"""Its elevation, degrees, and m of air in view above the objects."""
SIZE = (960, 640)
"""Width and height of a picture, pixels."""
AROUND, BELOW = 0.15, 0.10
"""m of the surroundings in view, around and below what can move."""


def render_workspace(
    world: mujoco.MjSpec, camera: CameraEntry | None = None, names: Collection[str] = ()
) -> bytes:
    """A simulated workspace before anything moves, seen by `camera`, else by the world's own camera,
    else by one that frames the objects, and of the bodies `names` those beside them."""
    spec, (width, height), name = world.copy(), WORKSPACE, CAMERA
    if camera is not None:
        spec.worldbody.add_camera(name=TAKEN, pos=camera.pos, quat=camera.quat, fovy=camera.fovy)
        height, name = round(width * camera.size[1] / camera.size[0]), TAKEN
    model = build_stage(spec)
    with Painter(model, width, height) as painter:
        view: mujoco.MjvCamera | str = name
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name) < 0:
            things = things_in_view(world, names)
            points = pad_box(things, (AROUND, AROUND, 0.0), (AROUND, AROUND, ABOVE))
            view = painter.enclose(points, elevation=FROM_ABOVE)
        return png(painter.paint(forward_data(model), view))


def render_before_after(
    before: mujoco.MjSpec,
    after: mujoco.MjSpec,
    bodies: Collection[str] = (),
    looks: Looks | None = None,
    size: tuple[int, int] = SIZE,
) -> tuple[bytes, bytes]:
    """Two PNGs from one camera that has the named bodies (all, when none is named) of both scenes
    in view. `looks` replaces those that the scene `before` states."""
    looks = looks_in(before) if looks is None else looks
    points = np.concatenate([_points(spec, bodies) for spec in (before, after)])
    return _still(before, looks, points, size), _still(after, looks, points, size)


def render_scene(
    spec: mujoco.MjSpec, bodies: Collection[str] = (), size: tuple[int, int] = SIZE
) -> bytes:
    """A PNG of the scene in its initial configuration."""
    return _still(spec, looks_in(spec), _points(spec, bodies), size)


def render_moment(
    model: mujoco.MjModel,
    qpos: Array,
    drawn: mujoco.MjModel | None = None,
    size: tuple[int, int] = SIZE,
) -> bytes:
    """A PNG of a world at configuration `qpos` (nq,), robot included. `drawn`: the model for
    pictures."""
    data = forward_data(model, qpos)
    points = in_view(model, extent(model, data, moving_bodies(model)))
    painted = drawn or model
    with Painter(painted, *size) as painter:
        return png(painter.paint(forward_data(painted, qpos), painter.enclose(points)))


def moving_bodies(model: mujoco.MjModel) -> list[str]:
    """Names of the bodies that can move, an arm's links among them."""
    moving = [i for i in range(1, model.nbody) if model.body_weldid[i]]
    return [model.body(i).name for i in moving if model.body(i).name]


def in_view(model: mujoco.MjModel, points: Array) -> Array:
    """Corners (8, 3) around `points` and a part of their support where something can move; else the
    points."""
    if not moving_bodies(model):
        return points
    return pad_box(points, (AROUND, AROUND, BELOW), (AROUND, AROUND, 0.0))


def _points(spec: mujoco.MjSpec, bodies: Collection[str]) -> Array:
    """Corners (n, 3), m, to be in view: of the named bodies that move, else of all that move, else of
    the named ones."""
    model = spec.compile()
    moving = moving_bodies(model)
    named = [name for name in moving if name in bodies] or moving or bodies
    return in_view(model, extent(model, forward_data(model), named))


def _still(spec: mujoco.MjSpec, looks: Looks, points: Array, size: tuple[int, int]) -> bytes:
    model = build_stage(spec, looks)
    with Painter(model, *size) as painter:
        return png(painter.paint(forward_data(model), painter.enclose(points)))
