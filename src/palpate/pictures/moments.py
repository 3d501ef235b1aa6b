"""The report's pictures: the scene before and after, and the run as a film."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.geometry.pose import Array
from palpate.pictures.film import mp4
from palpate.pictures.renderer import Painter, Pixels, add_lights, extent, png, points_over
from palpate.trace.samples import Trace

FPS = 10.0
SPEED = 2.5
"""A film runs so many times faster than robot time; long runs faster still."""
LONGEST = 20.0
"""s: no film is longer, so that the page stays small and made in seconds without a GPU."""
BELOW = 0.3
"""m below the lowest thing that can move: what is farther down, such as a table's legs, need not be
in view."""
SIZE = (624, 416)


@dataclass(frozen=True, slots=True)
class Film:
    """An MP4 and how many times faster than robot time it plays."""

    mp4: bytes
    speed: float


def render_before_after(
    before: mujoco.MjSpec,
    after: mujoco.MjSpec,
    bodies: Collection[str] = (),
    *,
    width: int = 960,
    height: int = 640,
) -> tuple[bytes, bytes]:
    """Two PNGs from one camera that has the named bodies (all, when none is named) of both scenes
    in view.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    models = [_with_lights(before), _with_lights(after)]
    posed = [(model, _forwarded(model)) for model in models]
    points = np.concatenate(
        [_of_interest(model, extent(model, data, bodies), data) for model, data in posed]
    )
    pictures: list[bytes] = []
    for model, data in posed:
        with Painter(model, width, height) as painter:
            pictures.append(png(painter.paint(data, painter.around(points))))
    return pictures[0], pictures[1]


def render_scene(
    spec: mujoco.MjSpec, bodies: Collection[str] = (), *, width: int = 960, height: int = 640
) -> bytes:
    """A PNG of the scene as it stands.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    model = _with_lights(spec)
    data = _forwarded(model)
    with Painter(model, width, height) as painter:
        return png(
            painter.paint(
                data, painter.around(_of_interest(model, extent(model, data, bodies), data))
            )
        )


def render_moment(
    model: mujoco.MjModel, qpos: Array, *, width: int = 960, height: int = 640
) -> bytes:
    """A PNG of a world at configuration `qpos` (nq,), robot included: the first stored frame is the
    workspace.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    with Painter(model, width, height) as painter:
        return png(
            painter.paint(data, painter.around(_of_interest(model, extent(model, data), data)))
        )


def film(
    model: mujoco.MjModel,
    t: Array,
    qpos: Array,
    trace: Trace | None = None,
    bodies: Collection[str] = (),
    given_up: Callable[[], bool] = lambda: False,
) -> Film | None:
    """The run, from stored frames: times `t` (n,) in s and configurations `qpos` (n, nq). None
    without frames, and as soon as it is `given_up`.

    With a trace, each frame says which leaf runs and which force is measured.

    Raises:
        RuntimeError: no usable OpenGL.
    """
    if len(t) == 0:
        return None
    speed = film_speed(float(t[-1] - t[0]))
    rows = np.searchsorted(t, np.arange(t[0], t[-1], speed / FPS))
    frames = _frames(model, t[rows], qpos[rows], trace, bodies)
    encoded = mp4(takewhile(lambda _: not given_up(), frames), FPS)
    return Film(encoded, speed) if encoded and not given_up() else None


def film_speed(seconds: float) -> float:
    """How many times faster than robot time the film of a run of `seconds` plays."""
    return max(SPEED, float(np.ceil(seconds / LONGEST)))


def _frames(
    model: mujoco.MjModel, t: Array, qpos: Array, trace: Trace | None, bodies: Collection[str]
) -> Iterator[Pixels]:
    data = mujoco.MjData(model)
    points = points_over(model, qpos[:: max(1, len(qpos) // 12)], bodies)
    points = _of_interest(model, points, _forwarded(model))
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
    """What the robot does, and what it feels, at robot time `t`."""
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
    font = ImageFont.load_default(size=14)
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


def _fitting(
    text: str,
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    width: int,
) -> str:
    while len(text) > 1 and draw.textlength(text, font=font) > width:
        text = text[:-2] + "…"
    return text


def _of_interest(model: mujoco.MjModel, points: Array, data: mujoco.MjData) -> Array:
    """The points, those far below everything that can move raised."""
    loose = [
        model.body(i).name
        for i in range(1, model.nbody)
        if model.body_weldid[i] and model.body(i).name
    ]
    if not loose:
        return points
    floor = extent(model, data, loose)[:, 2].min() - BELOW
    return np.column_stack([points[:, :2], np.maximum(points[:, 2], floor)])


def _with_lights(spec: mujoco.MjSpec) -> mujoco.MjModel:
    copy = spec.copy()
    add_lights(copy)
    return copy.compile()


def _forwarded(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def frames_of(stored: Sequence[tuple[float, Array]]) -> tuple[Array, Array]:
    """Stored `(t, qpos)` pairs as the two arrays `film` takes."""
    return np.array([t for t, _ in stored]), np.array([qpos for _, qpos in stored])
