"""Hand-eye calibration by least squares, with the kinematic errors of the arm as unknowns."""

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

# rad. Standard deviation of the encoder zeros. Uncalibrated Panda arms have errors of up to about
# 10 mm, calibrated ones 0.2 mm (Franzese, Spahn, Kober, Della Santina, 2025, arXiv:2503.12584).
ZEROS = 1e-3
# rad/(N m). Standard deviation of the joint compliance that the encoder does not measure. The joint
# stiffness is 7000 N m/rad (franka_description). The arm's own angle computation leaves a seventh
# of its deflection.
GIVES = 2e-5
LINKS = 3e-4  # m. Standard deviation of a link's position in its parent, along each axis.
BENT = 1e-4  # m. Standard deviation of errors outside this model, such as link bending.
LEVER = 0.5  # m. Ratio of the position error at the hand to its rotation error.


def kinematic_stds(errors: int) -> Array:
    """Standard deviations (`errors`,) of kinematic errors: rad, rad/(N m), m.

    They are all 5 m errors of m joints, or those of the encoder zeros alone.
    """
    joints, others = divmod(errors, 5)
    if others:
        return np.full(errors, ZEROS)
    return np.repeat([ZEROS, GIVES, LINKS], [joints, joints, 3 * joints])


def stances(arm: RobotDescription, q: Array) -> tuple[list[Pose], Array]:
    """Forward kinematics of configurations `q` (n, 7), rad, with Jacobians by the kinematic errors.

    Returns the TCP poses in the base frame, and Jacobians (n, 6, 5 m) of m joints along the axes of the base.
    """
    nominal = NominalArm(arm, Pose.of([0, 0, 0]), np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    # A compliance error of a joint acts like an encoder error, in proportion to the gravity torque.
    at = nominal.kinematics(q)
    gives = at.jacobian * at.gravity_torque[:, None]
    offsets = np.pad(nominal.offsets(q), ((0, 0), (0, 3), (0, 0)))
    hands = [Pose(row[:3], row[3:]) for row in at.pose_world_tcp]
    return hands, np.concatenate([at.jacobian, gives, offsets], axis=2)


def twist_jacobian(point: Array) -> Array:
    """Jacobian (6, 6) of the pose step at a point (3,) by a twist about the origin (m, rad).

    δp = v + ω × p and δφ = ω for the twist (v, ω).
    """
    x, y, z = point
    found = np.eye(6)
    found[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return found


def residual_std(repeatability: float) -> Array:
    """Standard deviations (6,) of the random pose error of the hand, m and rad.

    This error is independent at every pose: repeatability and unmodelled bending.
    """
    place = math.hypot(repeatability, BENT)
    return np.repeat([place, place / LEVER], 3)


def uncertainty(arm: RobotDescription, q: Array, lever: Array) -> Array:
    """Covariance (6, 6) of the pose of a point on the hand at `q` (7,), rad, along the axes of the base.

    `lever` (3,) is the vector from the TCP to the point, m, along these axes.
    """
    # Sum of the systematic kinematic errors and the random pose error, both moved to the point.
    way = twist_jacobian(lever)
    moves = way @ stances(arm, q[None])[1][0] * kinematic_stds(5 * len(q))
    rest = way * residual_std(arm.nominal.pose_repeatability)
    return moves @ moves.T + rest @ rest.T


# Hand-eye calibration: camera pose from pictures of one tag at many arm poses, and the selection of
# the most informative poses.


FEWEST = 6  # Minimum number of pictures. With fewer, a single outlier is not identifiable.
MOST_REFUSED = 0.4  # Maximum share of rejected pictures
# χ² of 8 residuals above which a picture is rejected; probability 1 in 5000 without a fault.
ODD = 30.0
LOUD = 5.0  # px. Maximum plausible noise of tag corners.
ROUNDS = 3  # Number of fits, each with the noise estimated by the last one
# Number of unknowns before those of the arm: camera 6, tag 6, log focal length, log tag size.
ARM = 14
ZOOM, SIZE = 12, 13
# Relative. Lower bound of the standard deviation of a tag's size. In rendered pictures, a black
# square of 40 px appears 0.01 px too wide on either side.
MEASURED = 5e-4
CAMERA = [*range(6), ZOOM]  # Indices of the unknowns of camera and lens
STEP = 1e-6  # m or rad. Step of finite differences.


@dataclass(frozen=True, eq=False)
class CalibrationViews:
    """Arm poses of the pictures of one tag."""

    hands: Sequence[Pose]  # pose of the hand in the base frame, for each picture
    # (n, 6, k) of the hand pose, along the base axes, by encoder zeros (rad). Optionally also by
    # joint compliances (rad/(N m)) and link positions (m).
    jacobians: Array
    frame: Array  # (6, k) matrix A: twist about the base origin (m, rad) per unit of these
    half: float  # half the side of the tag's black square, m
    size_std: float  # relative standard deviation of the tag's size
    lens: Lens  # the lens as specified by its owner
    mount: Mount  # prior of the camera pose, in the base frame, or in the hand frame if `on_hand`
    on_hand: bool  # the camera is on the hand and the tag is static; otherwise the reverse
    repeatability: float  # standard deviation of the hand position along each axis, m

    @property
    def unknowns(self) -> int:
        """Number u of unknowns of the fit."""
        return ARM + self.jacobians.shape[2]

    @property
    def camera(self) -> Pose:
        """Prior pose of the camera in OpenCV's frame."""
        return self.mount.pose_world_camera @ FACING

    def some(self, indices: Sequence[int]) -> CalibrationViews:
        """Select views by index."""
        hands = [self.hands[i] for i in indices]
        return replace(self, hands=hands, jacobians=self.jacobians[indices])

    def at(self, tag: Pose, step: Array, error: Array | None = None) -> Array:
        """Project the corners (n, 4, 2) of the tag into each picture, pixels.

        `step` (u,) holds the unknowns, relative to the priors of camera and tag. `error` (6,) is an
        additional error of the hand poses, m and rad along the base axes.
        """
        # Apply the steps of camera and tag, and the kinematic errors of the arm.
        camera, tag = move_pose(self.camera, step[:6]), move_pose(tag, step[6:12])
        off = self.jacobians @ step[ARM:] + (np.zeros(6) if error is None else error)
        local = self.local(camera, tag, math.exp(step[SIZE]), off)
        local[..., 2] = np.maximum(local[..., 2], 1e-3)  # in front of the camera
        return self.lens.project(local.reshape(-1, 3), math.exp(step[ZOOM])).reshape(-1, 4, 2)

    def local(
        self, camera: Pose, tag: Pose, larger: float = 1.0, off: Array | None = None
    ) -> Array:
        """Corners (n, 4, 3) in OpenCV's camera frame, m, of a tag that is `larger` by a factor.

        `off` (n, 6) are pose errors of the hands.
        """
        # Corners in the frame of the tag's side of the kinematic chain.
        x = tag.position + (larger * self.half * CORNERS) @ tag.rotation.T
        turn, place = self._arrays
        if off is not None:
            place = place + off[:, :3]
        # Transform to the frame of the camera's side: into the hand frame, or from it to the base.
        if self.on_hand:
            rows = _rotate_points(x - place[:, None], None if off is None else -off[:, 3:]) @ turn
        else:
            rows = _rotate_points(x @ turn.transpose(0, 2, 1), None if off is None else off[:, 3:])
            rows = rows + place[:, None]
        return (rows - camera.position) @ camera.rotation

    @cached_property
    def _arrays(self) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and positions (n, 3) of the hands, m."""
        turn = np.array([hand.rotation for hand in self.hands])
        return turn, np.array([hand.position for hand in self.hands])

    def scatter(self, tag: Pose, step: Array) -> Array:
        """Covariance (n, 8, 8) of the corners of each picture due to the random arm error, pixels²."""
        # Finite differences of the corners by each component of the hand pose, scaled by its
        # standard deviation.
        base, columns = self.at(tag, step), list[Array]()
        for i, size in enumerate(residual_std(self.repeatability)):
            off = self.at(tag, step, STEP * np.eye(6)[i]) - base
            columns.append(off.reshape(-1, 8) * size / STEP)
        b = np.stack(columns, axis=2)
        return b @ b.transpose(0, 2, 1)

    def prior(self) -> Array:
        """Prior information matrix (u, u) of the unknowns."""
        found = np.zeros((self.unknowns, self.unknowns))
        # Camera, focal length, tag size and kinematic errors have priors; the tag pose has none.
        found[:6, :6] = np.linalg.inv(self.mount.covariance[:6, :6])
        found[ZOOM, ZOOM] = self.lens.focal_std**-2
        found[SIZE, SIZE] = max(self.size_std, MEASURED) ** -2
        found[ARM:, ARM:] = np.diag(kinematic_stds(self.jacobians.shape[2]) ** -2)
        return found

    def wanted(self) -> Array:
        """Matrix (7, u) from the unknowns to the step of the reported camera pose and log focal
        length.

        The reported pose is relative to the nominal base. For a static camera, the rigid part of
        the arm error is therefore subtracted.
        """
        found = np.eye(self.unknowns)[CAMERA]
        if not self.on_hand:
            found[:6, ARM:] = -twist_jacobian(self.camera.position) @ self.frame
        return found

    def information(self, tag: Pose) -> Array:
        """Fisher information (n, u, u) about the unknowns in each picture.

        I = Jᵀ C⁻¹ J with the corner Jacobian J and the corner covariance C.
        """
        here = np.zeros(self.unknowns)
        # Jacobian of the corners by finite differences.
        base, columns = self.at(tag, here), list[Array]()
        for step in STEP * np.eye(self.unknowns):
            columns.append((self.at(tag, step) - base).reshape(-1, 8) / STEP)
        jacobian = np.stack(columns, axis=2)
        # Corner covariance: random arm error and detection noise.
        noise = self.scatter(tag, here) + NOISE**2 * np.eye(8)
        return jacobian.transpose(0, 2, 1) @ np.linalg.solve(noise, jacobian)


def _rotate_points(points: Array, vectors: Array | None) -> Array:
    """Rotate points (n, m, 3) by small rotation vectors (n, 3), to second order."""
    if vectors is None:
        return points
    once = np.cross(vectors[:, None], points)
    return points + once + np.cross(vectors[:, None], once) / 2


def frame_of(hands: Sequence[Pose], jacobians: Array) -> Array:
    """Least-squares twist (6, 7) of the base per joint error, matrix A.

    The twist about the origin best reproduces the hand translations by the joints (7,) in n poses.
    """
    # Solve for the rigid motion of the whole base that explains the hand translations.
    rigid = np.concatenate([twist_jacobian(hand.position)[:3] for hand in hands])
    found = np.linalg.lstsq(rigid, jacobians[:, :3].reshape(3 * len(hands), -1))[0]
    return np.asarray(found, dtype=float)


def surest(views: CalibrationViews, tag: Pose, count: int) -> list[int]:
    """Select `count` views by greedy A-optimal design.

    Each view minimises the trace of the camera position covariance, given the views before it.

    Returns:
        The indices of the views in order of selection.
    """
    # Prior: camera, lens and arm, and the tag pose to 0.1 m and 0.1 rad.
    information, known, wanted = views.information(tag), views.prior(), views.wanted()[:3]
    known[6:12, 6:12] += 100.0 * np.eye(6)  # prior of the tag pose
    # Add the view with the smallest expected trace, one by one.
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
    """Result of a camera calibration."""

    # Camera pose in the base or hand frame, with the (7, 7) covariance of position (m), rotation
    # (rad) and log focal length.
    mount: Mount
    lens: Lens  # the lens with its calibrated focal length
    tag: Pose  # pose of the tag in the other frame
    corners: Array  # (n, 4, 2) measured corners of the accepted pictures, pixels
    residuals: Array  # (n, 4, 2) residuals of these corners, pixels
    noise: float  # estimated standard deviation of a corner coordinate, pixels
    refused: tuple[int, ...]  # indices of the rejected pictures


def hand_eye(views: CalibrationViews, corners: Sequence[Array]) -> HandEye:
    """Calibrate a camera from the tag corners (4, 2) in each picture, pixels.

    Raises InputError: too few pictures, or too many rejected ones.
    """
    # Reject the picture with the largest χ² and fit again, until all remaining ones are consistent.
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
        # Whitening of the priors: square root of their information matrix.
        self.known = [*CAMERA, *range(SIZE, views.unknowns)]
        self.root = np.linalg.cholesky(views.prior()[np.ix_(self.known, self.known)]).T
        # A square has two IPPE poses: fit from both and keep the better one.
        fits = [self._from(tag, np.zeros(views.unknowns)) for tag in self._starts()]
        self.tag, found = min(fits, key=lambda fit: float(fit[1].cost))
        # Alternate between noise estimate and fit.
        for _ in range(ROUNDS):
            self._learn(found)
            _, found = self._from(self.tag, found.x)
        self.at = found.x
        self.covariance: Array = np.asarray(np.linalg.inv(found.jac.T @ found.jac), dtype=float)

    def _starts(self) -> list[Pose]:
        """Return the initial tag poses from the picture with the largest tag."""
        views = self.views
        largest = int(np.ptp(self.seen, axis=1).prod(axis=1).argmax())
        hand = views.hands[largest]
        poses = square_poses(views.lens, self.seen[largest], views.half)
        return [(hand if views.on_hand else hand.inverse()) @ views.camera @ pose for pose in poses]

    def _from(self, tag: Pose, at: Array) -> tuple[Pose, Any]:
        """Fit from an initial tag pose, with corner residuals whitened at that start."""
        from scipy.optimize import least_squares

        self.tag = tag
        noise = self.views.scatter(tag, at)
        self.white = np.linalg.inv(np.linalg.cholesky(noise + self.noise**2 * np.eye(8)))
        found = least_squares(self.residuals, at, loss="soft_l1", f_scale=3.0, x_scale="jac")
        return tag, found

    def _learn(self, found: Any) -> None:
        """Scale the noise to the residuals: σ² = (n₀ σ₀² + Σ r²) / (n₀ + ν), in units of the
        current noise.

        The degrees of freedom ν are the residuals minus the unknowns.
        """
        squares = float(np.sum(self.residuals(found.x)[: self.seen.size] ** 2))
        left = max(1, self.seen.size - self.views.unknowns)
        scale = (BELIEVED * (NOISE / self.noise) ** 2 + squares) / (BELIEVED + left)
        self.noise = max(FLOOR, self.noise * math.sqrt(scale))

    def residuals(self, at: Array) -> Array:
        """All residuals in standard deviations: 8 per picture, then those of the priors."""
        off = self.off(at).reshape(-1, 8)
        return np.concatenate(
            [np.einsum("nij,nj->ni", self.white, off).ravel(), self.root @ at[self.known]]
        )

    def off(self, at: Array) -> Array:
        """Residuals (n, 4, 2) of the fitted corners, pixels."""
        return self.views.at(self.tag, at) - self.seen

    def result(self, refused: tuple[int, ...]) -> HandEye:
        """Return the calibration at the minimum."""
        # Transform the step and the covariance of the unknowns to the reported camera pose.
        wanted = self.views.wanted()
        camera = move_pose(self.views.camera, (wanted @ self.at)[:6])
        tag = move_pose(self.tag, self.at[6:12])
        mount = Mount(camera @ FACING, wanted @ self.covariance @ wanted.T)
        lens = self.views.lens.zoom_lens(math.exp(self.at[ZOOM]))
        return HandEye(mount, lens, tag, self.seen, self.off(self.at), self.noise, refused)
