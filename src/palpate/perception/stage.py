"""Rendered scene with looks, room and lights, and still pictures of it."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from palpate.common.pose import Array
from palpate.perception.dress import TABLE, Looks, add_texture, dress, looks_in, shape_arm
from palpate.perception.prints import ASSETS, picture
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


UNSEEN = 5  # Geom group of hidden elements
ROOM, LAB = "world", "lab"  # Name of the body whose look is the room, and that look
FLOOR = "palpate_floor"
FLOOR_TINT = (0.74, 0.76, 0.77, 1.0)
# m. Positions of the walls behind the arm and to its left, and their minimum distance from objects.
BEHIND, BESIDE, BEYOND = -1.15, 1.75, 0.5
DOWN = 0.75  # m. Height of a table above the floor in a scene without a floor.
AMBIENT, HEADLIGHT = 0.36, 0.14  # Shares of ambient light and of the headlight
# Share of the lamp's cone that casts shadows. It contains the arm and its workspace, which then use
# more of the shadow map.
INNER = 0.35
FULL = 1.0  # Maximum light on a horizontal surface; above it all white surfaces are equally white
RESTING = 0.02  # m. Maximum height of a table top above the lowest point of the objects on it.
# m. Maximum extent of fixed bodies that are fully in view, and their maximum distance from the
# loose objects.
FURNITURE, NEARBY = 0.5, 0.4


def build_stage(
    spec: mujoco.MjSpec, looks: Looks | None = None, *, soft: bool = True
) -> mujoco.MjModel:
    """Build a model for pictures of `spec`, which stays unchanged; `looks` are by default those of the scene.

    The room is added if the scene states it, or if the scene has neither floor nor light. Soft shadows (`soft`)
    take twice the time of hard ones.
    """
    drawn = spec.copy()
    _strip_paths(drawn)
    worn = looks_in(spec) if looks is None else looks
    things = loose_things(spec)
    dress(drawn, worn)
    shape_arm(drawn)
    lights: list[mujoco.MjsLight] = list(drawn.lights)
    textures: list[mujoco.MjsTexture] = list(drawn.textures)
    has_sky = any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in textures)
    # Background and light: the room, a plain room, or additions to those of the scene.
    if worn.get(ROOM) == LAB:
        _furnish(drawn, things, soft)
    elif not (lights or has_sky or _planes(drawn)):
        _furnish(drawn, things, soft=False)
    else:
        # A scene with its own floor or light gets a sky and a lamp if it has none.
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
    # Sites mark places and are hidden.
    model.site_group[:] = UNSEEN
    return model


def _strip_paths(spec: Any) -> None:
    """Apply `strippath` to the file names of `spec` and clear it: files of looks have whole paths."""
    if spec.strippath:
        for asset in (*spec.meshes, *spec.textures, *spec.hfields, *spec.skins):
            asset.file = re.split(r"[/\\]", asset.file)[-1]
        spec.strippath = False


def _expose(spec: mujoco.MjSpec) -> None:
    """Dim the lamps of `spec` in place where their sum overexposes a horizontal surface.

    An overexposed white table top would hide a white cup on it.
    """
    head = spec.visual.headlight
    lights: list[mujoco.MjsLight] = list(spec.lights)
    # Sum the diffuse light on a horizontal surface and scale all lamps to the limit.
    shining = [light.diffuse * max(0.0, -light.dir[2]) for light in lights]
    lamps = float(np.max(np.sum([head.diffuse, *shining], axis=0)))
    # The lamps share the limit with the ambient light.
    share = (FULL - max(LEAST, float(np.max(head.ambient)))) / max(lamps, 1e-9)
    for light in (head, *lights):
        light.diffuse[:] = min(1.0, max(share, 0.0)) * light.diffuse
        light.specular[:] = min(1.0, max(share, 0.0)) * light.specular


def loose_things(spec: mujoco.MjSpec) -> Array:
    """Corners (n, 3) of the loose bodies, m.

    These are the bodies with a free joint, else those with a look other than a table's, else all.
    """
    model = spec.compile()
    # Without free joints, the bodies with a look other than room or table count as loose.
    others = [name for name, look in looks_in(spec).items() if look not in (LAB, TABLE)]
    return _extent(model, _free_bodies(model) or others)


def things_in_view(spec: mujoco.MjSpec, names: Collection[str] = ()) -> Array:
    """Corners of the loose bodies and of small named bodies near them, such as shelves, trays and
    drawers.
    """
    model, found = spec.compile(), loose_things(spec)
    for name in names:
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) < 0:
            continue
        points = _extent(model, [name])
        # Distance of two boxes along each axis; negative where they overlap.
        gap = np.maximum(
            points.min(axis=0) - found.max(axis=0), found.min(axis=0) - points.max(axis=0)
        )
        if fits_in_view(points) and gap.max() <= NEARBY:
            found = np.concatenate([found, points])
    return found


def fits_in_view(points: Array) -> bool:
    """True if a body with these corners (n, 3), m, is small enough to be fully in view."""
    return bool(np.ptp(points, axis=0).max() <= FURNITURE)


def ground_below(spec: mujoco.MjSpec) -> Array:
    """Corners (8, 3) of the table top, m.

    It is the shape with the largest footprint that is no higher than the loose bodies. Without one,
    the ground around them is returned.
    """
    model = spec.compile()
    data, free = forward_data(model), _free_bodies(model)
    # The lowest point of the loose bodies is the expected height of the table top.
    loose = _extent(model, free) if free else np.zeros((1, 3))
    level = float(loose[:, 2].min())
    found = pad_box(loose * [1.0, 1.0, 0.0] + [0.0, 0.0, level], (1.0, 1.0, 0.0), (1.0, 1.0, 0.0))
    widest = 0.0
    for geom in range(model.ngeom):
        # Planes are infinite and have no bounding box.
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        box = geom_corners(model, data, geom)
        # Keep the largest footprint at or below that height.
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
    """Build the room around corners (n, 3), m, and replace the scene's lights.

    The lamp casts soft or hard shadows (`soft`). A window on the other side casts none.
    """
    low, high = things.min(axis=0), things.max(axis=0)
    floor = _floor(spec, float(low[2]))
    # A wall behind the arm and one to its left.
    _attach(spec, "wall", "behind_", [min(BEHIND, low[0] - BEYOND), 0, floor])
    _attach(spec, "wall", "left_", [0, max(BESIDE, high[1] + BEYOND), floor], -np.pi / 2)
    lights: list[mujoco.MjsLight] = list(spec.lights)
    for light in lights:
        spec.delete(light)
    # Exposure: ambient light and headlight replace those of the scene.
    spec.visual.map.shadowscale = INNER
    head = spec.visual.headlight
    head.ambient[:], head.diffuse[:], head.specular[:] = AMBIENT, HEADLIGHT, 0.0
    # Lamps above the objects, directed at their centre, and a window.
    target = [*((low + high) / 2)[:2], low[2]]
    _attach(spec, "soft_light" if soft else "hard_light", "light_", target)


def _attach(
    spec: mujoco.MjSpec, name: str, prefix: str, pos: Sequence[float], turn: float = 0.0
) -> None:
    """Attach a model of the assets to the world at `pos` (3,), m, turned by `turn` about z, rad."""
    part = mujoco.MjSpec.from_file(str(ASSETS / f"{name}.xml"))
    frame = spec.worldbody.add_frame(pos=pos, quat=[np.cos(turn / 2), 0, 0, np.sin(turn / 2)])
    spec.attach(part, frame=frame, prefix=f"palpate_{prefix}")


def _floor(spec: mujoco.MjSpec, table: float) -> float:
    """Paint the world's planes, or add one below `table`; return the z of the lowest plane, m."""
    material = spec.add_material(
        name=FLOOR, rgba=FLOOR_TINT, specular=0.1, shininess=0.1, texrepeat=[0.5, 0.5]
    )
    # Uniform texture scale in metres, independent of the size of the plane.
    material.texuniform = True
    add_texture(spec, material, picture("concrete"))
    planes = _planes(spec)
    for plane in planes:
        plane.material = FLOOR
    # A scene with planes keeps them; the lowest one is the floor.
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


def add_box(spec: mujoco.MjSpec, material: str, pos: list[float], size: list[float]) -> None:
    """Add a visual box without mass and collisions to the world."""
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(type=box, pos=pos, size=size, material=material, **SCENERY)


# Still pictures as PNG: the simulated workspace, the scene before and after, a moment of a run. All
# functions raise RuntimeError without a usable OpenGL.


CAMERA = "workspace"  # Name of the world's own camera
TAKEN = "palpate_camera"  # Name of the camera of `poses.yaml` in the simulated world
WORKSPACE = (1024, 768)  # px. Width and height of the workspace picture.
# degrees and m. Elevation of the workspace view, and free space above the objects in it.
FROM_ABOVE, ABOVE = -30.0, 0.05
SIZE = (960, 640)  # px. Width and height of a picture.
AROUND, BELOW = 0.15, 0.10  # m. Surroundings in view, around and below the moving bodies.


def render_workspace(
    world: mujoco.MjSpec, camera: CameraEntry | None = None, names: Collection[str] = ()
) -> bytes:
    """Render the simulated workspace before any motion.

    The view is that of `camera`, else of the world's own camera. Otherwise a free camera frames the
    loose objects and the small named bodies near them.
    """
    spec, (width, height), name = world.copy(), WORKSPACE, CAMERA
    # The camera of poses.yaml is added to the scene and determines the aspect ratio.
    if camera is not None:
        spec.worldbody.add_camera(name=TAKEN, pos=camera.pos, quat=camera.quat, fovy=camera.fovy)
        height, name = round(width * camera.size[1] / camera.size[0]), TAKEN
    model = build_stage(spec)
    with Painter(model, width, height) as painter:
        # A free camera frames the objects if the named camera does not exist.
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
    """Render two scenes from one camera that frames the named bodies of both, all by default, as two PNG files.

    `looks` are by default those stated in `before`; `size` is width and height, pixels.
    """
    looks = looks_in(before) if looks is None else looks
    # One view of both scenes makes the pictures comparable.
    points = np.concatenate([_points(spec, bodies) for spec in (before, after)])
    return _still(before, looks, points, size), _still(after, looks, points, size)


def render_scene(
    spec: mujoco.MjSpec, bodies: Collection[str] = (), size: tuple[int, int] = SIZE
) -> bytes:
    """Render the scene in its initial configuration as PNG."""
    return _still(spec, looks_in(spec), _points(spec, bodies), size)


def render_moment(
    model: mujoco.MjModel,
    qpos: Array,
    drawn: mujoco.MjModel | None = None,
    size: tuple[int, int] = SIZE,
) -> bytes:
    """Render a world including the robot at configuration `qpos` (nq,) as PNG.

    `drawn` is the model for pictures; the default is `model`.
    """
    data = forward_data(model, qpos)
    points = in_view(model, extent(model, data, moving_bodies(model)))
    # The view follows the collision shapes, because looks have no own extent.
    painted = drawn or model
    with Painter(painted, *size) as painter:
        return png(painter.paint(forward_data(painted, qpos), painter.enclose(points)))


def moving_bodies(model: mujoco.MjModel) -> list[str]:
    """Names of the bodies that can move, including the arm's links."""
    moving = [i for i in range(1, model.nbody) if model.body_weldid[i]]
    return [model.body(i).name for i in moving if model.body(i).name]


def in_view(model: mujoco.MjModel, points: Array) -> Array:
    """Corners (8, 3) of a box around `points`, with a part of their support.

    Without moving bodies, the points are returned unchanged.
    """
    if not moving_bodies(model):
        return points
    return pad_box(points, (AROUND, AROUND, BELOW), (AROUND, AROUND, 0.0))


def _points(spec: mujoco.MjSpec, bodies: Collection[str]) -> Array:
    """Corners (n, 3) of the bodies in view, m.

    These are the named bodies that move, else all that move, else the named ones.
    """
    model = spec.compile()
    moving = moving_bodies(model)
    # Static bodies in `bodies` do not enlarge the view of moving ones.
    named = [name for name in moving if name in bodies] or moving or bodies
    return in_view(model, extent(model, forward_data(model), named))


def _still(spec: mujoco.MjSpec, looks: Looks, points: Array, size: tuple[int, int]) -> bytes:
    model = build_stage(spec, looks)
    with Painter(model, *size) as painter:
        return png(painter.paint(forward_data(model), painter.enclose(points)))
