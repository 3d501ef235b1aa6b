"""Where pictures come from: a file with its intrinsics, a camera or a video by OpenCV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError, Unavailable
from palpate.scene.camera import load_image
from palpate.seeing.lens import Lens, Mount, read_lens
from palpate.seeing.vision import frames

PICTURES = (".png", ".jpg", ".jpeg")
VIDEOS = (".mp4", ".avi", ".mkv", ".mov", ".webm")
FRAMES = 10
"""Frames of a camera or a video that a look takes."""
LARGEST = 8192
"""Pixels: longest side of a picture."""
FORMS = "FILE.png or .jpg, a video FILE.mp4, a camera's number, opencv:0, or world:NAME of a simulated world"


def pictures(
    source: str, intrinsics: Path | None
) -> tuple[list[NDArray[np.uint8]], Lens, Mount | None]:
    """Pictures of a source, its lens, and where its camera is if its file says so.

    Raises:
        InputError: no such source, or no intrinsics.
        Unavailable: a camera that does not answer.
    """
    if intrinsics is None:
        raise InputError(
            "a camera needs its intrinsics: give intrinsics=FILE.yaml with fx, fy, cx, cy and size, or the "
            "file of ROS's camera_calibration"
        )
    lens, mount = read_lens(intrinsics)
    number = source.removeprefix("opencv:")
    suffix = Path(source).suffix.lower()
    if number.isdecimal() and len(number) < 4:
        taken = list(frames(int(number), FRAMES))
    elif suffix in PICTURES:
        taken = [load_image(Path(source), LARGEST)]
    elif suffix in VIDEOS and Path(source).is_file():
        taken = list(frames(source, FRAMES))
    else:
        raise InputError(f"no camera '{source[:100]}': give {FORMS}")
    if not taken:
        raise Unavailable(f"the camera or video '{source[:100]}' gives no picture")
    return taken, lens, mount
