"""Pictures of cameras and videos: a video file by OpenCV, a stream, and a double of pyrealsense2."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate.common.errors import InputError, Unavailable
from palpate.perception import cameras as sources
from palpate.perception.cameras import Stream, pictures
from palpate.perception.detection import detect, sharpness, tag_pixels

cv2 = pytest.importorskip("cv2")
LENS = "{fx: 900, fy: 901, cx: 160, cy: 120, size: [320, 240]}"


@pytest.fixture
def lens(tmp_path: Path) -> Path:
    path = tmp_path / "lens.yaml"
    path.write_text(LENS)
    return path


def sheet(offset: int = 0) -> np.ndarray:
    """A picture (240, 320, 3) of tag 5, some pixels aside."""
    picture = np.full((240, 320, 3), 220, np.uint8)
    tag = np.kron(tag_pixels(5), np.ones((12, 12), np.uint8))
    picture[70:166, 100 + offset : 196 + offset] = tag[..., None]
    return picture


def test_ten_frames_of_a_video_file_are_taken(tmp_path: Path, lens: Path) -> None:
    path = tmp_path / "desk.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (320, 240))
    for i in range(14):
        video.write(cv2.GaussianBlur(sheet(), (0, 0), 3.0) if i == 2 else sheet())
    video.release()
    taken, told, mount, depth = pictures(str(path), lens, deep=True)
    assert depth is None
    assert len(taken) == sources.FRAMES
    assert (told.size, mount) == ((320, 240), None)
    assert sharpness(taken[2]) < 0.5 * sharpness(taken[0])
    ((number, corners),) = detect(taken[0].mean(axis=2).astype(np.uint8), told)
    assert number == 5
    assert corners[0] == pytest.approx([99.5, 69.5], abs=0.1)


def test_a_stream_gives_the_newest_picture(lens: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def coming(_: int) -> Any:
        for i in range(1000):
            yield sheet(i % 50)
            time.sleep(0.01)

    monkeypatch.setattr(sources, "frames", coming)
    stream = Stream("0", lens)
    first = stream.latest()
    time.sleep(0.1)
    assert (stream.latest() != first).any()


def test_a_stream_that_ends_or_fails_is_reported(
    lens: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sources, "frames", lambda _: iter([sheet()]))
    monkeypatch.setattr(sources, "STALE", 0.0)
    stream = Stream("opencv:0", lens)
    time.sleep(0.02)
    with pytest.raises(Unavailable, match="no picture any more"):
        stream.latest()
    with pytest.raises(InputError, match="does not see the arm move"):
        Stream("desk.mp4", lens)


class Double:
    """Stands in for pyrealsense2's pipeline: its calls as its documentation has them, and no more of it. No
    RealSense camera was at hand."""

    stream = SimpleNamespace(color="color", depth="depth")
    format = SimpleNamespace(rgb8="rgb8", z16="z16")
    distortion = SimpleNamespace(brown_conrady="brown", inverse_brown_conrady="inverse")

    def __init__(self, coeffs: list[float], model: str = "brown", broken: str = "") -> None:
        self.asked: list[Any] = []
        self.running = False
        self.broken = broken
        self.intrinsics = SimpleNamespace(
            fx=910.0,
            fy=911.0,
            ppx=640.0,
            ppy=360.0,
            width=1280,
            height=720,
            coeffs=coeffs,
            model=model,
        )

    def pipeline(self) -> Double:
        return self

    def config(self) -> SimpleNamespace:
        return SimpleNamespace(
            enable_device=self.asked.append, enable_stream=lambda *args: self.asked.append(args)
        )

    def start(self, _: Any) -> Any:
        if self.broken == "start":
            raise RuntimeError("No device connected")
        self.running = True
        profile = SimpleNamespace(get_intrinsics=lambda: self.intrinsics)
        stream = SimpleNamespace(as_video_stream_profile=lambda: profile)
        sensor = SimpleNamespace(get_depth_scale=lambda: 0.00025)
        device = SimpleNamespace(first_depth_sensor=lambda: sensor)
        return SimpleNamespace(get_stream=lambda _: stream, get_device=lambda: device)

    def align(self, stream: str) -> SimpleNamespace:
        assert stream == "color"
        far = SimpleNamespace(get_data=lambda: np.full((720, 1280), 5000, np.uint16))
        return SimpleNamespace(process=lambda _: SimpleNamespace(get_depth_frame=lambda: far))

    def wait_for_frames(self, _: int) -> Any:
        if self.broken == "frames":
            raise RuntimeError("Frame didn't arrive within 5000")
        frame = SimpleNamespace(get_data=lambda: np.zeros((720, 1280, 3), np.uint8))
        return SimpleNamespace(get_color_frame=lambda: frame)

    def stop(self) -> None:
        self.running = False


def test_a_realsense_camera_states_its_own_lens(monkeypatch: pytest.MonkeyPatch) -> None:
    double = Double([0.1, -0.2, 0, 0, 0.05])
    monkeypatch.setitem(sys.modules, "pyrealsense2", double)
    taken, told, _, depth = pictures("realsense:0123", None)
    assert (len(taken), depth) == (sources.FRAMES, None)
    assert double.asked == ["0123", ("color", 1280, 720, "rgb8", 30)]
    assert told.matrix[:2].tolist() == [[910.0, 0.0, 640.0], [0.0, 911.0, 360.0]]
    assert told.distortion.tolist() == [0.1, -0.2, 0, 0, 0.05]


def test_a_realsense_camera_gives_depth_in_mm_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    double = Double([0.0] * 5)
    monkeypatch.setitem(sys.modules, "pyrealsense2", double)
    *_, depth = pictures("realsense", None, deep=True)
    assert double.asked[1] == ("depth", 1280, 720, "z16", 30)
    assert depth is not None
    assert (depth.dtype, depth.shape) == (np.uint16, (720, 1280))
    assert (depth == 1250).all()  # 5000 of 0.25 mm, along the colour picture's pixels


@pytest.mark.parametrize(
    ("double", "error", "words"),
    [
        (Double([0.0] * 5, broken="start"), Unavailable, "does not start: No device"),
        (Double([0.0] * 5, broken="frames"), Unavailable, "gives no picture"),
        (Double([0.1] * 5, "inverse"), InputError, "another kind"),
        (None, Unavailable, "pip install 'palpate\\[realsense\\]'"),
    ],
)
def test_a_realsense_camera_that_is_none_is_one_clear_error(
    double: Double | None, error: type[Exception], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", double)
    with pytest.raises(error, match=words):
        pictures("realsense", None)
    assert double is None or not double.running
