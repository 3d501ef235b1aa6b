from __future__ import annotations

import io

import mujoco
import numpy as np
import pytest
from PIL import Image

from palpate.perception.renderer import gl_available
from palpate.perception.stage import render_before_after, render_moment, render_scene

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
    image = pixels(render_scene(spec(), size=(320, 200)))
    assert image.shape == (200, 320, 3)
    assert image[0].mean() > 120
    rows, columns = np.nonzero(red(image))
    assert len(rows) > 200
    assert 100 < columns.mean() < 220


@needs_gl
def test_pictures_before_and_after_share_a_camera() -> None:
    given = spec(0.45)
    before, after = (pixels(p) for p in render_before_after(given, spec(0.5), size=(320, 200)))
    assert list(given.textures) == []
    np.testing.assert_array_equal(
        np.nonzero(red(before))[1].mean().round(), np.nonzero(red(after))[1].mean().round()
    )
    assert abs(before - after).max() > 50


@needs_gl
def test_a_moment_shows_objects_where_they_were() -> None:
    model = spec().compile()
    low, high = (
        pixels(render_moment(model, np.array([0, 0, z, 1, 0, 0, 0]), size=(320, 200)))
        for z in (0.6, 0.9)
    )
    assert red(low).sum() > 100
    assert np.nonzero(red(low))[0].mean() != np.nonzero(red(high))[0].mean()
