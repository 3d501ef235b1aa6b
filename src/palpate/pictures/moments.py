"""Still pictures, as PNG: a simulated workspace, the scene before and after, a moment of the run. All
raise RuntimeError without a usable OpenGL."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from palpate.geometry.pose import Array
from palpate.pictures.dress import Looks, looks_in
from palpate.pictures.renderer import Painter, extent, forwarded, padded, png
from palpate.pictures.stage import staged, things_in_view

if TYPE_CHECKING:
    from palpate.scene.poses import CameraEntry

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
    model = staged(spec)
    with Painter(model, width, height) as painter:
        view: mujoco.MjvCamera | str = name
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name) < 0:
            things = things_in_view(world, names)
            points = padded(things, (AROUND, AROUND, 0.0), (AROUND, AROUND, ABOVE))
            view = painter.around(points, elevation=FROM_ABOVE)
        return png(painter.paint(forwarded(model), view))


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
    data = forwarded(model, qpos)
    points = in_view(model, extent(model, data, moving_bodies(model)))
    painted = drawn or model
    with Painter(painted, *size) as painter:
        return png(painter.paint(forwarded(painted, qpos), painter.around(points)))


def moving_bodies(model: mujoco.MjModel) -> list[str]:
    """Names of the bodies that can move, an arm's links among them."""
    moving = [i for i in range(1, model.nbody) if model.body_weldid[i]]
    return [model.body(i).name for i in moving if model.body(i).name]


def in_view(model: mujoco.MjModel, points: Array) -> Array:
    """Corners (8, 3) around `points` and a part of their support where something can move; else the
    points."""
    if not moving_bodies(model):
        return points
    return padded(points, (AROUND, AROUND, BELOW), (AROUND, AROUND, 0.0))


def _points(spec: mujoco.MjSpec, bodies: Collection[str]) -> Array:
    """Corners (n, 3), m, to be in view: of the named bodies that move, else of all that move, else of
    the named ones."""
    model = spec.compile()
    moving = moving_bodies(model)
    named = [name for name in moving if name in bodies] or moving or bodies
    return in_view(model, extent(model, forwarded(model), named))


def _still(spec: mujoco.MjSpec, looks: Looks, points: Array, size: tuple[int, int]) -> bytes:
    model = staged(spec, looks)
    with Painter(model, *size) as painter:
        return png(painter.paint(forwarded(model), painter.around(points)))
