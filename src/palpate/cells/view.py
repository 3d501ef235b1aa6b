"""I: the pictures of the workspace, given as files or taken by the camera of a simulated one."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from palpate.pictures.renderer import Painter, add_lights, extent, gl_available, png

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.scene.poses import CameraEntry

CAMERA = "workspace"
"""The camera of the world's MJCF that looks at the workspace; without one, a camera that frames all
objects."""
TAKEN = "palpate_camera"
"""The camera of `poses.yaml`, set up in the simulated world."""
WIDTH, HEIGHT = 1024, 768


def workspace_png(
    world: MjSpec, bodies: tuple[str, ...], camera: CameraEntry | None = None
) -> bytes | None:
    """A simulated workspace before anything moves, as PNG, seen by `camera`, else by the world's
    own camera, else by one that has all `bodies` in view.

    `world` gets lights. None without a usable OpenGL.
    """
    return _painted(world, bodies, camera) if gl_available()[0] else None


@contextmanager
def image_files(given: tuple[Path, ...], taken: bytes | None) -> Generator[tuple[Path, ...]]:
    """The images that were given, or the picture that was taken of the workspace as a file while
    the block runs."""
    if given or taken is None:
        yield given
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
