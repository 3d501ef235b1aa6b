"""Footage of a cell's camera, and the film made of it: H.264, yuv420p, which every browser plays."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
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
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Samples, Trace

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
APART = 0.05
"""m between the ends of what two shots have in view, for them to look alike: a third of the surroundings in view."""
Caption = tuple[str, str]
"""Texts at the left and at the right of a picture's foot."""
NOTHING: Caption = ("", "")
Frame = tuple[Array, Caption]
"""A configuration (nq,), and what is said below."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """Speed and field of view of a film.

    Attributes:
        speed: relative to robot time.
        points: (n, 3), m, in view: everything that moves, wherever it goes.
    """

    speed: float
    points: Array

    @classmethod
    def of(cls, footage: Footage) -> Shot:
        """The shot for a footage with frames."""
        model, frames = footage.model, footage.frames
        data, moving = mujoco.MjData(model), moving_bodies(model)
        corners: list[Array] = []
        for _, configuration in frames[:: max(1, len(frames) // SAMPLES)]:
            data.qpos[:] = configuration
            mujoco.mj_kinematics(model, data)
            corners.append(extent(model, data, moving))
        seconds = frames[-1][0] - frames[0][0]
        return cls(film_speed(seconds), in_view(model, np.concatenate(corners)))

    def serves(self, wanted: Shot) -> bool:
        """True if this hardly differs from what is `wanted`."""
        both = [
            np.array([one.points.min(axis=0), one.points.max(axis=0)]) for one in (self, wanted)
        ]
        return self.speed == wanted.speed and bool((np.abs(both[0] - both[1]) < APART).all())

    def rows(self, footage: Footage) -> list[int]:
        """Numbers of the frames to draw."""
        t = np.array([t for t, _ in footage.frames])
        return np.searchsorted(t, np.arange(t[0], t[-1], self.speed / FPS)).tolist()


def film_of(footage: Footage, trace: Trace | None) -> Film | None:
    """Make the film of a footage; None without frames.

    With a trace, each frame states the running leaves and the measured force.

    Raises:
        RuntimeError: no usable OpenGL.
        OSError: it cannot be encoded.
    """
    if not footage.frames:
        return None
    shot = Shot.of(footage)
    frames = [footage.frames[row] for row in shot.rows(footage)]
    said = [NOTHING] * len(frames)
    if trace is not None:
        said = captions(trace.leaves, trace.samples, [t for t, _ in frames])
    configurations = (qpos for _, qpos in frames)
    return filmed(footage, shot, zip(configurations, said, strict=True))


def film_speed(seconds: float) -> float:
    """Speed of the film of a run of `seconds`, relative to robot time."""
    return max(SPEED, float(np.ceil(seconds / LONGEST)))


def filmed(footage: Footage, shot: Shot, frames: Iterable[Frame]) -> Film | None:
    """The film of some frames of a footage; None without any.

    Raises:
        RuntimeError: no usable OpenGL.
        OSError: it cannot be encoded.
    """
    encoded = mp4(_pictures(footage, shot, frames), FPS)
    return None if encoded is None else Film(encoded, shot.speed, footage.believed)


def _pictures(footage: Footage, shot: Shot, frames: Iterable[Frame]) -> Iterator[Pixels]:
    model = footage.drawn(soft=False)
    data = mujoco.MjData(model)
    # One camera for all frames.
    with Painter(model, *SIZE, draft=True) as painter:
        camera = painter.around(shot.points)
        for configuration, caption in frames:
            data.qpos[:] = configuration
            mujoco.mj_forward(model, data)
            picture = painter.paint(data, camera)
            yield picture if caption == NOTHING else _captioned(picture, caption)


def captions(leaves: Sequence[LeafRun], samples: Samples, times: Sequence[float]) -> list[Caption]:
    """Captions at robot times, s: the leaves that run then; force and time."""
    said: list[Caption] = []
    rows = np.searchsorted(samples.t, times).clip(max=len(samples) - 1)
    for now, row in zip(times, rows.tolist(), strict=True):
        force = f"Fz {samples.wrench[row, 2]:+5.1f} N" if len(samples) else ""
        labels = [leaf.label for leaf in leaves if leaf.start <= now < leaf.end]
        said.append((" + ".join(labels), f"{force}   {now:5.1f} s"))
    return said


def _captioned(picture: Pixels, caption: Caption) -> Pixels:
    """The picture with a caption in a dark band at its foot."""
    leaves, figures = caption
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
