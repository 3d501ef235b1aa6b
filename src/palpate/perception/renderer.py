"""Off-screen pictures of MuJoCo models: the OpenGL backend, cameras that frame points, painting, PNG.

Pictures are optional: without a usable OpenGL everything else goes on, and `gl_available` states the
reason and the remedy.
"""

from __future__ import annotations

import importlib
import io
import os
import subprocess
import sys
from collections.abc import Collection, Sequence
from copy import copy
from functools import cache
from itertools import product
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from palpate.common.pose import Array

Pixels = NDArray[np.uint8]
"""(height, width, 3) RGB."""

AMBIENT = 0.35
"""Least share of light from everywhere, so that shadows are not black; MuJoCo's default is 0.1."""
SHADOW_MAP = 1024
"""Pixels: 2048 would leave a few dots less on walls that light grazes, for 0.06 s of a processor more
a picture."""
PACKING = 2
"""Compression level of PNG, 0 to 9: MuJoCo's pictures become a fifth larger than with 6, in a
quarter of the time."""

AZIMUTH, ELEVATION = 145.0, -22.0
"""degrees, MuJoCo's free camera: from in front of the arm, over its left shoulder's side, a little
from above."""
EMPTY_EXTENT = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.8]])
"""m: view of an empty scene, about a table top."""
CANVAS = (64, 64)
"""Pixels of the context's own buffer, in which nothing is drawn."""
MOST_GEOMS = 10_000
"""Geoms drawn in a picture, MuJoCo's default."""
SCENERY: dict[str, Any] = {"mass": 0.0, "contype": 0, "conaffinity": 0}
"""Attributes of a geom that is seen and neither weighs nor collides."""
CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
"""(8, 3) signs of a box's corners."""

_REMEDY = "for pictures install a software OpenGL (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri)"
_OFF = {"disable", "disabled", "off", "false", "0"}
_PROBE = """
import mujoco
context = mujoco.GLContext(64, 64)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
"""
_begun: dict[str, subprocess.Popen[str]] = {}
"""Trials of backends that run in the background."""


def gl_available() -> tuple[bool, str]:
    """Test for a renderer: availability, and the backend's name or the reason with a remedy in one
    line."""
    chosen = _chosen()
    if chosen in _OFF:
        return False, f"MUJOCO_GL={chosen} switches pictures off; unset it to get them"
    return _usable()


def look_ahead() -> None:
    """Start the trial of the first backend in the background; `gl_available` waits for its result."""
    chosen = _chosen()
    backend = _backends(chosen)[0]
    known = _usable.cache_info().currsize or backend in _begun
    if chosen not in _OFF and not known:
        _begun[backend] = _trial(backend)


def _chosen() -> str:
    """The backend that the environment names, if any."""
    return os.environ.get("MUJOCO_GL", "").lower().strip()


def _backends(chosen: str) -> tuple[str, ...]:
    """Backends to try: the user's choice, else the platform's; "" is MuJoCo's own choice."""
    if chosen:
        return (chosen,)
    return ("egl", "osmesa") if sys.platform == "linux" else ("",)


@cache
def _usable() -> tuple[bool, str]:
    """Select the first backend that works, or state why none does.

    Each backend is tried in a separate process, because a driver that fails may take its process
    along and PyOpenGL binds to the first backend for good. The first that works is put in
    `MUJOCO_GL`.
    """
    reasons: list[str] = []
    for backend in _backends(_chosen()):
        reason = _failure(backend)
        if reason is None:
            if backend and os.environ.get("MUJOCO_GL") != backend:
                os.environ["MUJOCO_GL"] = backend
                # MuJoCo read its environment when it was imported.
                importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))
            return True, backend or "native OpenGL"
        reasons.append(f"{backend or 'OpenGL'}: {reason}")
    return False, f"no usable OpenGL ({'; '.join(reasons)}); {_REMEDY}"


def _failure(backend: str) -> str | None:
    """The last line of a trial's error; None when it could make a context."""
    try:
        trial = _begun.pop(backend, None) or _trial(backend)
    except OSError as error:
        return str(error)
    with trial:
        try:
            _, errors = trial.communicate(timeout=60)
        except subprocess.TimeoutExpired as error:
            trial.kill()
            return str(error)
    if trial.returncode == 0:
        return None
    return (errors.strip().splitlines() or [f"exit {trial.returncode}"])[-1][:160]


def _trial(backend: str) -> subprocess.Popen[str]:
    """Start a process that makes a context.

    Raises:
        OSError: it cannot be started.
    """
    environment = dict(os.environ)
    if backend:
        environment["MUJOCO_GL"] = backend
    if backend in ("egl", "osmesa"):
        environment["PYOPENGL_PLATFORM"] = backend
    return subprocess.Popen(
        [sys.executable, "-c", _PROBE],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


@cache
def _opengl() -> Any:
    """OpenGL's context of this process. One for all pictures: a new one takes 0.2 s to set up, and its driver
    compiles all shaders again."""
    contexts = importlib.import_module("mujoco.rendering.classic.gl_context")
    return contexts.GLContext(*CANVAS)


class Painter:
    """Renderer of one model. A context manager; use it in one thread.

    Args:
        width, height: of the picture, pixels.
        draft: no shadows, coarser curves and edges: a film's frame takes 12 ms of a processor without
            a GPU, where shadows would make that 30.

    Raises:
        RuntimeError: no usable OpenGL (ask `gl_available` first).

    Attributes:
        used: of the class: this process has drawn.
    """

    used = False

    def __init__(
        self, model: mujoco.MjModel, width: int, height: int, *, draft: bool = False
    ) -> None:
        usable, reason = gl_available()
        if not usable:
            raise RuntimeError(reason)
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
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene, self._options = mujoco.MjvScene(model, MOST_GEOMS), mujoco.MjvOption()
        self._rect = mujoco.MjrRect(0, 0, width, height)

    def paint(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> Pixels:
        """Render forwarded `data` from a free camera, or from a named one of the model."""
        self._render(data, camera)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return pixels[::-1].copy()  # OpenGL's rows begin at the bottom

    def distances(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> Array:
        """(height, width) m along the view to what each pixel shows, as `paint`; to the far plane where that is
        nothing."""
        self._render(data, camera)
        buffer = np.empty((self._rect.height, self._rect.width), np.float32)
        mujoco.mjr_readPixels(None, buffer, self._rect, self._context)
        extent, clip = self.model.stat.extent, self.model.vis.map
        near, far = clip.znear * extent, clip.zfar * extent
        # The buffer is 0 at the near plane and 1 at the far one, linear in 1 / distance.
        return near * far / (far - buffer[::-1].astype(float) * (far - near))

    def _render(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> None:
        view = camera if isinstance(camera, mujoco.MjvCamera) else mujoco.MjvCamera()
        if isinstance(camera, str):
            view.type = mujoco.mjtCamera.mjCAMERA_FIXED
            view.fixedcamid = self.model.camera(camera).id
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, data, self._options, None, view, every, self._scene)
        self._opengl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)

    def bodies(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> NDArray[np.int_]:
        """(height, width) body that each pixel of a picture shows; 0 for the world, and for nothing."""
        flags = mujoco.mjtRndFlag
        numbered = [int(flags.mjRND_SEGMENT), int(flags.mjRND_IDCOLOR)]
        self._scene.flags[numbered] = True
        # Each colour is a number, from red to blue.
        colours = self.paint(data, camera) @ np.array([1, 1 << 8, 1 << 16])
        self._scene.flags[numbered] = False
        found = np.zeros(self._scene.ngeom + 1, dtype=np.int_)
        for shown in self._scene.geoms[: self._scene.ngeom]:
            if shown.segid >= 0 and shown.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                found[shown.segid + 1] = self.model.geom_bodyid[shown.objid]
        return found[colours]

    def enclose(self, points: Array, **view: float) -> mujoco.MjvCamera:
        """`framing` of `points` for this model and picture."""
        return framing(points, aspect=self.aspect, fovy=float(self.model.vis.global_.fovy), **view)

    def __enter__(self) -> Painter:
        return self

    def __exit__(self, *_: object) -> None:
        self._opengl.make_current()
        self._context.free()


def png(pixels: Pixels) -> bytes:
    """PNG file of a picture, lossless."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=False, compress_level=PACKING)
    return buffer.getvalue()


def forward_data(model: mujoco.MjModel, qpos: Array | None = None) -> mujoco.MjData:
    """Forwarded data at configuration `qpos` (nq,), or at the model's initial one."""
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


def geom_rgba(model: mujoco.MjModel, geom: int) -> Array:
    """(4,) red, green, blue and opacity of a geom, 0 to 1: its material's, else its own."""
    material = int(model.geom_matid[geom])
    return model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]


def extent(model: mujoco.MjModel, data: mujoco.MjData, bodies: Collection[str] = ()) -> Array:
    """World corners (n, 3), m, of the boxes around the geoms of the named bodies and their children
    (all, when none is named), without planes, which have no end."""
    # A parent comes before its children in MuJoCo's order.
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
    """World corners (8, 3), m, of the box around a geom."""
    local = model.geom_aabb[geom, :3] + CORNERS * model.geom_aabb[geom, 3:]
    return data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T


def pad_box(points: Array, low: Sequence[float], high: Sequence[float]) -> Array:
    """Corners (8, 3) of the box around points (n, 3), enlarged by `low` (3,) m at its lower and by
    `high` (3,) m at its upper end."""
    least, most = points.min(axis=0) - np.array(low), points.max(axis=0) + np.array(high)
    return np.array(list(product(*zip(least, most, strict=True))))


def directions(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """Unit vectors (3,) forward, to the right and upward of MuJoCo's free camera, degrees."""
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
    """The nearest free camera of that direction that has all `points` (n, 3) in view.

    `fovy` (degrees) must be the model's `vis.global_.fovy`; `aspect` is width over height.
    """
    forward, right, up = directions(azimuth, elevation)
    lookat = (points.min(0) + points.max(0)) / 2
    offset = points - lookat
    # Centre the projection, not the box: perspective makes near corners larger.
    for axis in (up, right):
        values = offset @ axis
        lookat = lookat + axis * float((values.min() + values.max()) / 2)
    offset = points - lookat
    # A point is in view if it is no farther beside the axis than its depth times the tangent.
    tangent = np.tan(np.radians(fovy) / 2)
    needed = margin * np.maximum(
        abs(offset @ up) / tangent, abs(offset @ right) / (tangent * aspect)
    )
    camera = mujoco.MjvCamera()
    camera.lookat[:] = lookat
    camera.distance = float(np.max(needed - offset @ forward))
    camera.azimuth, camera.elevation = azimuth, elevation
    return camera
