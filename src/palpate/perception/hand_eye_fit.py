"""Hand-eye calibration by least squares, with the errors of the arm as unknowns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.perception.detection import CORNERS, square_poses
from palpate.perception.lens import FACING, Lens, Mount
from palpate.perception.solve import BELIEVED, FLOOR, NOISE, move_pose
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.trace.samples import STANDARD_GRAVITY

ZEROS = 1e-3
"""rad (1 sigma), of the encoders' zeros: uncalibrated Pandas are off by up to the order of 10 mm, calibrated
ones by 0.2 mm (Franzese, Spahn, Kober, Della Santina, 2025, arXiv:2503.12584)."""
GIVES = 2e-5
"""rad per N m (1 sigma), by which a joint gives way beyond its encoder under the arm's weight: joints of 7000 N m/rad
(franka_description), of which the arm's own computation of its angles leaves a seventh."""
LINKS = 3e-4
"""m (1 sigma): by which the place of a link in the one before is off, along each axis."""
BENT = 1e-4
"""m (1 sigma), what nothing else of the arm explains, such as links that bend."""
LEVER = 0.5
"""m: an arm that is off by its repeatability at the hand is turned by this part of it."""
STDS = np.repeat([ZEROS, GIVES, LINKS], [7, 7, 21])
"""(35,) of the errors: rad, rad per N m, m."""


def stances(arm: RobotDescription, q: Array) -> tuple[list[Pose], Array]:
    """Poses of the TCP in the base's frame at configurations (n, 7), and Jacobians (n, 6, 35) by the errors, along
    the base's axes."""
    nominal = NominalArm(arm, Pose.of([0, 0, 0]), np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    at = nominal.kinematics(q)
    gives = at.jacobian * at.gravity_torque[:, None]
    offsets = np.pad(nominal.offsets(q), ((0, 0), (0, 3), (0, 0)))
    hands = [Pose(row[:3], row[3:]) for row in at.pose_world_tcp]
    return hands, np.concatenate([at.jacobian, gives, offsets], axis=2)


def twist_jacobian(point: Array) -> Array:
    """(6, 6) step of a pose at a point (3,), m and rad, by a twist about the origin."""
    x, y, z = point
    found = np.eye(6)
    found[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return found


def residual_std(repeatability: float) -> Array:
    """(6,) standard deviations, m and rad, of what is left of an error of the hand that differs at every pose."""
    place = math.hypot(repeatability, BENT)
    return np.repeat([place, place / LEVER], 3)


def uncertainty(arm: RobotDescription, q: Array, lever: Array) -> Array:
    """(6, 6) covariance of the pose, along the base's axes, of what the hand carries at `lever` (3,), m from
    the TCP, along the same, in configuration `q` (7,)."""
    way = twist_jacobian(lever)
    moves = way @ stances(arm, q[None])[1][0] * STDS
    rest = way * residual_std(arm.nominal.pose_repeatability)
    return moves @ moves.T + rest @ rest.T


# Hand-eye calibration: pose of a camera, from pictures of one tag in many poses of the arm, by one
# least-squares fit, and the poses that make it surest.


FEWEST = 6
"""Pictures: with fewer, one that is odd is not found."""
MOST_REFUSED = 0.4
"""Share of the pictures that may not fit."""
ODD = 30.0
"""χ² of 8 residuals above which a picture does not fit: one in 5000 by chance."""
LOUD = 5.0
"""Pixels: more noise than pictures of a tag can have."""
ROUNDS = 3
"""Fits, each with the noise that the last one shows."""
ARM = 14
"""Unknowns before the arm's: camera 6, tag 6, logarithms of focal length and of the tag's size."""
ZOOM, SIZE = 12, 13
MEASURED = 5e-4
"""Relative: least standard deviation of a tag's size. Black is seen 0.01 pixel too wide to either side in rendered
pictures, of 40."""
CAMERA = [*range(6), ZOOM]
"""Indices of the unknowns of the camera with its lens."""
STEP = 1e-6
"""m or rad: of derivatives."""


@dataclass(frozen=True, eq=False)
class CalibrationViews:
    """Poses of the arm from which a tag is seen.

    Attributes:
        hands: pose of the hand in the base's frame, of each.
        jacobians: (n, 6, k) of the hand, along the base's axes, by zeros of encoders, rad, then, if any, by
            how joints give way, rad per N m, and by places of links, m.
        frame: (6, k), A: twist about the base's origin, m and rad, per unit of these.
        half: half a side of the tag's black square, m.
        size_std: its relative standard deviation.
        lens: as its owner has it.
        mount: where the camera is believed to be, in the base's frame, or, `on_hand`, in the hand's.
        on_hand: the camera is on the hand and the tag stands still; else the other way round.
        repeatability: m, 1 sigma, of the hand's place along each axis.
    """

    hands: Sequence[Pose]
    jacobians: Array
    frame: Array
    half: float
    size_std: float
    lens: Lens
    mount: Mount
    on_hand: bool
    repeatability: float

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the fit."""
        return ARM + self.jacobians.shape[2]

    @property
    def camera(self) -> Pose:
        """Believed pose of the camera, OpenCV's frame."""
        return self.mount.pose_world_camera @ FACING

    def some(self, indices: Sequence[int]) -> CalibrationViews:
        """Some of the views."""
        hands = [self.hands[i] for i in indices]
        return replace(self, hands=hands, jacobians=self.jacobians[indices])

    def at(self, tag: Pose, step: Array, error: Array | None = None) -> Array:
        """(n, 4, 2) corners in each picture, pixels, with the unknowns a `step` from where camera and
        `tag` are believed to be; `error` (6,) of the hand's poses, m and rad along the base's axes."""
        camera, tag = move_pose(self.camera, step[:6]), move_pose(tag, step[6:12])
        off = self.jacobians @ step[ARM:] + (np.zeros(6) if error is None else error)
        local = self.local(camera, tag, math.exp(step[SIZE]), off)
        local[..., 2] = np.maximum(local[..., 2], 1e-3)  # in front of the camera
        return self.lens.project(local.reshape(-1, 3), math.exp(step[ZOOM])).reshape(-1, 4, 2)

    def local(
        self, camera: Pose, tag: Pose, larger: float = 1.0, off: Array | None = None
    ) -> Array:
        """(n, 4, 3) corners in OpenCV's camera frame, m; the hand is `off` (n, 6)."""
        x = tag.position + (larger * self.half * CORNERS) @ tag.rotation.T
        turn, place = self._arrays
        if off is not None:
            place = place + off[:, :3]
        if self.on_hand:
            rows = _rotate_points(x - place[:, None], None if off is None else -off[:, 3:]) @ turn
        else:
            rows = _rotate_points(x @ turn.transpose(0, 2, 1), None if off is None else off[:, 3:])
            rows = rows + place[:, None]
        return (rows - camera.position) @ camera.rotation

    @cached_property
    def _arrays(self) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and places (n, 3), m, of the hands."""
        turn = np.array([hand.rotation for hand in self.hands])
        return turn, np.array([hand.position for hand in self.hands])

    def scatter(self, tag: Pose, step: Array) -> Array:
        """(n, 8, 8) covariance of a picture's corners by the arm's error, pixels²."""
        base, columns = self.at(tag, step), list[Array]()
        for i, size in enumerate(residual_std(self.repeatability)):
            off = self.at(tag, step, STEP * np.eye(6)[i]) - base
            columns.append(off.reshape(-1, 8) * size / STEP)
        b = np.stack(columns, axis=2)
        return b @ b.transpose(0, 2, 1)

    def prior(self) -> Array:
        """(u, u) information about the u unknowns before any picture."""
        found = np.zeros((self.unknowns, self.unknowns))
        found[:6, :6] = np.linalg.inv(self.mount.covariance[:6, :6])
        found[ZOOM, ZOOM] = self.lens.focal_std**-2
        found[SIZE, SIZE] = max(self.size_std, MEASURED) ** -2
        found[ARM:, ARM:] = np.diag(STDS[: self.jacobians.shape[2]] ** -2)
        return found

    def wanted(self) -> Array:
        """(7, u) from a step of the u unknowns to one of the camera in the frame of the poses reported, and of
        the focal length."""
        found = np.eye(self.unknowns)[CAMERA]
        if not self.on_hand:
            found[:6, ARM:] = -twist_jacobian(self.camera.position) @ self.frame
        return found

    def information(self, tag: Pose) -> Array:
        """(n, u, u) information about the u unknowns that each picture would give."""
        here = np.zeros(self.unknowns)
        base, columns = self.at(tag, here), list[Array]()
        for step in STEP * np.eye(self.unknowns):
            columns.append((self.at(tag, step) - base).reshape(-1, 8) / STEP)
        jacobian = np.stack(columns, axis=2)
        noise = self.scatter(tag, here) + NOISE**2 * np.eye(8)
        return jacobian.transpose(0, 2, 1) @ np.linalg.solve(noise, jacobian)


def _rotate_points(points: Array, vectors: Array | None) -> Array:
    """(n, m, 3) points turned about the origin by small rotation vectors (n, 3), to second order."""
    if vectors is None:
        return points
    once = np.cross(vectors[:, None], points)
    return points + once + np.cross(vectors[:, None], once) / 2


def frame_of(hands: Sequence[Pose], jacobians: Array) -> Array:
    """(6, 7), A: the twist about the origin nearest to how joints (7,) move the hand in n poses, least squares
    over its places."""
    rigid = np.concatenate([twist_jacobian(hand.position)[:3] for hand in hands])
    found = np.linalg.lstsq(rigid, jacobians[:, :3].reshape(3 * len(hands), -1))[0]
    return np.asarray(found, dtype=float)


def surest(views: CalibrationViews, tag: Pose, count: int) -> list[int]:
    """Indices of `count` views of a tag believed at `tag`, each the one that makes the camera's place surest
    beside those before (A-optimal, greedily)."""
    information, known, wanted = views.information(tag), views.prior(), views.wanted()[:3]
    known[6:12, 6:12] += 100.0 * np.eye(
        6
    )  # the tag is where it is believed to be, to 0.1 m and rad
    left, chosen = list(range(len(views.hands))), list[int]()
    for _ in range(min(count, len(left))):
        after = wanted @ np.linalg.inv(known + information[left]) @ wanted.T
        best = left[int(np.trace(after, axis1=1, axis2=2).argmin())]
        known = known + information[best]
        chosen.append(best)
        left.remove(best)
    return chosen


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """A calibrated camera.

    Attributes:
        mount: pose in the base's frame, or in the hand's, with the (7, 7) covariance of position, m,
            rotation, rad, and the logarithm of the focal length.
        lens: with its focal length as calibrated.
        tag: pose of the tag in the other frame.
        corners, residuals: (n, 4, 2) pixels, of the pictures that fit.
        noise: pixels, 1 sigma of a corner's coordinate.
        refused: indices of the pictures that do not fit.
    """

    mount: Mount
    lens: Lens
    tag: Pose
    corners: Array
    residuals: Array
    noise: float
    refused: tuple[int, ...]


def hand_eye(views: CalibrationViews, corners: Sequence[Array]) -> HandEye:
    """Calibrate a camera by the `corners` (4, 2) of a tag in each picture, pixels.

    Raises:
        InputError: too few pictures, or too many that do not fit.
    """
    kept = list(range(len(corners)))
    while len(kept) >= max(FEWEST, math.ceil((1 - MOST_REFUSED) * len(corners))):
        fit = _HandEyeFit(views.some(kept), np.array([corners[i] for i in kept]))
        odd = np.sum(fit.residuals(fit.at)[: fit.seen.size].reshape(-1, 8) ** 2, axis=1)
        if odd.max() < ODD and fit.noise < LOUD:
            return fit.result(tuple(i for i in range(len(corners)) if i not in kept))
        kept.pop(int(odd.argmax()))
    raise InputError(
        f"of {len(corners)} pictures of the tag {len(kept)} fit together at most, too few: is it flat, does it sit "
        "firmly, and are its size and the camera's intrinsics right? Nothing is written"
    )


class _HandEyeFit:
    """Fit to some pictures, at its minimum."""

    def __init__(self, views: CalibrationViews, seen: Array) -> None:
        self.views, self.seen, self.noise = views, seen, NOISE
        self.known = [*CAMERA, *range(SIZE, views.unknowns)]
        self.root = np.linalg.cholesky(views.prior()[np.ix_(self.known, self.known)]).T
        # A square is seen equally well in two poses.
        fits = [self._from(tag, np.zeros(views.unknowns)) for tag in self._starts()]
        self.tag, found = min(fits, key=lambda fit: float(fit[1].cost))
        for _ in range(ROUNDS):
            self._learn(found)
            _, found = self._from(self.tag, found.x)
        self.at = found.x
        self.covariance: Array = np.asarray(np.linalg.inv(found.jac.T @ found.jac), dtype=float)

    def _starts(self) -> list[Pose]:
        """Poses of the tag that its largest picture allows."""
        views = self.views
        largest = int(np.ptp(self.seen, axis=1).prod(axis=1).argmax())
        hand = views.hands[largest]
        poses = square_poses(views.lens, self.seen[largest], views.half)
        return [(hand if views.on_hand else hand.inverse()) @ views.camera @ pose for pose in poses]

    def _from(self, tag: Pose, at: Array) -> tuple[Pose, Any]:
        from scipy.optimize import least_squares

        self.tag = tag
        noise = self.views.scatter(tag, at)
        self.white = np.linalg.inv(np.linalg.cholesky(noise + self.noise**2 * np.eye(8)))
        found = least_squares(self.residuals, at, loss="soft_l1", f_scale=3.0, x_scale="jac")
        return tag, found

    def _learn(self, found: Any) -> None:
        """Scale the noise by what the residuals show; the fit has followed a part of it."""
        squares = float(np.sum(self.residuals(found.x)[: self.seen.size] ** 2))
        left = max(1, self.seen.size - self.views.unknowns)
        scale = (BELIEVED * (NOISE / self.noise) ** 2 + squares) / (BELIEVED + left)
        self.noise = max(FLOOR, self.noise * math.sqrt(scale))

    def residuals(self, at: Array) -> Array:
        """All residuals, in standard deviations: 8 of each picture, then the priors'."""
        off = self.off(at).reshape(-1, 8)
        return np.concatenate(
            [np.einsum("nij,nj->ni", self.white, off).ravel(), self.root @ at[self.known]]
        )

    def off(self, at: Array) -> Array:
        """(n, 4, 2) pixels between the corners as seen and as fitted."""
        return self.views.at(self.tag, at) - self.seen

    def result(self, refused: tuple[int, ...]) -> HandEye:
        """Result at the minimum."""
        wanted = self.views.wanted()
        camera = move_pose(self.views.camera, (wanted @ self.at)[:6])
        tag = move_pose(self.tag, self.at[6:12])
        mount = Mount(camera @ FACING, wanted @ self.covariance @ wanted.T)
        lens = self.views.lens.zoom_lens(math.exp(self.at[ZOOM]))
        return HandEye(mount, lens, tag, self.seen, self.off(self.at), self.noise, refused)
