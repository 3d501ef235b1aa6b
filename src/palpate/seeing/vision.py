"""The little of OpenCV that is used, loaded when first needed: detection of tags, the pose of one square,
frames of cameras and videos."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import Unavailable
from palpate.geometry.pose import Array, Pose
from palpate.seeing.lens import Lens

TAGS = 587
"""AprilTags of the family tag36h11, which are printed and looked for."""
MODULES = 8
"""Modules along a tag's black square."""
CELL = 8
"""Pixels of a side of a module as it is read: with 4, OpenCV's default, a tenth fewer small ones are."""
QUIET = 1
"""Modules of white around it."""
CORNERS = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
"""(4, 3) corners of a tag in its own frame, half sides, in the order in which they are detected."""
WARM_UP = 5
"""Frames that a camera's exposure takes to settle."""

Grey = NDArray[np.uint8]


def opencv() -> ModuleType:
    """OpenCV.

    Raises:
        Unavailable: not installed.
    """
    try:
        import cv2
    except ImportError:
        raise Unavailable("seeing needs OpenCV: pip install 'palpate[see]'") from None
    return cv2


def tag_pixels(number: int) -> Grey:
    """(8, 8) modules of a tag, 0 black or 255 white, as printed."""
    cv2: Any = opencv()
    return np.asarray(
        cv2.aruco.generateImageMarker(_dictionary(cv2), number, MODULES, borderBits=1)
    )


def squares(grey: Grey) -> list[tuple[int, Array]]:
    """Tags in a picture: number and corners (4, 2), to a pixel, clockwise from the upper left as printed."""
    cv2: Any = opencv()
    how = cv2.aruco.DetectorParameters()
    how.perspectiveRemovePixelPerCell = CELL
    corners, numbers, _ = cv2.aruco.ArucoDetector(_dictionary(cv2), how).detectMarkers(grey)
    if numbers is None:
        return []
    found = zip(np.ravel(numbers).tolist(), corners, strict=True)
    return [(int(number), np.asarray(where, dtype=float).reshape(4, 2)) for number, where in found]


def square_poses(lens: Lens, corners: Array, half: float) -> list[Pose]:
    """The two poses of a square, `half` a side in m, in OpenCV's camera frame that explain its corners
    (4, 2), the better first (IPPE)."""
    cv2: Any = opencv()
    answer: Any = cv2.solvePnPGeneric(
        half * CORNERS, corners, lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    turns, places = (np.array(part, dtype=float).reshape(-1, 3) for part in answer[1:3])
    found: list[Pose] = []
    for turn, place in zip(turns, places, strict=True):
        if np.isfinite([turn, place]).all():
            found.append(Pose.of(place, Pose.turn(turn).quaternion))
    return found


def undistorted(lens: Lens, pixels: Array) -> Array:
    """(n, 2) where pixels (n, 2) would be through the same lens without distortion."""
    cv2: Any = opencv()
    there = cv2.undistortPoints(
        pixels.reshape(-1, 1, 2), lens.matrix, lens.distortion, P=lens.matrix
    )
    return np.asarray(there).reshape(-1, 2)


def remapped(pixels: NDArray[np.uint8], source: Array) -> NDArray[np.uint8]:
    """The picture whose pixel (row, column) is taken at `source` (rows, columns, 2), x and y, of another."""
    cv2: Any = opencv()
    where = source.astype(np.float32)
    how, border = cv2.INTER_CUBIC, cv2.BORDER_REPLICATE
    return np.asarray(cv2.remap(pixels, where[..., 0], where[..., 1], how, borderMode=border))


def blurred(pixels: NDArray[np.uint8], sigma: float) -> NDArray[np.uint8]:
    """A picture out of focus by `sigma` pixels."""
    cv2: Any = opencv()
    return np.asarray(cv2.GaussianBlur(pixels, (0, 0), sigma))


def sharpness(picture: NDArray[np.uint8]) -> float:
    """Variance of a picture's Laplacian, which a motion or a lens out of focus makes small."""
    cv2: Any = opencv()
    return float(np.var(cv2.Laplacian(picture, cv2.CV_64F)))


def frames(source: int | str) -> Iterator[NDArray[np.uint8]]:
    """Yield RGB frames of a camera by its number, or of a video file.

    Raises:
        Unavailable: it cannot be opened.
    """
    cv2: Any = opencv()
    capture = cv2.VideoCapture(source)
    try:
        if not capture.isOpened():
            raise Unavailable(f"OpenCV cannot open the camera or video '{source}'")
        for _ in range(WARM_UP if isinstance(source, int) else 0):
            capture.read()
        while True:
            good, frame = capture.read()
            if not good:
                return
            yield np.ascontiguousarray(frame[..., ::-1])
    finally:
        capture.release()


def _dictionary(cv2: Any) -> Any:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
