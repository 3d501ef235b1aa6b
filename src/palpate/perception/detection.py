"""Detection of tags in a picture, to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import Unavailable
from palpate.common.pose import Array, Pose
from palpate.perception.lens import Lens

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


def undistort(lens: Lens, pixels: Array) -> Array:
    """(n, 2) where pixels (n, 2) would be through the same lens without distortion."""
    cv2: Any = opencv()
    there = cv2.undistortPoints(
        pixels.reshape(-1, 1, 2), lens.matrix, lens.distortion, P=lens.matrix
    )
    return np.asarray(there).reshape(-1, 2)


def remap(pixels: NDArray[np.uint8], source: Array) -> NDArray[np.uint8]:
    """The picture whose pixel (row, column) is taken at `source` (rows, columns, 2), x and y, of another."""
    cv2: Any = opencv()
    where = source.astype(np.float32)
    how, border = cv2.INTER_CUBIC, cv2.BORDER_REPLICATE
    return np.asarray(cv2.remap(pixels, where[..., 0], where[..., 1], how, borderMode=border))


def blur_picture(pixels: NDArray[np.uint8], sigma: float) -> NDArray[np.uint8]:
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


# Tags in a picture. A corner is where two sides meet: lines through their edges, each point of
# which is found to a fraction of a pixel across the side, in the picture without the lens's
# distortion, where sides are straight.


ALONG = np.linspace(0.12, 0.88, 32)
"""Places along a side, as shares of it: at its ends the next side is near."""
ACROSS = np.arange(-2.5, 2.6, 0.25)
"""Pixels out of the square at which a picture is read. An edge out of focus by a pixel is within them."""
NEXT = 0.6
"""Of a module, to either side of an edge: beyond are the next ones."""
FAINT = 1e-6
"""Weight of a place without an edge: there a side is where it was."""
ROUNDS, DONE = 6, 0.03
"""Searches of the edges, each along sides that are nearer to where they should be, until none moves a corner by
more than these pixels: two, but where a corner was taken for one of the paper."""
STRAIGHT = 0.3
"""Pixels, rms, of a side's edge from its line. It is below 0.1, and above 0.4 where a part is another thing's."""
FARTHEST = 1.5
"""Modules from where a corner was found roughly: at the paper's corner, at most."""


def detect(grey: Grey, lens: Lens) -> list[tuple[int, Array]]:
    """Tags in a picture through a lens: number and corners (4, 2), pixels, clockwise from the upper left as printed."""
    return [(number, _fine(grey, rough, lens)) for number, rough in squares(grey)]


def _fine(grey: Grey, rough: Array, lens: Lens) -> Array:
    """Corners (4, 2) by the edges near rough ones, which stay where these are not straight, or lead elsewhere."""
    fine, bent = rough, 0.0
    for _ in range(ROUNDS):
        before = fine
        fine, bent = _refine_corners(grey, fine, lens)
        if np.abs(fine - before).max() < DONE:
            break
    within = np.abs(fine - rough).max() < FARTHEST * _module(rough)
    return fine if within and bent < STRAIGHT else rough


def _module(corners: Array) -> float:
    """Pixels of a module along the shortest side."""
    sides = np.roll(corners, -1, axis=0) - corners
    return float(np.linalg.norm(sides, axis=1).min()) / MODULES


def _refine_corners(grey: Grey, corners: Array, lens: Lens) -> tuple[Array, float]:
    """Corners (4, 2) of a square by its edges near where they are believed to be, and pixels by which the least
    straight one is not."""
    sides = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    near = ACROSS[np.abs(ACROSS) <= max(1.0, NEXT * _module(corners))]
    places = corners[:, None] + ALONG[:, None] * sides[:, None]
    read = places[:, :, None] + near[:, None] * outward[:, None, None]
    light = remap(grey, read.reshape(-1, len(near), 2)).reshape(*read.shape[:3]).astype(float)
    # Black within, white without: the edge is the middle of the rise, weighted by its square.
    rise = np.maximum(np.diff(light), 0.0) ** 2
    weight = rise.sum(axis=2)
    middle = (rise @ ((near[1:] + near[:-1]) / 2)) / np.maximum(weight, FAINT)
    points = places + middle[..., None] * outward[:, None]
    straight = undistort(lens, points.reshape(-1, 2)).reshape(points.shape)
    meetings, bent = _meetings(straight, np.sqrt(weight) + FAINT)
    return _distort(lens, meetings), bent


def _meetings(points: Array, weights: Array) -> tuple[Array, float]:
    """(4, 2) where each line meets the one before it, total least squares through points (4, n, 2), and the largest
    deviation of points from a line, rms."""
    weights = weights / weights.sum(axis=1, keepdims=True)
    centres = np.einsum("ij,ijk->ik", weights, points)
    off = points - centres[:, None]
    # The normal is the direction of least spread.
    spread, axes = np.linalg.eigh(np.einsum("ij,ijk,ijl->ikl", weights, off, off))
    normals = axes[..., 0]
    offsets = np.einsum("ij,ij->i", normals, centres)
    lines = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
    right = np.stack([np.roll(offsets, 1), offsets], axis=1)[..., None]
    return np.linalg.solve(lines, right)[..., 0], float(np.sqrt(spread[:, 0].max(initial=0.0)))


def _distort(lens: Lens, pixels: Array) -> Array:
    """(n, 2) where pixels (n, 2) of the lens without distortion are seen through it."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(lens.matrix).T
    return lens.project(rays)
