"""Pictures of a simulated workspace, as its camera takes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from palpate.pictures.annotate import MARGIN, STEP, Ground, annotated, camera_of, ruled
from palpate.pictures.renderer import Painter, forwarded, padded, png
from palpate.pictures.stage import free_bodies, ground_level, loose_things, staged

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.geometry.pose import Array
    from palpate.scene.poses import CameraEntry

CAMERA = "workspace"
"""Name of the world's own camera."""
TAKEN = "palpate_camera"
"""Name of the camera of `poses.yaml` in the simulated world."""
WIDTH, HEIGHT = 1024, 768
AROUND, ABOVE = 0.15, 0.05
"""m of the table, and of the air, in view around the objects."""
FROM_ABOVE, STEEP = -30.0, -46.0
"""Elevations of the cameras of the workspace and of the close-up, in which gaps show, degrees."""
EDGE = 1.16
"""Room for the grid's figures at the edges."""


def workspace_png(world: MjSpec, camera: CameraEntry | None = None) -> bytes:
    """A simulated workspace before anything moves, as PNG, seen by `camera`, else by the world's
    own camera, else by one that frames the objects.

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
        around = padded(loose_things(world), (AROUND, AROUND, 0.0), (AROUND, AROUND, ABOVE))
        view = name if named else painter.around(around, elevation=FROM_ABOVE)
        return png(painter.paint(forwarded(model), view))


def closer_png(world: MjSpec, names: Mapping[str, Array]) -> bytes:
    """A close-up of the objects from above, as PNG, with `names` at their believed places (3,) m, axes
    and a grid.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    things = loose_things(world)
    # Where nothing is loose, the table itself is in view, and the grid stays on it.
    margin = MARGIN if free_bodies(world.compile()) else -STEP
    ground = Ground.under(things, ground_level(world, things), margin)
    spec = world.copy()
    ruled(spec, ground)
    model = staged(spec)
    with Painter(model, WIDTH, HEIGHT) as painter:
        view = painter.around(
            np.concatenate([things, ground.corners]), elevation=STEEP, margin=EDGE
        )
        pixels = painter.paint(forwarded(model), view)
        camera = camera_of(view, float(model.vis.global_.fovy), WIDTH, HEIGHT)
    return png(annotated(pixels, camera, names, ground))
