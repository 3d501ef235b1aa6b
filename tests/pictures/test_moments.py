from __future__ import annotations

import io
from pathlib import Path

import imageio.v3 as iio
import mujoco
import numpy as np
import pytest
from PIL import Image

from palpate.pictures.film import mp4
from palpate.pictures.moments import (
    FPS,
    LONGEST,
    SPEED,
    film,
    frames_of,
    render_before_after,
    render_moment,
    render_scene,
)
from palpate.pictures.renderer import gl_available
from palpate.trace.samples import Trace

usable, reason = gl_available()
needs_gl = pytest.mark.skipif(not usable, reason=reason)

SCENE = """<mujoco><worldbody>
  <body name="table" pos="0 0 {height}"><geom type="box" size=".3 .4 .02" rgba=".8 .6 .4 1"/></body>
  <body name="ball" pos="0 0 .6"><freejoint/><geom size=".05" rgba="1 0 0 1"/></body>
</worldbody></mujoco>"""


def spec(height: float = 0.5) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(SCENE.format(height=height))


def pixels(picture: bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.int16]]:
    return np.asarray(Image.open(io.BytesIO(picture))).astype(np.int16)


def red(
    image: np.ndarray[tuple[int, ...], np.dtype[np.int16]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    return (image[..., 0] > 100) & (image[..., 1] < 60) & (image[..., 2] < 60)


@needs_gl
def test_a_bare_scene_is_lit_framed_and_has_a_sky() -> None:
    image = pixels(render_scene(spec(), width=320, height=200))
    assert image.shape == (200, 320, 3)
    assert image[0].mean() > 120
    rows, columns = np.nonzero(red(image))
    assert len(rows) > 200
    assert 100 < columns.mean() < 220


@needs_gl
def test_before_and_after_share_a_camera() -> None:
    given = spec(0.45)
    before, after = (
        pixels(p) for p in render_before_after(given, spec(0.5), width=320, height=200)
    )
    assert list(given.textures) == []
    np.testing.assert_array_equal(
        np.nonzero(red(before))[1].mean().round(), np.nonzero(red(after))[1].mean().round()
    )
    assert abs(before - after).max() > 50


@needs_gl
def test_a_moment_shows_things_where_they_were() -> None:
    model = spec().compile()
    low, high = (
        pixels(render_moment(model, np.array([0, 0, z, 1, 0, 0, 0]), width=320, height=200))
        for z in (0.6, 0.9)
    )
    assert red(low).sum() > 100
    assert np.nonzero(red(low))[0].mean() != np.nonzero(red(high))[0].mean()


@needs_gl
def test_a_film_plays_the_frames_faster(trace: Trace, tmp_path: Path) -> None:
    model = spec().compile()
    frames = [(t, np.array([0, 0, 0.6 + 0.01 * t, 1, 0, 0, 0])) for t in np.arange(0, 5, 1 / 30)]
    result = film(model, *frames_of(frames), trace)
    assert result is not None
    assert result.speed == SPEED
    path = tmp_path / "film.mp4"
    path.write_bytes(result.mp4)
    played = iio.imread(path, plugin="FFMPEG")
    assert len(played) == pytest.approx(5 / SPEED * FPS, abs=1)
    bands = played[:, -28:, :250].astype(int)
    assert abs(bands[0] - bands[-1]).max() > 100, "the caption follows the leaves"


@needs_gl
def test_a_long_run_plays_faster_still() -> None:
    frames = [(float(t), np.array([0, 0, 0.6, 1, 0, 0, 0])) for t in np.arange(0, 8 * LONGEST, 2.0)]
    result = film(spec().compile(), *frames_of(frames[:: len(frames) // 4]))
    assert result is not None
    assert result.speed >= 6


def test_no_frames_no_film() -> None:
    assert film(spec().compile(), np.empty(0), np.empty((0, 7))) is None
    assert mp4([], 10) is None


def test_odd_sizes_are_cropped(tmp_path: Path) -> None:
    path = tmp_path / "odd.mp4"
    content = mp4((np.full((31, 41, 3), shade, np.uint8) for shade in (0, 120, 240)), 10)
    assert content is not None
    path.write_bytes(content)
    assert iio.imread(path, plugin="FFMPEG").shape[1:] == (30, 40, 3)
