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
from copy import copy
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from palpate.geometry.pose import Array
from palpate.pictures.framing import framing

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

_REMEDY = "for pictures install a software OpenGL (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri)"

_OFF = {"disable", "disabled", "off", "false", "0"}
_PROBE = """
import mujoco
context = mujoco.GLContext(64, 64)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
"""


def gl_available() -> tuple[bool, str]:
    """Test for a renderer: availability, and the backend's name or the reason with a remedy in one
    line."""
    chosen = _chosen()
    if chosen in _OFF:
        return False, f"MUJOCO_GL={chosen} switches pictures off; unset it to get them"
    return _usable()


def look_ahead() -> None:
    """Begin to try the first backend, beside other work; `gl_available` waits for what comes of it."""
    chosen = _chosen()
    backend = _backends(chosen)[0]
    known = _usable.cache_info().currsize or backend in _begun
    if chosen not in _OFF and not known:
        _begun[backend] = _trial(backend)


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
    """Backends to try: the user's choice, else the platform's; "" is MuJoCo's own choice."""
    if chosen:
        return (chosen,)
    return ("egl", "osmesa") if sys.platform == "linux" else ("",)


def _probe(backend: str) -> str | None:
    """None when a context can be made, else the last line of what went wrong."""
    try:
        trial = _begun.pop(backend, None) or _trial(backend)
    except OSError as error:
        return str(error)
    with trial:
        try:
            _, told = trial.communicate(timeout=60)
        except subprocess.TimeoutExpired as error:
            trial.kill()
            return str(error)
    if trial.returncode == 0:
        return None
    return (told.strip().splitlines() or [f"exit {trial.returncode}"])[-1][:160]


_begun: dict[str, subprocess.Popen[str]] = {}
"""Trials of backends that nobody has waited for yet."""


def _trial(backend: str) -> subprocess.Popen[str]:
    """A process that makes a context.

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


def _select(backend: str) -> None:
    """Make MuJoCo use `backend`, although it read its environment when it was imported."""
    if backend and os.environ.get("MUJOCO_GL") != backend:
        os.environ["MUJOCO_GL"] = backend
        importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))


class Painter:
    """Renders one model, again and again. A context manager; use it in one thread.

    Raises:
        RuntimeError: no usable OpenGL (ask `gl_available` first).
    """

    def __init__(
        self, model: mujoco.MjModel, width: int = 960, height: int = 600, *, draft: bool = False
    ) -> None:
        """Pixels of the picture; a `draft` has no shadows, and coarser curves and edges: a frame
        of a film takes 12 ms of a processor without a GPU, where shadows would make that 30."""
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

    def __exit__(self, *_: object) -> None:
        self.close()


def png(pixels: Pixels) -> bytes:
    """Encoded losslessly."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=False, compress_level=PACKING)
    return buffer.getvalue()
