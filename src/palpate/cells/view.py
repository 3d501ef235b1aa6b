"""I: the pictures of the workspace, given as files or taken by the camera of a simulated one."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from palpate.pictures.annotate import MARGIN, STEP, Ground, annotated, camera_of, ruled
from palpate.pictures.renderer import Painter, png
from palpate.pictures.stage import free_bodies, ground_level, loose_things, staged

if TYPE_CHECKING:
    from mujoco import MjData, MjModel, MjSpec

    from palpate.geometry.pose import Array
    from palpate.scene.poses import CameraEntry

CAMERA = "workspace"
"""The camera of the world's MJCF that looks at the workspace; without one, a camera that frames what
stands there."""
TAKEN = "palpate_camera"
"""The camera of `poses.yaml`, set up in the simulated world."""
WIDTH, HEIGHT = 1024, 768
AROUND, ABOVE = 0.15, 0.05
"""m: how much of the table, and of the air, is in view around the things."""
FROM_ABOVE, STEEP = -30.0, -46.0
"""degrees: from how far above the workspace is looked at; and the things from nearer, so that gaps
show."""
EDGE = 1.16
"""Room for the grid's figures at the edges."""


def workspace_png(world: MjSpec, camera: CameraEntry | None = None) -> bytes:
    """A simulated workspace before anything moves, as PNG, seen by `camera`, else by the world's
    own camera, else by one that frames what stands there.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    import mujoco

    spec, width, height = world.copy(), WIDTH, HEIGHT
    name = CAMERA
    if camera is not None:
        spec.worldbody.add_camera(name=TAKEN, pos=camera.pos, quat=camera.quat, fovy=camera.fovy)
        height, name = round(width * camera.size[1] / camera.size[0]), TAKEN
    model = staged(spec)
    with Painter(model, width, height) as painter:
        named = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name) >= 0
        around = _room_around(loose_things(world))
        view = name if named else painter.around(around, elevation=FROM_ABOVE)
        return png(painter.paint(_forwarded(model), view))


def closer_png(world: MjSpec, names: Mapping[str, Array]) -> bytes:
    """The things from nearer and more from above, with `names` where they are thought to be (3,) m,
    axes and a grid.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    things = loose_things(world)
    # Where nothing is loose, the things are the table, and the grid stays on it.
    margin = MARGIN if free_bodies(world.compile()) else -STEP
    ground = Ground.under(things, ground_level(world, things), margin)
    spec = world.copy()
    ruled(spec, ground)
    model = staged(spec)
    with Painter(model, WIDTH, HEIGHT) as painter:
        view = painter.around(
            np.concatenate([things, ground.corners]), elevation=STEEP, margin=EDGE
        )
        pixels = painter.paint(_forwarded(model), view)
        camera = camera_of(view, float(model.vis.global_.fovy), WIDTH, HEIGHT)
    return png(annotated(pixels, camera, names, ground))


def _room_around(things: Array) -> Array:
    """(8, 3) corners of the things with some table and air around."""
    low = things.min(axis=0) - np.array([AROUND, AROUND, 0.0])
    high = things.max(axis=0) + np.array([AROUND, AROUND, ABOVE])
    return np.array(list(product(*zip(low, high, strict=True))))


def _forwarded(model: MjModel) -> MjData:
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data
