"""Off-screen rendering of MuJoCo models: OpenGL backend, framing cameras, painting, PNG.

Pictures are optional. Without a usable OpenGL everything else works, and `gl_available` states the
reason and the remedy.
"""

from __future__ import annotations

import importlib
import io
import os
import subprocess
import sys
from collections.abc import Callable, Collection, Sequence
from copy import copy
from functools import cache, partial
from itertools import product
from multiprocessing import parent_process
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from palpate.common.pose import Array
from palpate.common.processes import Fork, can_copy

Pixels = NDArray[np.uint8]  # (height, width, 3) RGB

# Minimum share of ambient light, so that shadows are not black. MuJoCo's default is 0.1.
AMBIENT = 0.35
# px. With 2048, walls in grazing light have fewer artefacts, for 0.06 s more CPU time per picture.
SHADOW_MAP = 1024
# PNG compression level, 0 to 9. Compared with 6, files are a fifth larger and take a quarter of the
# time.
PACKING = 2

# degrees. Default view of MuJoCo's free camera: from the front of the arm, over its left shoulder,
# slightly from above.
AZIMUTH, ELEVATION = 145.0, -22.0
# m. View of an empty scene, around a table top.
EMPTY_EXTENT = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.8]])
CANVAS = (64, 64)  # px. Size of the context's default buffer, which is not used.
MOST_GEOMS = 10_000  # Maximum number of rendered geoms, MuJoCo's default
# Attributes of a visual geom without mass and collisions.
SCENERY: dict[str, Any] = {"mass": 0.0, "contype": 0, "conaffinity": 0}
# (8, 3) signs of the corners of a box.
CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T

_REMEDY = "for pictures install a software OpenGL (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri)"
_OFF = {"disable", "disabled", "off", "false", "0"}
_PROBE = """
import mujoco
context = mujoco.GLContext(64, 64)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
"""
PATIENCE = 60.0  # s until a driver without an answer counts as unusable
# Tests of backends that run in the background: functions that wait for the reason of a failure.
_begun: dict[str, Callable[[], str | None]] = {}


def gl_available() -> tuple[bool, str]:
    """Test for a usable renderer.

    Returns:
        The availability, and the backend's name or the reason with a remedy in one line.
    """
    chosen = _chosen()
    if chosen in _OFF:
        return False, f"MUJOCO_GL={chosen} switches pictures off; unset it to get them"
    return _usable()


def look_ahead() -> None:
    """Start the test of the first backend in the background; `gl_available` waits for its result."""
    chosen = _chosen()
    backend = _backends(chosen)[0]
    known = _usable.cache_info().currsize or backend in _begun
    if chosen not in _OFF and not known:
        _begun[backend] = _trial(backend)


def _chosen() -> str:
    """Return the backend named in the environment; empty without one."""
    return os.environ.get("MUJOCO_GL", "").lower().strip()


def _backends(chosen: str) -> tuple[str, ...]:
    """Return the backends to test: the user's choice, else those of the platform.

    The empty name stands for MuJoCo's own choice.
    """
    if chosen:
        return (chosen,)
    return ("egl", "osmesa") if sys.platform == "linux" else ("",)


@cache
def _usable() -> tuple[bool, str]:
    """Select the first backend that works, or state why none does.

    Each backend is tested in a separate process: a failing driver may crash its process, and
    PyOpenGL binds to its first backend permanently. The first that works is stored in `MUJOCO_GL`.
    """
    reasons: list[str] = []
    for backend in _backends(_chosen()):
        reason = _failure(backend)
        if reason is None:
            if backend and os.environ.get("MUJOCO_GL") != backend:
                os.environ["MUJOCO_GL"] = backend
                # MuJoCo reads its environment on import, so the module is reloaded.
                importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))
            return True, backend or "native OpenGL"
        reasons.append(f"{backend or 'OpenGL'}: {reason}")
    return False, f"no usable OpenGL ({'; '.join(reasons)}); {_REMEDY}"


def _failure(backend: str) -> str | None:
    """Return the last line of a test's error output; None if it made a context."""
    try:
        return (_begun.pop(backend, None) or _trial(backend))()
    except OSError as error:
        return str(error)


def _trial(backend: str) -> Callable[[], str | None]:
    """Begin to make a context in another process. Return a function that waits for the reason of a failure."""
    # A copy of this process has imported MuJoCo already.
    if can_copy():
        copied = Fork(partial(_make_context, backend))
        return lambda: _answer(copied)
    # MuJoCo and PyOpenGL read the backend from the environment.
    environment = dict(os.environ)
    if backend:
        environment["MUJOCO_GL"] = backend
    if backend in ("egl", "osmesa"):
        environment["PYOPENGL_PLATFORM"] = backend
    process = subprocess.Popen(
        [sys.executable, "-c", _PROBE],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    return lambda: _last_error(process)


def _answer(copied: Fork[str]) -> str | None:
    with copied:
        return copied.result(PATIENCE) or None


def _make_context(backend: str) -> str:
    """Make a context in a copy of this process; return the reason of a failure, empty without one."""
    if parent_process() is None:
        return "its driver crashes, or gives no answer"
    # Drivers print warnings.
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    if backend:
        os.environ["MUJOCO_GL"] = backend
        importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))
    try:
        _opengl().make_current()
        mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
    except Exception as error:
        return (str(error).splitlines() or [type(error).__name__])[-1][:160]
    return ""


def _last_error(trial: subprocess.Popen[str]) -> str | None:
    with trial:
        try:
            _, errors = trial.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired as error:
            trial.kill()
            return str(error)
    if trial.returncode == 0:
        return None
    return (errors.strip().splitlines() or [f"exit {trial.returncode}"])[-1][:160]


@cache
def _opengl() -> Any:
    """Return the OpenGL context of this process.

    One context serves all pictures: a new one takes 0.2 s, and its driver recompiles all shaders.
    """
    contexts = importlib.import_module("mujoco.rendering.classic.gl_context")
    return contexts.GLContext(*CANVAS)


class Painter:
    """Renderer of one model; a context manager for use in one thread.

    Args:
        model: the model, which is copied.
        width: width of the picture, pixels.
        height: height of the picture, pixels.
        draft: no shadows, and coarser curves and edges. A film frame then takes 12 ms of CPU
            without a GPU, instead of 30 ms.

    Raises:
        RuntimeError: no usable OpenGL (test `gl_available` first).

    Attributes:
        used: class attribute; True if this process has rendered.
    """

    used = False

    def __init__(
        self, model: mujoco.MjModel, width: int, height: int, *, draft: bool = False
    ) -> None:
        usable, reason = gl_available()
        if not usable:
            raise RuntimeError(reason)
        # Set size and quality on a copy, so that the caller's model stays unchanged.
        model = copy(model)
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        model.vis.quality.shadowsize = 0 if draft else SHADOW_MAP
        if draft:
            model.vis.quality.numslices, model.vis.quality.numstacks = 16, 8
            # The stubs of MuJoCo 4.0 lack it.
            model.vis.quality.offsamples = 0  # pyright: ignore[reportAttributeAccessIssue]
        model.vis.headlight.ambient[:] = np.maximum(model.vis.headlight.ambient, AMBIENT)
        self.model, self.aspect = model, width / height
        Painter.used = True
        self._opengl = _opengl()
        self._opengl.make_current()
        # Render into the off-screen buffer.
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene, self._options = mujoco.MjvScene(model, MOST_GEOMS), mujoco.MjvOption()
        self._rect = mujoco.MjrRect(0, 0, width, height)

    def paint(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> Pixels:
        """Render forwarded `data` from a free camera, or from a named camera of the model."""
        self._render(data, camera)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return pixels[::-1].copy()  # OpenGL rows start at the bottom

    def distances(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> Array:
        """Distances (height, width) along the view, m; those without geometry are at the far plane."""
        self._render(data, camera)
        buffer = np.empty((self._rect.height, self._rect.width), np.float32)
        mujoco.mjr_readPixels(None, buffer, self._rect, self._context)
        # MuJoCo's clip distances are relative to the extent of the model.
        extent, clip = self.model.stat.extent, self.model.vis.map
        near, far = clip.znear * extent, clip.zfar * extent
        # The depth buffer d is linear in 1 / z: z = n f / (f − d (f − n)), with near plane n and
        # far plane f.
        return near * far / (far - buffer[::-1].astype(float) * (far - near))

    def _render(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> None:
        # A name selects a fixed camera of the model.
        view = camera if isinstance(camera, mujoco.MjvCamera) else mujoco.MjvCamera()
        if isinstance(camera, str):
            view.type = mujoco.mjtCamera.mjCAMERA_FIXED
            view.fixedcamid = self.model.camera(camera).id
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, data, self._options, None, view, every, self._scene)
        self._opengl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)

    def bodies(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> NDArray[np.int_]:
        """Body (height, width) in each pixel of a picture; 0 for the world and the background."""
        # Segmentation mode of MuJoCo's renderer.
        flags = mujoco.mjtRndFlag
        numbered = [int(flags.mjRND_SEGMENT), int(flags.mjRND_IDCOLOR)]
        self._scene.flags[numbered] = True
        # Render segment numbers as colours: red is the lowest byte.
        colours = self.paint(data, camera) @ np.array([1, 1 << 8, 1 << 16])
        self._scene.flags[numbered] = False
        # Map segment numbers to bodies; number 0 is the background.
        found = np.zeros(self._scene.ngeom + 1, dtype=np.int_)
        for shown in self._scene.geoms[: self._scene.ngeom]:
            if shown.segid >= 0 and shown.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                found[shown.segid + 1] = self.model.geom_bodyid[shown.objid]
        return found[colours]

    def enclose(self, points: Array, **view: float) -> mujoco.MjvCamera:
        """Apply `framing` to `points` for this model and picture."""
        return framing(points, aspect=self.aspect, fovy=float(self.model.vis.global_.fovy), **view)

    def __enter__(self) -> Painter:
        return self

    def __exit__(self, *_: object) -> None:
        self._opengl.make_current()
        self._context.free()


def png(pixels: Pixels) -> bytes:
    """Encode a picture as lossless PNG."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=False, compress_level=PACKING)
    return buffer.getvalue()


def forward_data(model: mujoco.MjModel, qpos: Array | None = None) -> mujoco.MjData:
    """Return forwarded data at configuration `qpos` (nq,), or at the model's initial one."""
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


def geom_rgba(model: mujoco.MjModel, geom: int) -> Array:
    """Colour and opacity (4,) of a geom, 0 to 1: of its material, else its own."""
    material = int(model.geom_matid[geom])
    return model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]


def extent(model: mujoco.MjModel, data: mujoco.MjData, bodies: Collection[str] = ()) -> Array:
    """World corners (n, 3) of the bounding boxes of geoms, m.

    The geoms are those of the named bodies and their children, or of all bodies by default.
    Infinite planes are left out.
    """
    # MuJoCo orders parents before children, so one pass marks all descendants.
    wanted = [not bodies]
    for body in range(1, model.nbody):
        named = model.body(body).name in bodies
        wanted.append(not bodies or named or wanted[int(model.body_parentid[body])])
    corners: list[Array] = []
    for geom in range(model.ngeom):
        is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        if wanted[int(model.geom_bodyid[geom])] and not is_plane:
            corners.append(geom_corners(model, data, geom))
    return np.concatenate(corners) if corners else EMPTY_EXTENT


def geom_corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """World corners (8, 3) of the bounding box of a geom, m."""
    local = model.geom_aabb[geom, :3] + CORNERS * model.geom_aabb[geom, 3:]
    return data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T


def pad_box(points: Array, low: Sequence[float], high: Sequence[float]) -> Array:
    """Corners (8, 3) of the bounding box of points (n, 3), m, enlarged at its lower and upper end by (3,) m."""
    least, most = points.min(axis=0) - np.array(low), points.max(axis=0) + np.array(high)
    return np.array(list(product(*zip(least, most, strict=True))))


def directions(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """Unit vectors (3,) forward, right and up of MuJoCo's free camera; angles in degrees."""
    # Spherical coordinates of the view direction; right is horizontal.
    az, el = np.radians([azimuth, elevation])
    forward = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    right = np.array([np.sin(az), -np.cos(az), 0.0])
    return forward, right, np.cross(right, forward)


def framing(
    points: Array,
    *,
    aspect: float,
    fovy: float,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    margin: float = 1.08,
) -> mujoco.MjvCamera:
    """Return the nearest free camera in this direction, degrees, with all `points` (n, 3), m, in view.

    `aspect` is width over height of the picture. `fovy` is its vertical field of view, degrees, which must equal
    the model's `vis.global_.fovy`. `margin` is a factor of the required width and height.
    """
    # Start from the centre of the box.
    forward, right, up = directions(azimuth, elevation)
    lookat = (points.min(0) + points.max(0)) / 2
    offset = points - lookat
    # Centre the projection instead of the box, because perspective enlarges near corners.
    for axis in (up, right):
        values = offset @ axis
        lookat = lookat + axis * float((values.min() + values.max()) / 2)
    offset = points - lookat
    # A point at depth z is in view if |y| ≤ z tan(fovy / 2) and |x| ≤ z tan(fovy / 2) · aspect.
    tangent = np.tan(np.radians(fovy) / 2)
    needed = margin * np.maximum(
        abs(offset @ up) / tangent, abs(offset @ right) / (tangent * aspect)
    )
    # The distance is the largest one that any point requires.
    camera = mujoco.MjvCamera()
    camera.lookat[:] = lookat
    camera.distance = float(np.max(needed - offset @ forward))
    camera.azimuth, camera.elevation = azimuth, elevation
    return camera
