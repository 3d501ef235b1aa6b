"""Sources of pictures: RealSense cameras, OpenCV cameras, and files with intrinsics."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError, PalpateError, Unavailable
from palpate.perception.detection import frames
from palpate.perception.lens import Lens, Mount, read_lens
from palpate.scene.camera import load_image

# px and Hz. Size and rate of the colour and depth streams, available on all D400 cameras.
WIDTH, HEIGHT, RATE = 1280, 720, 30
REALSENSE_TIMEOUT = 5000  # ms. Maximum wait for a frame.
WARM_UP = 15  # Frames skipped until the exposure settles


class RealSense:
    """Running RealSense camera."""

    def __init__(self, serial: str | None = None, deep: bool = False) -> None:
        """Start the camera with this serial number, or the only one.

        Raises:
            InputError: its distortion model is not supported.
            Unavailable: pyrealsense2 or the camera is missing.
        """
        try:
            import pyrealsense2  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise Unavailable(
                "a RealSense camera needs pyrealsense2: pip install 'palpate[realsense]'"
            ) from None
        rs: Any = pyrealsense2
        # Request the colour stream, and the depth stream aligned with it.
        self._pipeline = rs.pipeline()
        wanted = rs.config()
        if serial is not None:
            wanted.enable_device(serial)
        wanted.enable_stream(rs.stream.color, WIDTH, HEIGHT, rs.format.rgb8, RATE)
        # (height, width) distances of the newest picture along the view, mm, 0 for none. None if
        # the camera was started without `deep`.
        self.depth: NDArray[np.uint16] | None = None
        self._align: Any = None
        if deep:
            wanted.enable_stream(rs.stream.depth, WIDTH, HEIGHT, rs.format.z16, RATE)
            self._align = rs.align(rs.stream.color)
        try:
            profile = self._pipeline.start(wanted)
        except RuntimeError as error:
            raise Unavailable(f"the RealSense camera does not start: {error}") from None
        # Only the Brown-Conrady model equals that of OpenCV.
        stated = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
        distortion = np.array(stated.coeffs, dtype=float)
        if distortion.any() and stated.model != rs.distortion.brown_conrady:
            self.close()
            raise InputError(
                f"the RealSense camera states a distortion of another kind ({stated.model}): calibrate its colour "
                "stream, and give intrinsics=FILE.yaml"
            )
        if deep:
            self._millimetres = 1e3 * profile.get_device().first_depth_sensor().get_depth_scale()
        matrix = [[stated.fx, 0.0, stated.ppx], [0.0, stated.fy, stated.ppy], [0.0, 0.0, 1.0]]
        # The lens as stated by the device.
        self.lens = Lens(np.array(matrix), (stated.width, stated.height), distortion)

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield pictures (height, width, 3), RGB, until closed. Raises Unavailable: the camera stopped."""
        try:
            for count in range(10**9):
                try:
                    frames = self._pipeline.wait_for_frames(REALSENSE_TIMEOUT)
                except RuntimeError as error:
                    raise Unavailable(f"the RealSense camera gives no picture: {error}") from None
                frame = frames.get_color_frame()
                # Skip the first frames until the exposure settles.
                if frame and count >= WARM_UP:
                    if self._align is not None:
                        # Depth aligned to the colour pixels, in mm.
                        far = self._align.process(frames).get_depth_frame()
                        told = np.array(far.get_data()) * self._millimetres
                        self.depth = told.round().astype(np.uint16)
                    yield np.array(frame.get_data(), dtype=np.uint8)
        finally:
            self.close()

    def close(self) -> None:
        """Stop the camera."""
        self._pipeline.stop()


# Sources of pictures: a file with intrinsics, a camera or video by OpenCV, a RealSense camera.


PICTURES = (".png", ".jpg", ".jpeg")
VIDEOS = (".mp4", ".avi", ".mkv", ".mov", ".webm")
FRAMES = 10  # Number of frames per look from a camera or video
LARGEST = 8192  # px. Maximum side of a picture.
LIVE = "a camera's number, opencv:0, realsense or realsense:SERIAL"
FORMS = f"FILE.png or .jpg, a video FILE.mp4, {LIVE}, or world:NAME of a simulated world"
REALSENSE = "realsense"
STALE = 1.0  # s. Maximum age of the newest picture of a running camera.
CAMERA_TIMEOUT = 10.0  # s. Maximum wait for the first picture of a camera.

Frames = Iterator[NDArray[np.uint8]]
# (height, width) distances along the view, mm, 0 for none; None for a camera without depth.
Depth = NDArray[np.uint16] | None


def pictures(
    source: str, intrinsics: Path | None, deep: bool = False
) -> tuple[list[NDArray[np.uint8]], Lens, Mount | None, Depth]:
    """Return pictures of a source, its lens, its camera pose if stated, and depth if `deep`.

    Raises:
        InputError: no such source, or no intrinsics.
        Unavailable: the camera does not answer.
    """
    stated = None if intrinsics is None else read_lens(intrinsics)
    # A picture file has no stream and no depth.
    if Path(source).suffix.lower() in PICTURES:
        lens, mount = _require_lens(stated)
        return [load_image(Path(source), LARGEST)], lens, mount, None
    coming, lens, mount, depth = _open_source(source, stated, deep)
    taken = list(islice(coming, FRAMES))
    if not taken:
        raise Unavailable(f"the camera or video '{source[:100]}' gives no picture")
    return taken, lens, mount, depth()


class Stream:
    """Running camera with its newest picture.

    Attributes:
        lens: the lens of its intrinsics file, or as stated by the device.
        mount: its pose, if stated in the file.
        depth: returns the newest depth of a camera that was started `deep` and has one.
    """

    def __init__(self, source: str, intrinsics: Path | None, deep: bool = False) -> None:
        """Start the camera and read its pictures in the background.

        Raises:
            InputError: no such camera, or no intrinsics.
            Unavailable: it does not answer.
        """
        if Path(source).suffix.lower() in (*PICTURES, *VIDEOS):
            raise InputError(
                f"'{source[:100]}' does not see the arm move: give {LIVE}, or world:NAME"
            )
        stated = None if intrinsics is None else read_lens(intrinsics)
        coming, self.lens, self.mount, self.depth = _open_source(source, stated, deep)
        self._source = source
        self._newest: tuple[float, NDArray[np.uint8]] | None = None
        self._failed: PalpateError | None = None
        self._first = threading.Event()
        # Read all pictures in a thread, because the driver queues them and would return old ones.
        threading.Thread(target=self._follow, args=(coming,), daemon=True).start()

    def _follow(self, coming: Frames) -> None:
        try:
            for picture in coming:
                self._newest = time.monotonic(), picture
                self._first.set()
        except PalpateError as error:
            self._failed = error
        self._first.set()

    def latest(self) -> NDArray[np.uint8]:
        """Return the newest picture. Raises Unavailable: the camera has stopped."""
        # Wait for the first picture, then require a fresh one.
        self._first.wait(CAMERA_TIMEOUT)
        if self._failed is not None:
            raise self._failed
        if self._newest is None or time.monotonic() - self._newest[0] > STALE:
            raise Unavailable(f"the camera '{self._source[:100]}' gives no picture any more")
        return self._newest[1]


def _open_source(
    source: str, stated: tuple[Lens, Mount | None] | None, deep: bool
) -> tuple[Frames, Lens, Mount | None, Callable[[], Depth]]:
    """Open a camera or video; return its pictures, lens, pose, and newest depth."""
    # A RealSense camera states its own intrinsics, unless a file replaces them.
    kind, _, rest = source.partition(":")
    if kind == REALSENSE:
        camera = RealSense(rest or None, deep)
        lens, mount = stated or (camera.lens, None)
        return camera.frames(), lens, mount, lambda: camera.depth
    lens, mount = _require_lens(stated)
    # An OpenCV camera is given by its number.
    number = source.removeprefix("opencv:")
    if number.isdecimal() and len(number) < 4:
        return frames(int(number)), lens, mount, lambda: None
    if Path(source).suffix.lower() in VIDEOS and Path(source).is_file():
        return frames(source), lens, mount, lambda: None
    raise InputError(f"no camera '{source[:100]}': give {FORMS}")


def _require_lens(stated: tuple[Lens, Mount | None] | None) -> tuple[Lens, Mount | None]:
    if stated is None:
        raise InputError(
            "a camera needs its intrinsics: give intrinsics=FILE.yaml with fx, fy, cx, cy and size, or the "
            "file of ROS's camera_calibration"
        )
    return stated
