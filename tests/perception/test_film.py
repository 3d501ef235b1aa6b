"""Films: their frames, captions and speed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import mujoco
import numpy as np
import pytest

from palpate.perception import film as films
from palpate.perception.film import FPS, LONGEST, SPEED, Film, Footage, film_of, film_speed, mp4
from palpate.perception.renderer import Painter, Pixels, gl_available
from palpate.trace.samples import Trace

usable, reason = gl_available()
needs_gl = pytest.mark.skipif(not usable, reason=reason)

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
FOOTAGE = Footage(MODEL, ((0.0, np.zeros(0)), (1.0, np.zeros(0))))
BALL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <body name="table" pos="0 0 0.5"><geom type="box" size=".3 .4 .02" rgba=".8 .6 .4 1"/></body>
  <body name="ball" pos="0 0 .6"><freejoint/><geom size=".05" rgba="1 0 0 1"/></body>
</worldbody></mujoco>""")


def test_a_film_says_whether_a_camera_saw_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films, "mp4", lambda *_: b"mp4")
    seen, replayed = film_of(FOOTAGE, None), film_of(replace(FOOTAGE, believed=True), None)
    assert (seen, replayed) == (Film(b"mp4", SPEED), Film(b"mp4", SPEED, believed=True))


def test_a_run_without_frames_has_no_film() -> None:
    assert film_of(replace(FOOTAGE, frames=()), None) is None


@needs_gl
def test_a_film_plays_the_frames_faster(trace: Trace, tmp_path: Path) -> None:
    frames = [(t, np.array([0, 0, 0.6 + 0.01 * t, 1, 0, 0, 0])) for t in np.arange(0, 5, 1 / 30)]
    result = film_of(Footage(BALL, tuple(frames)), trace)
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
    result = film_of(Footage(BALL, tuple(frames[:: len(frames) // 4])), None)
    assert result is not None
    assert result.speed >= 6


def test_runs_of_similar_length_play_at_the_same_speed() -> None:
    assert film_speed(239.2) == film_speed(244.5)
    assert film_speed(30.0) == SPEED
    for seconds in (1.0, 50.0, 50.1, 240.0, 3600.0):
        assert seconds / film_speed(seconds) <= LONGEST


def test_a_film_without_pictures_writes_no_file() -> None:
    assert mp4([], 10) is None


def test_frames_of_odd_size_are_cropped(tmp_path: Path) -> None:
    path = tmp_path / "odd.mp4"
    content = mp4((np.full((31, 41, 3), shade, np.uint8) for shade in (0, 120, 240)), 10)
    assert content is not None
    path.write_bytes(content)
    assert iio.imread(path, plugin="FFMPEG").shape[1:] == (30, 40, 3)


@needs_gl
def test_still_moments_are_not_rendered_again(monkeypatch: pytest.MonkeyPatch) -> None:
    rendered: list[float] = []
    paint = Painter.paint

    def count(self: Painter, data: mujoco.MjData, camera: mujoco.MjvCamera) -> Pixels:
        rendered.append(float(data.qpos[2]))
        return paint(self, data, camera)

    monkeypatch.setattr(Painter, "paint", count)
    # The ball rests with a tremor below a quarter of a pixel, then jumps, and rests again.
    heights = [0.6 + (0.0002 if n % 2 else 0.0) + (0.01 if n > 60 else 0.0) for n in range(120)]
    frames = [(n / 30, np.array([0, 0, z, 1, 0, 0, 0])) for n, z in enumerate(heights)]
    assert film_of(Footage(BALL, tuple(frames)), None) is not None
    assert rendered == pytest.approx([0.6, 0.61], abs=3e-4)
