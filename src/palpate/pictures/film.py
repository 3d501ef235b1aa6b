"""Footage of a cell's camera, and the film made of it: H.264, yuv420p, which every browser plays."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.geometry.pose import Array
from palpate.pictures.moments import in_view, moving_bodies
from palpate.pictures.renderer import Painter, Pixels, extent
from palpate.pictures.stage import staged
from palpate.trace.samples import Trace

FPS = 10.0
SPEED = 2.5
"""Speed of a film relative to robot time; long runs are faster still."""
LONGEST = 20.0
"""Longest film, s, so that the page stays small and is made in seconds without a GPU."""
SIZE = (624, 416)
QUALITY = 27
"""x264's constant rate factor: about 100 kB for 10 s at 640 x 400."""
SAMPLES = 12
"""Configurations of which the camera has the work in view."""


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """Footage of the cell's 30 Hz camera: the world's model and its configurations, (t in s, qpos),
    to be rendered.

    Attributes:
        spec: what the model was compiled from, with its bodies' looks; None: draw collision shapes.
        believed: a replay of the trace, not seen by a camera.
    """

    model: mujoco.MjModel
    frames: tuple[tuple[float, Array], ...]
    spec: mujoco.MjSpec | None = None
    believed: bool = False

    def drawn(self, *, soft: bool = True) -> mujoco.MjModel:
        """The model for pictures, with `soft` or hard shadows."""
        return self.model if self.spec is None else staged(self.spec, soft=soft)


@dataclass(frozen=True, slots=True)
class Film:
    """An MP4 and its speed relative to robot time; `believed`: a replay of the trace, not seen by a
    camera."""

    mp4: bytes
    speed: float
    believed: bool = False


def film_of(footage: Footage, trace: Trace | None) -> Film | None:
    """Make the film of a footage; None without frames.

    Raises:
        RuntimeError: no usable OpenGL.
        OSError: it cannot be encoded.
    """
    t, qpos = frames_of(footage.frames)
    made = film(footage.model, t, qpos, trace, footage.drawn(soft=False))
    return None if made is None else replace(made, believed=footage.believed)


def frames_of(stored: Sequence[tuple[float, Array]]) -> tuple[Array, Array]:
    """Stored `(t, qpos)` pairs as the two arrays `film` takes."""
    return np.array([t for t, _ in stored]), np.array([qpos for _, qpos in stored])


def film_speed(seconds: float) -> float:
    """Speed of the film of a run of `seconds`, relative to robot time."""
    return max(SPEED, float(np.ceil(seconds / LONGEST)))


def film(
    model: mujoco.MjModel,
    t: Array,
    qpos: Array,
    trace: Trace | None = None,
    drawn: mujoco.MjModel | None = None,
) -> Film | None:
    """The run as a film, from stored frames: times `t` (n,) in s and configurations `qpos` (n, nq).
    None without frames. `drawn`: the model for pictures.

    With a trace, each frame states the running leaves and the measured force.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    if len(t) == 0:
        return None
    speed = film_speed(float(t[-1] - t[0]))
    rows = np.searchsorted(t, np.arange(t[0], t[-1], speed / FPS))
    if len(rows) == 0:
        return None
    # One camera for all frames: it has everything that moves in view, wherever it goes.
    data, moving = mujoco.MjData(model), moving_bodies(model)
    corners: list[Array] = []
    for configuration in qpos[rows][:: max(1, len(rows) // SAMPLES)]:
        data.qpos[:] = configuration
        mujoco.mj_kinematics(model, data)
        corners.append(extent(model, data, moving))
    points = in_view(model, np.concatenate(corners))
    encoded = mp4(_frames(drawn or model, t[rows], qpos[rows], trace, points), FPS)
    return None if encoded is None else Film(encoded, speed)


def _frames(
    model: mujoco.MjModel, t: Array, qpos: Array, trace: Trace | None, points: Array
) -> Iterator[Pixels]:
    data = mujoco.MjData(model)
    with Painter(model, *SIZE, draft=True) as painter:
        camera = painter.around(points)
        for now, configuration in zip(t, qpos, strict=True):
            data.qpos[:] = configuration
            mujoco.mj_forward(model, data)
            picture = painter.paint(data, camera)
            yield picture if trace is None else _captioned(picture, trace, float(now))


def _captioned(picture: Pixels, trace: Trace, t: float) -> Pixels:
    """The picture with a dark band at its foot: at the left the leaves that run at robot time `t`, at
    the right force and time."""
    figures = f"   {t:5.1f} s"
    if len(trace.samples):
        row = min(int(np.searchsorted(trace.samples.t, t)), len(trace.samples) - 1)
        figures = f"Fz {trace.samples.wrench[row, 2]:+5.1f} N{figures}"
    leaves = " + ".join(leaf.label for leaf in trace.leaves if leaf.start <= t < leaf.end)
    image, font = Image.fromarray(picture), _font()
    draw = ImageDraw.Draw(image, "RGBA")
    width, height = image.size
    while len(leaves) > 1 and draw.textlength(leaves, font=font) > width - 190:
        leaves = leaves[:-2] + "…"
    top = height - 22
    draw.rectangle((0, height - 28, width, height), fill=(15, 20, 26, 190))
    draw.text((12, top), leaves, font=font, fill=(240, 244, 248, 255))
    draw.text((width - 12, top), figures, font=font, fill=(94, 234, 212, 255), anchor="ra")
    return np.asarray(image)


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Font of the captions; it takes longer to unpack than a caption to write."""
    return ImageFont.load_default(size=14)


def mp4(frames: Iterable[Pixels], fps: float) -> bytes | None:
    """An MP4 file's bytes, or None when there is no frame.

    `frames` are (height, width, 3) RGB, all of one size; an odd last row or column is dropped, as
    the pixel format asks.
    """
    from imageio_ffmpeg import write_frames

    source = iter(frames)
    first = next(source, None)
    if first is None:
        return None
    height, width = (n - n % 2 for n in first.shape[:2])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        writer = write_frames(
            str(path),
            (width, height),
            fps=fps,
            codec="libx264",
            pix_fmt_out="yuv420p",
            quality=None,
            macro_block_size=2,
            ffmpeg_log_level="error",
            output_params=["-crf", str(QUALITY), "-preset", "veryfast", "-movflags", "+faststart"],
        )
        writer.send(None)  # imageio_ffmpeg's writer is a generator: this starts it
        try:
            for frame in chain([first], source):
                writer.send(np.ascontiguousarray(frame[:height, :width]))
        finally:
            writer.close()
        return path.read_bytes()
