"""Off-screen pictures of MuJoCo models: which OpenGL there is, a camera that frames the work,
light, PNG.

Pictures are a courtesy: without a usable OpenGL everything else goes on, and `gl_available` says
why and what to do.
"""

from __future__ import annotations

import importlib
import io
import os
import subprocess
import sys
from collections.abc import Collection, Iterable
from copy import copy
from functools import cache
from types import TracebackType

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from palpate.geometry.pose import Array

Pixels = NDArray[np.uint8]
"""(height, width, 3) RGB."""

AZIMUTH, ELEVATION = 145.0, -22.0
"""degrees, MuJoCo's free camera: from in front of the arm, over its left shoulder's side, a little
from above."""

AMBIENT = 0.35
"""Least share of light from everywhere, so that shadows are not black; MuJoCo's default is 0.1."""

_REMEDY = "for pictures install a software OpenGL (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri)"
EMPTY_EXTENT = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.8]])
"""m: what is looked at where there is nothing to see: about a table top."""

_OFF = {"disable", "disabled", "off", "false", "0"}
_PROBE = """
import mujoco
context = mujoco.GLContext(64, 64)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
"""


def gl_available() -> tuple[bool, str]:
    """Whether pictures can be rendered, and the backend's name or, if not, the reason with a remedy
    in one line."""
    chosen = _chosen()
    if chosen in _OFF:
        return False, f"MUJOCO_GL={chosen} switches pictures off; unset it to get them"
    return _usable()


def _chosen() -> str:
    """The backend that the environment names, if any."""
    return os.environ.get("MUJOCO_GL", "").lower().strip()


@cache
def _usable() -> tuple[bool, str]:
    """The first backend that works, or why none does.

    Each backend is tried in a process of its own, because a driver that fails may take its process
    along and PyOpenGL binds to the first backend for good. The first that works is put in
    `MUJOCO_GL`.
    """
    reasons: list[str] = []
    for backend in _backends(_chosen()):
        reason = _probe(backend)
        if reason is None:
            _select(backend)
            return True, backend or "native OpenGL"
        reasons.append(f"{backend or 'OpenGL'}: {reason}")
    return False, f"no usable OpenGL ({'; '.join(reasons)}); {_REMEDY}"


def _backends(chosen: str) -> tuple[str, ...]:
    """What to try: the user's choice, else what the platform has; "" is MuJoCo's own choice."""
    if chosen:
        return (chosen,)
    return ("egl", "osmesa") if sys.platform == "linux" else ("",)


def _probe(backend: str) -> str | None:
    """None when a context can be made, else the last line of what went wrong."""
    environment = dict(os.environ)
    if backend:
        environment["MUJOCO_GL"] = backend
    if backend in ("egl", "osmesa"):
        environment["PYOPENGL_PLATFORM"] = backend
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if done.returncode == 0:
        return None
    return (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1][:160]


def _select(backend: str) -> None:
    """Make MuJoCo use `backend`, although it read its environment when it was imported."""
    if backend and os.environ.get("MUJOCO_GL") != backend:
        os.environ["MUJOCO_GL"] = backend
        importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))


def add_lights(spec: mujoco.MjSpec) -> None:
    """Add what a picture needs and a bare MJCF lacks: a sky, a lamp with shadow. Physics stays as
    it is."""
    textures: list[mujoco.MjsTexture] = list(spec.textures)
    if all(texture.type != mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in textures):
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


def extent(model: mujoco.MjModel, data: mujoco.MjData, bodies: Collection[str] = ()) -> Array:
    """World corners (n, 3) in m of the boxes around the geoms of the named bodies (all, when none
    is named).

    Planes have no end and are left out.
    """
    corners: list[Array] = []
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    for geom in range(model.ngeom):
        is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        if is_plane or not _belongs(model, geom, bodies):
            continue
        local = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
        corners.append(data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T)
    if not corners:
        return EMPTY_EXTENT
    return np.concatenate(corners)


def _belongs(model: mujoco.MjModel, geom: int, bodies: Collection[str]) -> bool:
    body = int(model.geom_bodyid[geom])
    while bodies and body:
        if model.body(body).name in bodies:
            return True
        body = int(model.body_parentid[body])
    return not bodies


def framing(
    points: Array,
    *,
    aspect: float,
    fovy: float = 40.0,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    margin: float = 1.08,
) -> mujoco.MjvCamera:
    """The nearest free camera of that direction that has all `points` (n, 3) in view.

    `fovy` (degrees) must be the model's `vis.global_.fovy`; `aspect` is width over height.
    """
    az, el = np.radians([azimuth, elevation])
    forward = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    right = np.array([np.sin(az), -np.cos(az), 0.0])
    up = np.cross(right, forward)
    lookat = (points.min(0) + points.max(0)) / 2
    offset = points - lookat
    # centre what is seen, not the box: perspective makes near corners larger
    lookat = lookat + up * _middle(offset @ up) + right * _middle(offset @ right)
    offset = points - lookat
    tangent = np.tan(np.radians(fovy) / 2)
    needed = (
        np.maximum(abs(offset @ up) / tangent, abs(offset @ right) / (tangent * aspect)) * margin
    )
    camera = mujoco.MjvCamera()
    camera.lookat[:] = lookat
    camera.distance = float(np.max(needed - offset @ forward))
    camera.azimuth, camera.elevation = azimuth, elevation
    return camera


def _middle(values: Array) -> float:
    return float((values.min() + values.max()) / 2)


class Painter:
    """Renders one model, again and again. A context manager; use it in one thread.

    Raises:
        RuntimeError: no usable OpenGL (ask `gl_available` first).
    """

    def __init__(
        self, model: mujoco.MjModel, width: int = 960, height: int = 600, *, draft: bool = False
    ) -> None:
        """Pixels of the picture; a `draft` has coarser shadows, curves and edges, and takes a quarter
        of the time without a GPU."""
        usable, reason = gl_available()
        if not usable:
            raise RuntimeError(reason)
        model = copy(model)
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        model.vis.quality.shadowsize = 1024 if draft else 4096
        if draft:
            model.vis.quality.numslices, model.vis.quality.numstacks = 16, 8
            # The stubs of MuJoCo 4.0 lack it.
            model.vis.quality.offsamples = 0  # pyright: ignore[reportAttributeAccessIssue]
        model.vis.headlight.ambient[:] = np.maximum(model.vis.headlight.ambient, AMBIENT)
        self.model = model
        self.aspect = width / height
        self._renderer = mujoco.Renderer(model, height, width)

    def paint(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> Pixels:
        """The picture from a free camera, or from the model's named one. `data` must be
        forwarded."""
        self._renderer.update_scene(data, camera)
        return self._renderer.render()

    def around(self, points: Array, **view: float) -> mujoco.MjvCamera:
        """`framing` of `points` for this model and picture."""
        return framing(points, aspect=self.aspect, fovy=float(self.model.vis.global_.fovy), **view)

    def close(self) -> None:
        """Let the OpenGL context go. May be called twice."""
        self._renderer.close()

    def __enter__(self) -> Painter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def png(pixels: Pixels) -> bytes:
    """Encoded losslessly."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=False, compress_level=6)
    return buffer.getvalue()


def points_over(
    model: mujoco.MjModel, poses: Iterable[Array], bodies: Collection[str] = ()
) -> Array:
    """`extent` over several configurations `qpos` (nq,), for a camera that stays."""
    data = mujoco.MjData(model)
    corners: list[Array] = []
    for qpos in poses:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        corners.append(extent(model, data, bodies))
    if not corners:
        return extent(model, data, bodies)
    return np.concatenate(corners)
