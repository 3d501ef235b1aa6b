"""Subpixel detection of tags in a picture."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import Unavailable
from palpate.common.pose import Array, Pose
from palpate.perception.lens import Lens

TAGS = 587  # Number of AprilTags of the family tag36h11
MODULES = 8  # Modules along the black square of a tag
# px. Resolution of a module for decoding. With OpenCV's default of 4, a tenth fewer small tags are
# read.
CELL = 8
QUIET = 1  # Modules. Width of the white margin.
# (4, 3) corners of a tag in its own frame, in half sides, in detection order.
CORNERS = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
WARM_UP = 5  # Frames skipped until the exposure of a camera settles

Grey = NDArray[np.uint8]


def opencv() -> ModuleType:
    """Import OpenCV."""
    try:
        import cv2
    except ImportError:
        raise Unavailable("seeing needs OpenCV: pip install 'palpate[see]'") from None
    return cv2


def tag_pixels(number: int) -> Grey:
    """Modules (8, 8) of a tag as printed, 0 for black and 255 for white."""
    cv2: Any = opencv()
    return np.asarray(
        cv2.aruco.generateImageMarker(_dictionary(cv2), number, MODULES, borderBits=1)
    )


def squares(grey: Grey) -> list[tuple[int, Array]]:
    """Detect tags to pixel accuracy.

    Returns:
        Number and corners (4, 2) of each tag, pixels, clockwise from the upper left as printed.
    """
    cv2: Any = opencv()
    how = cv2.aruco.DetectorParameters()
    how.perspectiveRemovePixelPerCell = CELL
    corners, numbers, _ = cv2.aruco.ArucoDetector(_dictionary(cv2), how).detectMarkers(grey)
    if numbers is None:
        return []
    found = zip(np.ravel(numbers).tolist(), corners, strict=True)
    return [(int(number), np.asarray(where, dtype=float).reshape(4, 2)) for number, where in found]


def square_poses(lens: Lens, corners: Array, half: float) -> list[Pose]:
    """Return the two poses of a square that explain its corners (4, 2), the better first.

    The poses are in OpenCV's camera frame; `half` is half a side, m. The method is IPPE (Collins
    and Bartoli, 2014), as in OpenCV.
    """
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
    """Positions (n, 2) of pixels (n, 2) in a picture without distortion."""
    cv2: Any = opencv()
    there = cv2.undistortPoints(
        pixels.reshape(-1, 1, 2), lens.matrix, lens.distortion, P=lens.matrix
    )
    return np.asarray(there).reshape(-1, 2)


def remap(pixels: NDArray[np.uint8], source: Array) -> NDArray[np.uint8]:
    """Resample a picture at the positions `source` (rows, columns, 2), x and y in pixels."""
    cv2: Any = opencv()
    where = source.astype(np.float32)
    how, border = cv2.INTER_CUBIC, cv2.BORDER_REPLICATE
    return np.asarray(cv2.remap(pixels, where[..., 0], where[..., 1], how, borderMode=border))


def blur_picture(pixels: NDArray[np.uint8], sigma: float) -> NDArray[np.uint8]:
    """Blur a picture by a Gaussian of `sigma` pixels."""
    cv2: Any = opencv()
    return np.asarray(cv2.GaussianBlur(pixels, (0, 0), sigma))


def sharpness(picture: NDArray[np.uint8]) -> float:
    """Variance of a picture's Laplacian; motion blur and defocus reduce it."""
    cv2: Any = opencv()
    return float(np.var(cv2.Laplacian(picture, cv2.CV_64F)))


def frames(source: int | str) -> Iterator[NDArray[np.uint8]]:
    """Yield RGB frames of a camera by its number, or of a video file. Raises Unavailable: it cannot be opened."""
    cv2: Any = opencv()
    capture = cv2.VideoCapture(source)
    try:
        if not capture.isOpened():
            raise Unavailable(f"OpenCV cannot open the camera or video '{source}'")
        # Skip the first frames of a camera until its exposure settles.
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


# Subpixel corners: intersections of lines through the edges of a tag. Edge points are located
# across each side, to a fraction of a pixel, in the undistorted picture where sides are straight.


# Shares of a side at which its edge is sampled. Near the ends the next side interferes.
ALONG = np.linspace(0.12, 0.88, 32)
# px. Sample positions across a side. The range contains an edge blurred by a pixel.
ACROSS = np.arange(-2.5, 2.6, 0.25)
NEXT = 0.6  # Modules. Maximum sample distance to either side of an edge, before the next module.
FAINT = 1e-6  # Minimum weight of an edge sample. Without an edge, the side stays in place.
# Searches and pixels. Each search starts at the last sides and ends when no corner moves by more
# than `DONE`. Two suffice, unless a corner of the paper was detected instead.
ROUNDS, DONE = 6, 0.03
# px. Maximum rms deviation of a side from its line. It is below 0.1 for a tag and above 0.4 for
# partly occluded sides.
STRAIGHT = 0.3
# Modules. Maximum distance from the coarse corner, which is at most at the corner of the paper.
FARTHEST = 1.5


def detect(grey: Grey, lens: Lens) -> list[tuple[int, Array]]:
    """Detect tags with subpixel corners through a lens.

    Returns:
        Number and corners (4, 2) of each tag, pixels, clockwise from the upper left as printed.
    """
    return [(number, _fine(grey, rough, lens)) for number, rough in squares(grey)]


def _fine(grey: Grey, rough: Array, lens: Lens) -> Array:
    """Refine coarse corners (4, 2) by the edges next to them.

    The coarse corners stay where an edge is not straight or the refinement moves too far.
    """
    # Repeat the search until the corners converge.
    fine, bent = rough, 0.0
    for _ in range(ROUNDS):
        before = fine
        fine, bent = _refine_corners(grey, fine, lens)
        if np.abs(fine - before).max() < DONE:
            break
    within = np.abs(fine - rough).max() < FARTHEST * _module(rough)
    return fine if within and bent < STRAIGHT else rough


def _module(corners: Array) -> float:
    """Size of a module on the shortest side, pixels."""
    sides = np.roll(corners, -1, axis=0) - corners
    return float(np.linalg.norm(sides, axis=1).min()) / MODULES


def _refine_corners(grey: Grey, corners: Array, lens: Lens) -> tuple[Array, float]:
    """Refine the corners (4, 2) of a square once.

    Returns:
        The corners, and the largest rms deviation of edge points from their line, pixels.
    """
    sides = np.roll(corners, -1, axis=0) - corners
    # Outward unit normals of the four sides.
    outward = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # Sample the picture along each normal, within the adjacent modules.
    near = ACROSS[np.abs(ACROSS) <= max(1.0, NEXT * _module(corners))]
    places = corners[:, None] + ALONG[:, None] * sides[:, None]
    read = places[:, :, None] + near[:, None] * outward[:, None, None]
    light = remap(grey, read.reshape(-1, len(near), 2)).reshape(*read.shape[:3]).astype(float)
    # The edge is the centroid of the squared brightness gradient from black to white.
    rise = np.maximum(np.diff(light), 0.0) ** 2
    weight = rise.sum(axis=2)
    middle = (rise @ ((near[1:] + near[:-1]) / 2)) / np.maximum(weight, FAINT)
    points = places + middle[..., None] * outward[:, None]
    # Fit lines in the undistorted picture and distort their intersections.
    straight = undistort(lens, points.reshape(-1, 2)).reshape(points.shape)
    meetings, bent = _meetings(straight, np.sqrt(weight) + FAINT)
    # Distort the pixels of the ideal pinhole by the lens.
    rays = np.column_stack([meetings, np.ones(len(meetings))]) @ np.linalg.inv(lens.matrix).T
    return lens.project(rays), bent


def _meetings(points: Array, weights: Array) -> tuple[Array, float]:
    """Fit a line to each side by weighted total least squares and intersect adjacent lines.

    The sides have edge points (4, n, 2), pixels. Returns the intersections (4, 2), and the largest rms deviation
    of points from a line.
    """
    # Weighted centroid of each side.
    weights = weights / weights.sum(axis=1, keepdims=True)
    centres = np.einsum("ij,ijk->ik", weights, points)
    off = points - centres[:, None]
    # The normal of a line is the eigenvector of the smallest eigenvalue of the scatter matrix.
    spread, axes = np.linalg.eigh(np.einsum("ij,ijk,ijl->ikl", weights, off, off))
    normals = axes[..., 0]
    offsets = np.einsum("ij,ij->i", normals, centres)
    # Each corner solves the equations n·x = d of two adjacent lines.
    lines = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
    right = np.stack([np.roll(offsets, 1), offsets], axis=1)[..., None]
    return np.linalg.solve(lines, right)[..., 0], float(np.sqrt(spread[:, 0].max(initial=0.0)))
