"""Films: their frames, captions and speed; made on a thread of their own, and cancelled."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import mujoco
import numpy as np
import pytest

from palpate.pictures import film as films
from palpate.pictures.film import (
    FPS,
    LONGEST,
    SPEED,
    Film,
    Filming,
    Footage,
    film,
    frames_of,
    mp4,
)
from palpate.pictures.renderer import gl_available
from palpate.trace.samples import Trace

usable, reason = gl_available()
needs_gl = pytest.mark.skipif(not usable, reason=reason)

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
FOOTAGE = Footage(MODEL, ((0.0, np.zeros(0)), (1.0, np.zeros(0))))
BALL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <body name="table" pos="0 0 0.5"><geom type="box" size=".3 .4 .02" rgba=".8 .6 .4 1"/></body>
  <body name="ball" pos="0 0 .6"><freejoint/><geom size=".05" rgba="1 0 0 1"/></body>
</worldbody></mujoco>""")


@pytest.fixture
def with_gl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films, "gl_available", lambda: (True, "egl"))


@pytest.mark.usefixtures("with_gl")
def test_a_film_is_made_on_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    def quick(*_: Any, **__: Any) -> Film:
        return Film(threading.current_thread().name.encode(), 1.0)

    monkeypatch.setattr(films, "film", quick)
    with Filming(FOOTAGE, None) as made:
        found = made.film()
    assert found is not None
    assert found.mp4.startswith(b"film")


@pytest.mark.usefixtures("with_gl")
def test_other_work_follows_the_film_and_is_cancelled_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[str] = []

    def endless(*_: Any, cancelled: Any, **__: Any) -> None:
        while not cancelled() and len(done) < 1:
            pass

    monkeypatch.setattr(films, "film", endless)
    with Filming(FOOTAGE, None) as made:
        after = made.next(lambda: done.append("pictures"))
        done.append("film")
        after.result()
    assert done == ["film", "pictures"]
    done.clear()
    with Filming(FOOTAGE, None) as made:
        never = made.next(lambda: done.append("pictures"))
    assert never.cancelled()
    assert done == []


@pytest.mark.usefixtures("with_gl")
def test_an_encoding_error_is_raised_where_the_film_is_wanted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise OSError("no encoder")

    monkeypatch.setattr(films, "film", broken)
    with Filming(FOOTAGE, None) as made, pytest.raises(OSError, match="no encoder"):
        made.film()


@pytest.mark.usefixtures("with_gl")
def test_a_film_is_cancelled_when_its_context_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, ended = threading.Event(), threading.Event()

    def endless(*_: Any, cancelled: Any, **__: Any) -> None:
        begun.set()
        while not cancelled():
            pass
        ended.set()

    monkeypatch.setattr(films, "film", endless)
    with Filming(FOOTAGE, None):
        assert begun.wait(10)
    assert ended.is_set()


def test_there_is_no_film_without_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films, "gl_available", lambda: (False, "none"))
    with Filming(FOOTAGE, None) as made:
        assert made.film() is None


@needs_gl
def test_a_film_plays_the_frames_faster(trace: Trace, tmp_path: Path) -> None:
    frames = [(t, np.array([0, 0, 0.6 + 0.01 * t, 1, 0, 0, 0])) for t in np.arange(0, 5, 1 / 30)]
    result = film(BALL, *frames_of(frames), trace)
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
    result = film(BALL, *frames_of(frames[:: len(frames) // 4]))
    assert result is not None
    assert result.speed >= 6


def test_without_frames_there_is_no_film() -> None:
    assert film(BALL, np.empty(0), np.empty((0, 7))) is None
    assert mp4([], 10) is None


def test_frames_of_odd_size_are_cropped(tmp_path: Path) -> None:
    path = tmp_path / "odd.mp4"
    content = mp4((np.full((31, 41, 3), shade, np.uint8) for shade in (0, 120, 240)), 10)
    assert content is not None
    path.write_bytes(content)
    assert iio.imread(path, plugin="FFMPEG").shape[1:] == (30, 40, 3)
