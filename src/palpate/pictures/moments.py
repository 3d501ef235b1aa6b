"""The report's pictures: the scene before and after, and the run as a film."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product, takewhile

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.geometry.pose import Array
from palpate.pictures.dress import Looks, looks_in
from palpate.pictures.film import mp4
from palpate.pictures.framing import extent, points_over
from palpate.pictures.renderer import Painter, Pixels, png
from palpate.pictures.stage import staged
from palpate.trace.samples import Trace

FPS = 10.0
SPEED = 2.5
"""A film runs so many times faster than robot time; long runs faster still."""
LONGEST = 20.0
"""s: no film is longer, so that the page stays small and made in seconds without a GPU."""
AROUND, BELOW = 0.15, 0.10
"""m around and below what can move: of the rest, so much is in view."""
SIZE = (624, 416)


@dataclass(frozen=True, slots=True)
class Film:
    """An MP4 and how many times faster than robot time it plays. `believed`: no camera saw it: it is
    the trace, played again."""

    mp4: bytes
    speed: float
    believed: bool = False


def render_before_after(
    before: mujoco.MjSpec,
    after: mujoco.MjSpec,
    bodies: Collection[str] = (),
    *,
    looks: Looks | None = None,
    width: int = 960,
    height: int = 640,
) -> tuple[bytes, bytes]:
    """Two PNGs from one camera that has the named bodies (all, when none is named) of both scenes
    in view. `looks`: how bodies look; as the scene `before` says, unless given.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    worn = looks_in(before) if looks is None else looks
    points = np.concatenate([_points(spec, bodies) for spec in (before, after)])
    pictures = [_still(spec, worn, points, (width, height)) for spec in (before, after)]
    return pictures[0], pictures[1]


def render_scene(
    spec: mujoco.MjSpec, bodies: Collection[str] = (), *, width: int = 960, height: int = 640
) -> bytes:
    """A PNG of the scene as it stands.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    return _still(spec, looks_in(spec), _points(spec, bodies), (width, height))


def render_moment(
    model: mujoco.MjModel,
    qpos: Array,
    drawn: mujoco.MjModel | None = None,
    *,
    width: int = 960,
    height: int = 640,
) -> bytes:
    """A PNG of a world at configuration `qpos` (nq,), robot included: the first stored frame is the
    workspace. `drawn`: the world as it is to look.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    data = _forwarded(model, qpos)
    points = _of_interest(model, extent(model, data, _loose(model)))
    painted = drawn or model
    with Painter(painted, width, height) as painter:
        return png(painter.paint(_forwarded(painted, qpos), painter.around(points)))


def film(
    model: mujoco.MjModel,
    t: Array,
    qpos: Array,
    trace: Trace | None = None,
    bodies: Collection[str] = (),
    drawn: mujoco.MjModel | None = None,
    given_up: Callable[[], bool] = lambda: False,
) -> Film | None:
    """The run, from stored frames: times `t` (n,) in s and configurations `qpos` (n, nq). None
    without frames, and as soon as it is `given_up`. `drawn`: the world as it is to look.

    With a trace, each frame says which leaf runs and which force is measured.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    if len(t) == 0:
        return None
    speed = film_speed(float(t[-1] - t[0]))
    rows = np.searchsorted(t, np.arange(t[0], t[-1], speed / FPS))
    seen = qpos[rows][:: max(1, len(rows) // 12)]
    points = _of_interest(model, points_over(model, seen, bodies or _loose(model)))
    frames = _frames(drawn or model, t[rows], qpos[rows], trace, points)
    encoded = mp4(takewhile(lambda _: not given_up(), frames), FPS)
    return Film(encoded, speed) if encoded and not given_up() else None


def film_speed(seconds: float) -> float:
    """Speed of the film of a run of `seconds`, relative to robot time."""
    return max(SPEED, float(np.ceil(seconds / LONGEST)))


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
            if trace is not None:
                picture = _captioned(picture, _caption(trace, float(now)))
            yield picture


def _caption(trace: Trace, t: float) -> tuple[str, str]:
    """Caption with the robot's action and force at robot time `t`."""
    running = [leaf.label for leaf in trace.leaves if leaf.start <= t < leaf.end]
    force = ""
    if len(trace.samples):
        row = min(int(np.searchsorted(trace.samples.t, t)), len(trace.samples) - 1)
        force = f"Fz {trace.samples.wrench[row, 2]:+5.1f} N"
    return " + ".join(running), f"{force}   {t:5.1f} s"


def _captioned(picture: Pixels, caption: tuple[str, str]) -> Pixels:
    """The picture with a line of text on a dark band at its foot: words at the left, figures at the
    right."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image, "RGBA")
    font = _font()
    width, height = image.size
    draw.rectangle((0, height - 28, width, height), fill=(15, 20, 26, 190))
    draw.text(
        (12, height - 22),
        _fitting(caption[0], draw, font, width - 190),
        font=font,
        fill=(240, 244, 248, 255),
    )
    draw.text(
        (width - 12, height - 22), caption[1], font=font, fill=(94, 234, 212, 255), anchor="ra"
    )
    return np.asarray(image)


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Of the captions; it takes longer to unpack than a caption to write."""
    return ImageFont.load_default(size=14)


def _fitting(
    text: str,
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    width: int,
) -> str:
    while len(text) > 1 and draw.textlength(text, font=font) > width:
        text = text[:-2] + "…"
    return text


def _of_interest(model: mujoco.MjModel, points: Array) -> Array:
    """Corners (8, 3) around `points` and a part of their support where something can move; else the
    points."""
    if not _loose(model):
        return points
    low = points.min(axis=0) - np.array([AROUND, AROUND, BELOW])
    high = points.max(axis=0) + np.array([AROUND, AROUND, 0.0])
    return np.array(list(product(*zip(low, high, strict=True))))


def _loose(model: mujoco.MjModel) -> list[str]:
    """The names of bodies that can move, an arm's links among them."""
    moving = [i for i in range(1, model.nbody) if model.body_weldid[i]]
    return [model.body(i).name for i in moving if model.body(i).name]


def _points(spec: mujoco.MjSpec, bodies: Collection[str]) -> Array:
    """Corners (n, 3), m, of what is to be in view."""
    model = spec.compile()
    loose = _loose(model)
    named = [name for name in loose if name in bodies] or loose or bodies
    return _of_interest(model, extent(model, _forwarded(model), named))


def _still(spec: mujoco.MjSpec, looks: Looks, points: Array, size: tuple[int, int]) -> bytes:
    model = staged(spec, looks)
    with Painter(model, *size) as painter:
        return png(painter.paint(_forwarded(model), painter.around(points)))


def _forwarded(model: mujoco.MjModel, qpos: Array | None = None) -> mujoco.MjData:
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


def frames_of(stored: Sequence[tuple[float, Array]]) -> tuple[Array, Array]:
    """Stored `(t, qpos)` pairs as the two arrays `film` takes."""
    return np.array([t for t, _ in stored]), np.array([qpos for _, qpos in stored])
