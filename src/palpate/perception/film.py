"""Film of a run: camera frames encoded as H.264 during the arm's motion."""

from __future__ import annotations

import math
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import chain
from multiprocessing import Pipe, parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.common.pose import Array
from palpate.common.processes import Fork, can_copy
from palpate.perception.renderer import Painter, Pixels, extent, gl_available
from palpate.perception.stage import FLOOR, build_stage, in_view, moving_bodies
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Samples, Trace

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


FPS = 8.0
SPEED = 2.5  # Ratio. Playback speed relative to robot time; long runs are faster.
# s. Maximum length of a film. It keeps the report small and rendering fast without a GPU.
LONGEST = 20.0
SIZE = (528, 352)  # px. Size at which the report shows the film on a desktop.
QUALITY = 27  # x264 constant rate factor: about 100 kB for 15 s
BAND = 28  # px. Height of the caption.
# m. Smallest motion of a shape for which a new frame is rendered: a quarter of a pixel.
STILL = 5e-4
SAMPLES = 12  # Number of configurations that determine the view
# m. Maximum difference between the views of two interchangeable shots: a third of the visible
# surroundings.
APART = 0.05
BACKGROUND, OPACITY = (15, 20, 26), 190
INK, ACCENT = (240, 244, 248), (94, 234, 212)
Caption = tuple[str, str]  # Texts at the bottom left and bottom right of a picture
NOTHING: Caption = ("", "")
Frame = tuple[Array, Caption]  # Configuration (nq,) and caption


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """Footage of the cell's 30 Hz camera: model and configurations to be rendered."""

    model: mujoco.MjModel  # the world's model
    frames: tuple[tuple[float, Array], ...]  # times (s) and configurations (nq,)
    # Source of the model with the looks of its bodies; None to draw collision shapes.
    spec: mujoco.MjSpec | None = None
    believed: bool = False  # a replay of the trace rather than a camera recording

    def drawn(self, *, soft: bool = True) -> mujoco.MjModel:
        """Return the model for pictures, with `soft` or hard shadows."""
        return self.model if self.spec is None else build_stage(self.spec, soft=soft)


@dataclass(frozen=True, slots=True)
class Film:
    """MP4 file of a run."""

    mp4: bytes  # the file
    speed: float  # playback speed relative to robot time
    believed: bool = False  # a replay of the trace rather than a camera recording


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """Speed and view of a film."""

    speed: float  # playback speed relative to robot time
    points: Array  # (n, 3) points in view, m: the whole range of everything that moves

    @classmethod
    def of(cls, footage: Footage) -> Shot:
        """Return the shot of a footage, which must have frames."""
        model, frames = footage.model, footage.frames
        data, moving = mujoco.MjData(model), moving_bodies(model)
        # Collect the extents of the moving bodies at samples over the whole run.
        corners: list[Array] = []
        for _, configuration in frames[:: max(1, len(frames) // SAMPLES)]:
            data.qpos[:] = configuration
            mujoco.mj_kinematics(model, data)
            corners.append(extent(model, data, moving))
        seconds = frames[-1][0] - frames[0][0]
        return cls(film_speed(seconds), in_view(model, np.concatenate(corners)))

    def serves(self, wanted: Shot) -> bool:
        """True if this shot hardly differs from the `wanted` one."""
        # Compare the boxes of both views.
        both = [
            np.array([one.points.min(axis=0), one.points.max(axis=0)]) for one in (self, wanted)
        ]
        return self.speed == wanted.speed and bool((np.abs(both[0] - both[1]) < APART).all())

    def rows(self, footage: Footage) -> list[int]:
        """Indices of the frames to render."""
        # Frames at equal intervals of film time, the nearest recorded one after each.
        t = np.array([t for t, _ in footage.frames])
        return np.searchsorted(t, np.arange(t[0], t[-1], self.speed / FPS)).tolist()


def film_of(footage: Footage, trace: Trace | None) -> Film | None:
    """Make the film of a footage; None without frames.

    With a trace, each frame states the running leaves and the measured force.
    """
    if not footage.frames:
        return None
    shot = Shot.of(footage)
    # The caption of each frame needs the trace; without one it is empty.
    frames = [footage.frames[row] for row in shot.rows(footage)]
    said = [NOTHING] * len(frames)
    if trace is not None:
        said = captions(trace.leaves, trace.samples, [t for t, _ in frames])
    configurations = (qpos for _, qpos in frames)
    return film_frames(footage, shot, zip(configurations, said, strict=True))


def film_speed(seconds: float) -> float:
    """Playback speed of the film of a run of `seconds`, relative to robot time.

    It doubles at few durations, so that a planned run and its execution rarely differ in it.
    """
    return SPEED * 2.0 ** max(0, math.ceil(math.log2(max(seconds, 1.0) / (SPEED * LONGEST))))


def film_frames(footage: Footage, shot: Shot, frames: Iterable[Frame]) -> Film | None:
    """Make the film of some frames of a footage; None without frames.

    Raises:
        RuntimeError: no usable OpenGL.
        OSError: encoding failed.
    """
    encoded = mp4(_pictures(footage, shot, frames), FPS)
    return None if encoded is None else Film(encoded, shot.speed, footage.believed)


def _pictures(footage: Footage, shot: Shot, frames: Iterable[Frame]) -> Iterator[Pixels]:
    # Draft quality: hard shadows, and a plain floor. The floor's texture takes a third of the time.
    model = footage.drawn(soft=False)
    painted: Any = model  # The stubs of MuJoCo 4.0 lack its materials.
    for material in range(painted.nmat):
        if painted.mat(material).name == FLOOR:
            painted.mat_texid[material] = -1
    data = mujoco.MjData(model)
    radii = model.geom_rbound[:, None]
    places, picture = np.full((model.ngeom, 12), np.inf), np.empty(0, np.uint8)
    # One static camera for all frames.
    with Painter(model, *SIZE, draft=True) as painter:
        camera = painter.enclose(shot.points)
        for configuration, caption in frames:
            data.qpos[:] = configuration
            mujoco.mj_forward(model, data)
            # A shape moves by at most its shift plus its radius times its turn. While nothing
            # moves visibly, the last picture is shown again.
            now = np.hstack([data.geom_xpos, radii * data.geom_xmat])
            if not np.abs(now - places).max() < STILL:
                picture, places = painter.paint(data, camera), now
            yield picture if caption == NOTHING else _add_caption(picture, caption)


def captions(leaves: Sequence[LeafRun], samples: Samples, times: Sequence[float]) -> list[Caption]:
    """Captions at robot times (s): the running leaves, and force with time."""
    said: list[Caption] = []
    # Force at the sample of each frame, and the leaves that run then.
    rows = np.searchsorted(samples.t, times).clip(max=len(samples) - 1)
    for now, row in zip(times, rows.tolist(), strict=True):
        force = f"Fz {samples.wrench[row, 2]:+5.1f} N" if len(samples) else ""
        labels = [leaf.label for leaf in leaves if leaf.start <= now < leaf.end]
        said.append((" + ".join(labels), f"{force}   {now:5.1f} s"))
    return said


def _add_caption(picture: Pixels, caption: Caption) -> Pixels:
    """Return a picture with a caption in a dark band at its bottom."""
    # Only the band is drawn: it is a twelfth of the picture.
    leaves, figures = caption
    band, font = Image.fromarray(picture[-BAND:]), _font()
    width, middle = band.width, BAND // 2
    band.paste(BACKGROUND, (0, 0), Image.new("L", band.size, OPACITY))
    draw = ImageDraw.Draw(band)
    draw.text((12, middle), _shorten(leaves, width - 190), font=font, fill=INK, anchor="lm")
    draw.text((width - 12, middle), figures, font=font, fill=ACCENT, anchor="rm")
    return np.concatenate([picture[:-BAND], np.asarray(band)])


@lru_cache(maxsize=16)
def _shorten(text: str, width: int) -> str:
    """Cut a text so that it fits into `width` pixels."""
    font = _font()
    while len(text) > 1 and font.getlength(text) > width:
        text = text[:-2] + "…"
    return text


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Font of the captions, cached because loading it takes longer than writing a caption."""
    return ImageFont.load_default(size=14)


def mp4(frames: Iterable[Pixels], fps: float) -> bytes | None:
    """Encode frames as MP4; None without frames.

    `frames` are (height, width, 3) RGB pictures of one size. An odd last row or column is dropped,
    because the pixel format needs even sizes.
    """
    from imageio_ffmpeg import write_frames

    # The first frame determines the size.
    source = iter(frames)
    first = next(source, None)
    if first is None:
        return None
    height, width = (n - n % 2 for n in first.shape[:2])
    # Encode into a file: an MP4 with its index at the start needs seeking.
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
            output_params=f"-crf {QUALITY} -preset veryfast -threads 1 -movflags +faststart".split(),
        )
        writer.send(None)  # starts the generator
        try:
            for frame in chain([first], source):
                writer.send(np.ascontiguousarray(frame[:height, :width]))
        finally:
            writer.close()
        return path.read_bytes()


# Film rendered during the arm's motion by a copy of this process.


Chunk = list[Frame]  # Frames to be rendered next; an empty chunk is the last


class Reel:
    """Film under construction; a context manager that discards an unfinished film on exit.

    A failed film is discarded too and is rendered again at the end, where a failure affects the
    film alone.
    """

    def __init__(
        self, footage: Callable[[], Footage | None], planned: Callable[[], Shot | None]
    ) -> None:
        """Prepare a film.

        Args:
            footage: returns the camera footage so far.
            planned: returns the planned shot; rendering begins once it is known.
        """
        self._footage, self._planned = footage, planned
        self._shot: Shot | None = None
        self._copy: Fork[Film | None] | None = None
        self._sink: Connection | None = None
        self._whole: tuple[Footage, Trace] | None = None
        self._samples: list[Samples] = []
        self._ended: list[LeafRun] = []
        self._leaves = self._sent = 0
        self._failed = False

    def look(self, samples: Samples, leaves: Sequence[LeafRun]) -> None:
        """Render the footage before the last ended leaf, from new samples and all ended leaves of this attempt."""
        if not self._failed:
            with self._failing():
                self._look(samples, leaves)

    def finish(self, footage: Footage, trace: Trace) -> Fork[Film | None] | None:
        """Return the film of the whole execution, in progress; None if it must be rendered again."""
        with self._failing():
            self._finish(footage, trace)
        return self._copy

    def __enter__(self) -> Reel:
        return self

    def __exit__(self, *_: object) -> None:
        self._give_up()

    @contextmanager
    def _failing(self) -> Generator[None]:
        """Discard the film after an exception in the block."""
        try:
            yield
        except Exception:
            self._failed = True
            self._give_up()

    def _give_up(self) -> None:
        if self._copy is not None:
            self._copy.close()
        if self._sink is not None:
            self._sink.close()
        self._copy = self._sink = None

    def _look(self, samples: Samples, leaves: Sequence[LeafRun]) -> None:
        # Collect new samples and the leaves that ended since the last call.
        self._samples.append(samples)
        if len(leaves) < self._leaves:  # a new attempt
            self._leaves = 0
        ended, self._leaves = leaves[self._leaves :], len(leaves)
        self._ended += ended
        if not ended or len(self._ended) < 2:
            return
        # Start the copy once the shot is planned.
        footage = self._footage() if self._copy or self._may_begin() else None
        if footage is None or self._shot is None:
            return
        felt, until = Samples.concatenate(self._samples), self._ended[-2].end
        # Frames up to the end of the last but one leaf: a parallel leaf may not have ended yet.
        chunk = self._chunk(self._shot, footage, felt, self._ended, until)
        self._samples = [felt.where(felt.t >= until)]
        if self._copy is None:
            self._begin(self._shot, footage, chunk)
        elif chunk:
            self._send(chunk)

    def _finish(self, footage: Footage, trace: Trace) -> None:
        if self._copy is None or self._shot is None:
            return
        # The planned view may differ from the actual one; then the film is rendered again.
        if not self._shot.serves(Shot.of(footage)):
            self._give_up()
            return
        self._whole = footage, trace
        self._send(self._chunk(self._shot, footage, trace.samples, trace.leaves))
        self._send([])

    def _may_begin(self) -> bool:
        """True if the shot is known and a copy of this process can render it."""
        if Painter.used or not can_copy():
            return False
        self._shot = self._planned()
        return self._shot is not None and gl_available()[0]

    def _chunk(
        self,
        shot: Shot,
        footage: Footage,
        felt: Samples,
        leaves: Sequence[LeafRun],
        until: float = np.inf,
    ) -> Chunk:
        """Return the frames to be rendered next, up to robot time `until`, s."""
        # Frames that are not sent yet, with their captions.
        frames = [footage.frames[row] for row in shot.rows(footage)[self._sent :]]
        frames = [frame for frame in frames if frame[0] <= until]
        self._sent += len(frames)
        said = captions(leaves, felt, [t for t, _ in frames])
        return [(qpos, caption) for (_, qpos), caption in zip(frames, said, strict=True)]

    def _begin(self, shot: Shot, footage: Footage, chunk: Chunk) -> None:
        source, sink = Pipe(duplex=False)

        # The copy receives frames through a pipe. If it fails, the same function runs in this
        # process.
        def work() -> Film | None:
            if parent_process() is None:  # the copy has failed
                return None if self._whole is None else film_of(*self._whole)
            sink.close()  # so that the source ends with the original process
            return film_frames(footage, shot, _receive_frames(source, chunk))

        self._copy, self._sink = Fork(work), sink
        source.close()

    def _send(self, chunk: Chunk) -> None:
        assert self._sink is not None
        with suppress(OSError):  # the copy has failed
            self._sink.send(chunk)


def _receive_frames(source: Connection, chunk: Chunk) -> Iterator[Frame]:
    """Yield the frames of a first chunk and of those that arrive from `source` meanwhile.

    The source is read immediately, so that the sender does not block.
    """
    waiting, is_open = deque(chunk), True
    while is_open or waiting:
        # Read everything that has arrived; block only if there is nothing to render.
        while is_open and source.poll(0.0 if waiting else None):
            more: Chunk = source.recv()
            waiting.extend(more)
            is_open = bool(more)
        if waiting:
            yield waiting.popleft()
