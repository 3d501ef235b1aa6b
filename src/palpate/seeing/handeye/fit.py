"""Hand-eye calibration: pose of a camera, from pictures of one tag in many poses of the arm, by one
least-squares fit, and the poses that make it surest.

In picture i the hand is at H_i in the base's frame, by its encoders, and truly at H_i exp(J_i d) E_i. The
corners x of the tag, at Y, are seen by the camera, at C, through a lens of focal length f exp(z), at

    p_i = project(C⁻¹ H_i exp(J_i d) E_i Y x, z) + noise      the camera stands still, Y on the hand
    p_i = project(C⁻¹ (H_i exp(J_i d) E_i)⁻¹ Y x, z) + noise  the camera is on the hand, Y stands still

Unknowns are C, Y, z, the tag's size, and d, by how far the encoders' zeros and the places of links are off, and
how the joints give way; all but Y have priors. E_i,
what else the hand is off, is a part of the corners' noise, which is so correlated: σ² + B Bᵀ with
B = ∂p_i / ∂E_i.

An arm works by the poses that it reports. Where they hold together is a frame that d moves, too: the true hand
is nearly where a rigid motion A d takes the reported one. The camera is wanted in the reported frame,
(A d)⁻¹ C; so a first joint's wrong zero, which no picture shows, does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.seeing.handeye.arm import STDS, carried, unexplained
from palpate.seeing.lens import FACING, Lens, Mount
from palpate.seeing.solve import BELIEVED, FLOOR, NOISE, moved
from palpate.seeing.vision import CORNERS, square_poses

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
class Views:
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

    def some(self, indices: Sequence[int]) -> Views:
        """Some of the views."""
        hands = [self.hands[i] for i in indices]
        return replace(self, hands=hands, jacobians=self.jacobians[indices])

    def at(self, tag: Pose, step: Array, error: Array | None = None) -> Array:
        """(n, 4, 2) corners in each picture, pixels, with the unknowns a `step` from where camera and
        `tag` are believed to be; `error` (6,) of the hand's poses, m and rad along the base's axes."""
        camera, tag = moved(self.camera, step[:6]), moved(tag, step[6:12])
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
            rows = _turned(x - place[:, None], None if off is None else -off[:, 3:]) @ turn
        else:
            rows = _turned(x @ turn.transpose(0, 2, 1), None if off is None else off[:, 3:])
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
        for i, size in enumerate(unexplained(self.repeatability)):
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
            found[:6, ARM:] = -carried(self.camera.position) @ self.frame
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


def _turned(points: Array, vectors: Array | None) -> Array:
    """(n, m, 3) points turned about the origin by small rotation vectors (n, 3), to second order."""
    if vectors is None:
        return points
    once = np.cross(vectors[:, None], points)
    return points + once + np.cross(vectors[:, None], once) / 2


def frame_of(hands: Sequence[Pose], jacobians: Array) -> Array:
    """(6, 7), A: the twist about the origin nearest to how joints (7,) move the hand in n poses, least squares
    over its places."""
    rigid = np.concatenate([carried(hand.position)[:3] for hand in hands])
    found = np.linalg.lstsq(rigid, jacobians[:, :3].reshape(3 * len(hands), -1))[0]
    return np.asarray(found, dtype=float)


def surest(views: Views, tag: Pose, count: int) -> list[int]:
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


def hand_eye(views: Views, corners: Sequence[Array]) -> HandEye:
    """Calibrate a camera by the `corners` (4, 2) of a tag in each picture, pixels.

    Raises:
        InputError: too few pictures, or too many that do not fit.
    """
    kept = list(range(len(corners)))
    while len(kept) >= max(FEWEST, math.ceil((1 - MOST_REFUSED) * len(corners))):
        fit = _Fit(views.some(kept), np.array([corners[i] for i in kept]))
        odd = np.sum(fit.residuals(fit.at)[: fit.seen.size].reshape(-1, 8) ** 2, axis=1)
        if odd.max() < ODD and fit.noise < LOUD:
            return fit.result(tuple(i for i in range(len(corners)) if i not in kept))
        kept.pop(int(odd.argmax()))
    raise InputError(
        f"of {len(corners)} pictures of the tag {len(kept)} fit together at most, too few: is it flat, does it sit "
        "firmly, and are its size and the camera's intrinsics right? Nothing is written"
    )


class _Fit:
    """Fit to some pictures, at its minimum."""

    def __init__(self, views: Views, seen: Array) -> None:
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
        camera = moved(self.views.camera, (wanted @ self.at)[:6])
        tag = moved(self.tag, self.at[6:12])
        mount = Mount(camera @ FACING, wanted @ self.covariance @ wanted.T)
        lens = self.views.lens.zoomed(math.exp(self.at[ZOOM]))
        return HandEye(mount, lens, tag, self.seen, self.off(self.at), self.noise, refused)
