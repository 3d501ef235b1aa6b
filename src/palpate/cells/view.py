"""I: the pictures of the workspace, given as files or taken by the camera of a simulated one."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from palpate.cells.simulated import simulated_cell
from palpate.pictures.renderer import Painter, add_lights, extent, gl_available, png
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene
from palpate.settings import Job

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.scene.poses import CameraEntry

CAMERA = "workspace"
"""The camera of the world's MJCF that looks at the workspace; without one, a camera that frames all
objects."""
TAKEN = "palpate_camera"
"""The camera of `poses.yaml`, set up in the simulated world."""
WIDTH, HEIGHT = 1024, 768


def workspace_png(job: Job, scene: Scene | None, camera: CameraEntry | None = None) -> bytes | None:
    """The simulated workspace before anything moves, as PNG, seen by `camera` if there is one.

    None where there is nothing simulated to look at, or no usable OpenGL.
    """
    if job.robot is not None or not gl_available()[0]:
        return None
    if scene is not None:
        cell = simulated_cell(job, scene)
        return _painted(cell.world.spec(cell.drawn), tuple(cell.world.bodies), camera)
    if job.world is None:
        return None
    world = load_scene(job.world)
    return _painted(world.spec(), tuple(world.bodies), camera)


@contextmanager
def image_files(job: Job, taken: bytes | None) -> Generator[tuple[Path, ...]]:
    """The job's images, or the picture that was taken of its workspace as a file while the block
    runs."""
    if job.images or taken is None:
        yield job.images
        return
    with TemporaryDirectory() as folder:
        path = Path(folder) / "workspace.png"
        path.write_bytes(taken)
        yield (path,)


def _painted(spec: MjSpec, bodies: tuple[str, ...], camera: CameraEntry | None) -> bytes:
    import mujoco

    add_lights(spec)
    width, height = WIDTH, HEIGHT
    if camera is not None:
        spec.worldbody.add_camera(name=TAKEN, pos=camera.pos, quat=camera.quat, fovy=camera.fovy)
        height = round(width * camera.size[1] / camera.size[0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Painter(model, width, height) as painter:
        name = TAKEN if camera is not None else CAMERA
        named = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name) >= 0
        return png(
            painter.paint(data, name if named else painter.around(extent(model, data, bodies)))
        )
