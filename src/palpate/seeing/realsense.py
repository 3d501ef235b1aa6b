"""A RealSense camera by Intel's pyrealsense2, loaded when first needed: colour pictures, its own intrinsics, and
the depth of the pictures' pixels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError, Unavailable
from palpate.seeing.lens import Lens

WIDTH, HEIGHT, RATE = 1280, 720, 30
"""Of the colour stream, and the depth's, pixels and Hz: all of the D400 family have them."""
PATIENCE = 5000
"""ms for a frame."""
WARM_UP = 15
"""Frames that its exposure takes to settle."""


class RealSense:
    """A running camera.

    Attributes:
        lens: as the device states it.
        depth: (height, width) mm along the view, 0 for none, of the newest picture, if it was started `deep`.
    """

    def __init__(self, serial: str | None = None, deep: bool = False) -> None:
        """Start the camera with this serial number, or the only one.

        Raises:
            InputError: its lens is of a kind that OpenCV's model does not describe.
            Unavailable: no pyrealsense2, or no such camera.
        """
        try:
            import pyrealsense2  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise Unavailable(
                "a RealSense camera needs pyrealsense2: pip install 'palpate[realsense]'"
            ) from None
        rs: Any = pyrealsense2
        self._pipeline = rs.pipeline()
        wanted = rs.config()
        if serial is not None:
            wanted.enable_device(serial)
        wanted.enable_stream(rs.stream.color, WIDTH, HEIGHT, rs.format.rgb8, RATE)
        self.depth: NDArray[np.uint16] | None = None
        self._align: Any = None
        if deep:
            wanted.enable_stream(rs.stream.depth, WIDTH, HEIGHT, rs.format.z16, RATE)
            self._align = rs.align(rs.stream.color)
        try:
            profile = self._pipeline.start(wanted)
        except RuntimeError as error:
            raise Unavailable(f"the RealSense camera does not start: {error}") from None
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
        self.lens = Lens(np.array(matrix), (stated.width, stated.height), distortion)

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield pictures (height, width, 3), RGB, until closed.

        Raises:
            Unavailable: it gives none.
        """
        try:
            for count in range(10**9):
                try:
                    frames = self._pipeline.wait_for_frames(PATIENCE)
                except RuntimeError as error:
                    raise Unavailable(f"the RealSense camera gives no picture: {error}") from None
                frame = frames.get_color_frame()
                if frame and count >= WARM_UP:
                    if self._align is not None:
                        far = self._align.process(frames).get_depth_frame()
                        told = np.array(far.get_data()) * self._millimetres
                        self.depth = told.round().astype(np.uint16)
                    yield np.array(frame.get_data(), dtype=np.uint8)
        finally:
            self.close()

    def close(self) -> None:
        """Stop the camera."""
        self._pipeline.stop()
