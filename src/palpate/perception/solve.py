"""Bundle adjustment: least-squares fit of camera and object poses to all tag corners."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.perception.detection import square_poses
from palpate.perception.lens import FACING, Lens, Mount
from palpate.perception.tags import SceneTag, corners
from palpate.robots.trajectory import rotation_vector


@dataclass(frozen=True, slots=True, eq=False)
class UnknownBody:
    """Body with an unknown pose or height in the fit."""

    name: str  # name of the body
    pose_world: Pose  # its pose in the scene
    support: str | None = None  # the surface under it in the scene, if any
    is_surface: bool = False  # only its height is unknown


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """Pose of a body by an external estimator."""

    pose_camera: Pose  # in OpenCV's camera frame
    covariance: Array  # (6, 6) of position (m) and rotation (rad) along the axes of the camera


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Measured corners, with the prior knowledge of lens, tags, bodies and camera."""

    lens: Lens  # the lens
    seen: Mapping[int, Array]  # measured corners (4, 2) of each tag, pixels
    tags: Mapping[int, SceneTag]  # tags of the scene by number
    # Bodies with unknown poses by name; all others stay at their scene poses.
    things: Mapping[str, UnknownBody]
    mount: Mount | None  # prior of the camera pose, if any
    # External pose estimates of objects by name.
    estimates: Mapping[str, Estimated] = field(default_factory=dict[str, Estimated])

    def without(self, odd: Outliers) -> Problem:
        """Return the problem without the outlying tags and estimates.

        Leaning bodies lose the prior of their support.
        """
        seen = {number: where for number, where in self.seen.items() if number not in odd.tags}
        loose = {name: replace(self.things[name], support=None) for name in odd.leaning}
        kept = {name: one for name, one in self.estimates.items() if name not in odd.estimates}
        return replace(self, seen=seen, things={**self.things, **loose}, estimates=kept)

    def place(self, tag: SceneTag, pose: Pose | None) -> Pose:
        """Pose of a tag in the world for a given pose of its body."""
        if pose is None:
            return tag.pose_world
        return pose @ self.things[tag.body].pose_world.inverse() @ tag.pose_world

    def pixels(self, camera: Pose, points: Array, zoom: float = 1.0) -> Array:
        """Project points (n, 3) in the world to pixels (n, 2).

        Points behind the camera are projected from a depth of 1 mm, far outside the picture.
        """
        local = (points - camera.position) @ camera.rotation
        local[:, 2] = np.maximum(local[:, 2], 1e-3)
        return self.lens.project(local, zoom)


@dataclass(frozen=True, slots=True)
class Outliers:
    """Data that contradict the fit."""

    tags: tuple[int, ...] = ()  # numbers of outlying tags
    leaning: tuple[str, ...] = ()  # bodies that violate the prior of their support
    estimates: tuple[str, ...] = ()  # bodies whose external estimate contradicts their tags

    def __bool__(self) -> bool:
        return bool(self.tags or self.leaning or self.estimates)

    def __add__(self, other: Outliers) -> Outliers:
        return Outliers(
            self.tags + other.tags, self.leaning + other.leaning, self.estimates + other.estimates
        )


# Joint least-squares fit of camera and bodies to all tag corners (bundle adjustment).


# px and residuals. Prior standard deviation of a corner coordinate, and the number of residuals
# that this prior counts for. Corners of rendered tags have errors of 0.07 px. In photographs, two
# detection methods differ by 0.15 px.
NOISE, BELIEVED = 0.15, 4.0
FLOOR = 0.05  # px. Lower bound of the estimated noise.
# m. Standard deviation of a tag's position on a body, along each side. A ruler is no more accurate.
GLUED = 3e-4
# rad and m. Standard deviations of the tilt and height of a supported body, relative to the scene.
UPRIGHT, LEVEL = np.radians(0.5), 0.001
OPEN = 0.3  # m. Standard deviation of an unknown surface height about its believed value.
# rad. Standard deviation of the tilt that selects one of the two poses of a single square.
LOOSE = np.radians(10.0)
MOST_REFUSED = 4  # Maximum number of outlier rejections per picture
OUTLIER = 4.5  # Standard deviations. Threshold for an outlying tag, estimate or support.


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Poses and covariances of the fit, with the rejected data."""

    poses: Mapping[str, Pose]  # pose of each body in the world
    # (6, 6) of position (m) and rotation (rad) along the axes of the world.
    covariances: Mapping[str, Array]
    pose_world_camera: Pose  # in OpenCV's frame
    zoom: float  # ratio of the fitted focal length to that of the lens
    noise: float  # estimated standard deviation of a corner coordinate, pixels
    outliers: Outliers  # rejected data


def solve(problem: Problem) -> Solution:
    """Fit a picture, with stepwise rejection of outliers. Raises InputError: the camera pose is unknown."""
    # Remove the worst outlier and fit again, because an outlier also shifts the other residuals.
    given_up = Outliers()
    fit = _best(problem)
    for _ in range(MOST_REFUSED):
        odd = fit.outliers()
        if not odd:
            break
        given_up += odd
        problem = problem.without(odd)
        fit = _best(problem)
    return fit.solution(given_up)


def _best(problem: Problem) -> _LookFit:
    """Return the fit from the start with the lowest loss, repeated with its estimated noise."""
    fit = min((_LookFit(problem, start) for start in _starts(problem)), key=lambda fit: fit.cost)
    fit.run()
    return fit


class _LookFit:
    """Least-squares fit from one starting point.

    Unknowns: camera step (6) and log focal length (1). Each body adds a pose step (6) or a height
    (1), and each tag its offset (2) on the body. The loss is soft L1.
    """

    def __init__(self, problem: Problem, start: tuple[Pose, Mapping[str, Pose]]) -> None:
        self.problem, (self.camera, self.start) = problem, start
        self.numbers = list(problem.seen)
        self.pixels = np.array(list(problem.seen.values())).reshape(-1, 2)
        # Layout of the unknowns: camera 6, log focal length 1, each body 6 or 1, each tag 2.
        self.slices: dict[str, slice] = {}
        size = 7
        for name in self.start:
            width = 1 if problem.things[name].is_surface else 6
            self.slices[name] = slice(size, size + width)
            size += width
        self.glue = slice(size, size + 2 * len(self.numbers))
        self.noise = NOISE
        self.at: Array = np.zeros(size + 2 * len(self.numbers))
        # The costs of all starts use the same prior noise, so they are comparable.
        self.cost = self.run()

    def run(self) -> float:
        """Fit and then estimate the noise; return the loss with the previous noise.

        Noise: σ² = (n₀ σ₀² + Σ r²) / (n₀ + ν), with the prior σ₀ = `NOISE` of weight n₀ =
        `BELIEVED`, the pixel residuals r, and their degrees of freedom ν.
        """
        from scipy.optimize import least_squares

        # Minimise the robust loss; the covariance is the inverse of JᵀJ.
        found = least_squares(
            self.residuals, self.at, loss="soft_l1", f_scale=3.0, x_scale="jac", max_nfev=100
        )
        self.at, jacobian = found.x, found.jac
        self.covariance: Array = np.asarray(
            np.linalg.pinv(jacobian.T @ jacobian, hermitian=True), dtype=float
        )
        # Residual degrees of freedom ν: number of corner residuals minus the trace of their hat
        # matrix.
        rows = jacobian[: 2 * len(self.pixels)]
        left = len(rows) - float(np.einsum("ij,jk,ik->", rows, self.covariance, rows))
        # Residuals are in standard deviations: scale them to pixels.
        pixels = self.noise * found.fun[: len(rows)]
        squares = float(np.sum(pixels**2))
        # Robust noise from the median absolute deviation (factor 1.4826 for a normal distribution),
        # insensitive to outliers.
        middle = float(np.median(np.abs(pixels))) if len(pixels) else 0.0
        self.typical = max(FLOOR, 1.4826 * middle * math.sqrt(len(rows) / max(left, 1.0)))
        # Posterior noise with the prior as additional residuals.
        self.noise = max(FLOOR, math.sqrt((BELIEVED * NOISE**2 + squares) / (BELIEVED + left)))
        return float(found.cost)

    def pose(self, name: str, at: Array) -> Pose:
        """Pose of a body in the world at the unknowns `at`."""
        if name not in self.slices:
            thing = self.problem.things.get(name)
            return Pose.of(np.zeros(3)) if thing is None else thing.pose_world
        step = at[self.slices[name]]
        return move_pose(
            self.start[name], np.array([0, 0, step[0], 0, 0, 0]) if len(step) == 1 else step
        )

    def residuals(self, at: Array) -> Array:
        """All residuals in standard deviations: 8 per tag, then those of the priors."""
        problem, camera = self.problem, move_pose(self.camera, at[:6])
        offsets = at[self.glue].reshape(-1, 2)
        # Corners of each tag in the world, including its offset on the body.
        points: list[Array] = []
        for number, offset in zip(self.numbers, offsets, strict=True):
            tag = problem.tags[number]
            stands = self.pose(tag.body, at) if tag.body in self.slices else None
            place = problem.place(tag, stands)
            points.append(corners(tag.half, place) + place.rotation[:, :2] @ offset)
        # Reprojection errors of all corners.
        where = np.array(points).reshape(-1, 3)
        off = (problem.pixels(camera, where, float(np.exp(at[6]))) - self.pixels) / self.noise
        # Priors: tag offsets, camera, focal length, supports and external estimates.
        priors = [at[self.glue] / GLUED]
        if problem.mount is not None:
            priors.append(_camera_residuals(problem.mount, camera, at[6:7]))
        # A covariance of 7 × 7 already contains the focal length of a calibrated camera.
        if problem.mount is None or len(problem.mount.covariance) == 6:
            priors.append(at[6:7] / problem.lens.focal_std)
        for name in self.slices:
            priors.append(self.standing(name, at))
            if name in problem.estimates:
                priors.append(_differs(problem.estimates[name], camera, self.pose(name, at)))
        return np.concatenate([off.ravel(), *priors])

    def standing(self, name: str, at: Array) -> Array:
        """Residuals of a support: tilt and height relative to the scene.

        An unknown surface has the residual of its height. A body without support has none.
        """
        thing = self.problem.things[name]
        if thing.is_surface:
            return at[self.slices[name]] / OPEN
        if thing.support is None:
            return np.zeros(0)
        # The surface below may move itself: compare the height relative to it.
        pose, below = self.pose(name, at), 0.0
        if thing.support in self.slices:
            surface = self.problem.things[thing.support].pose_world
            below = float((self.pose(thing.support, at).position - surface.position)[2])
        higher = float(pose.position[2] - thing.pose_world.position[2]) - below
        return np.array([*_tilt(pose, thing.pose_world) / UPRIGHT, higher / LEVEL])

    def outliers(self) -> Outliers:
        """Return the worst outliers of one kind.

        The order is: one tag, then external estimates of tagged bodies, then supports.
        """
        problem, camera = self.problem, move_pose(self.camera, self.at[:6])
        # Largest residual of each tag, in units of the robust noise if this is smaller.
        residuals = self.residuals(self.at)[: 2 * len(self.pixels)].reshape(-1, 8)
        worst = np.abs(residuals).max(axis=1) * max(1.0, self.noise / self.typical)
        if len(worst) > 1 and worst.max() > OUTLIER:
            return Outliers(tags=(self.numbers[int(worst.argmax())],))
        # An estimate is only rejected if tags of the same body contradict it.
        tagged = {problem.tags[number].body for number in self.numbers}
        doubted = [
            name
            for name, one in problem.estimates.items()
            if name in tagged
            and np.abs(_differs(one, camera, self.pose(name, self.at))).max() > OUTLIER
        ]
        if doubted:
            return Outliers(estimates=tuple(doubted))
        # Bodies with a large tilt or height residual.
        leaning = [
            name
            for name, thing in problem.things.items()
            if name in self.slices
            and thing.support is not None
            and np.abs(self.standing(name, self.at)).max(initial=0.0) > OUTLIER
        ]
        return Outliers(leaning=tuple(leaning))

    def solution(self, given_up: Outliers) -> Solution:
        """Return poses, covariances and noise at the minimum."""
        poses = {name: self.pose(name, self.at) for name in self.slices}
        # Marginal covariance of each body; a surface has a variance of z alone.
        covariances: dict[str, Array] = {}
        for name, part in self.slices.items():
            block = self.covariance[part, part]
            covariances[name] = block if len(block) == 6 else np.diag([0, 0, block[0, 0], 0, 0, 0])
        camera = move_pose(self.camera, self.at[:6])
        zoom, noise = float(np.exp(self.at[6])), float(self.noise)
        return Solution(poses, covariances, camera, zoom, noise, given_up)


def move_pose(pose: Pose, step: Array) -> Pose:
    """Apply a small motion (6,) to a pose: translation (m) and rotation (rad) along the world axes."""
    return Pose(pose.position + step[:3], (Pose.turn(step[3:]) @ pose).quaternion)


def pose_difference(pose: Pose, other: Pose) -> Array:
    """Small motion (6,) from `other` to `pose`, the inverse of `move_pose`."""
    turn = other.rotation @ rotation_vector(other.quaternion, pose.quaternion)
    return np.concatenate([pose.position - other.position, turn])


def _camera_residuals(mount: Mount, camera: Pose, zoom: Array) -> Array:
    """Whitened residuals (6,) or (7,) of camera pose and log focal length relative to their prior."""
    off = np.concatenate([pose_difference(camera, mount.pose_world_camera @ FACING), zoom])
    return _whiten(mount.covariance, off[: len(mount.covariance)])


def _differs(estimate: Estimated, camera: Pose, pose: Pose) -> Array:
    """Whitened residuals (6,) of a body's pose relative to its external estimate."""
    return _whiten(
        estimate.covariance, pose_difference(camera.inverse() @ pose, estimate.pose_camera)
    )


def _whiten(covariance: Array, off: Array) -> Array:
    """Whiten deviations (n,): L⁻¹ d with the Cholesky factor L of the covariance."""
    return np.asarray(np.linalg.solve(np.linalg.cholesky(covariance), off), dtype=float)


def _tilt(pose: Pose, reference: Pose) -> Array:
    """Tilt (2,) of a body relative to the scene, rad: horizontal components of its vertical axis."""
    return np.asarray(reference.rotation @ pose.rotation[2])[:2]


def _starts(problem: Problem) -> Iterator[tuple[Pose, Mapping[str, Pose]]]:
    """Yield initial poses of camera and bodies. Raises InputError: the camera pose is unknown."""

    def area(number: int) -> float:
        return float(np.ptp(problem.seen[number], axis=0).prod())

    # Initial camera: the prior, else both IPPE poses of the largest tag on a static body.
    loose = {name for name, thing in problem.things.items() if not thing.is_surface}
    fixed = [number for number in problem.seen if problem.tags[number].body not in loose]
    cameras: list[Pose] = []
    if problem.mount is not None:
        cameras = [problem.mount.pose_world_camera @ FACING]
    elif fixed:
        tag = problem.tags[max(fixed, key=area)]
        views = square_poses(problem.lens, problem.seen[tag.number], tag.half)
        cameras = [tag.pose_world @ view.inverse() for view in views]
    if not cameras:
        raise InputError(
            "nothing says where the camera is: no tag in the picture is on what stands still in the scene. "
            'State one, e.g. <site name="tag_0" pos="x y z" size="0.03"/> in the table\'s body, or the '
            "camera's pose and covariance in its intrinsics file"
        )
    # Initial body poses: the candidate of its tags and estimate with the smallest misfit.
    for camera in cameras:
        found: dict[str, Pose] = {}
        for name, thing in problem.things.items():
            mine = [number for number in problem.seen if problem.tags[number].body == name]
            if thing.is_surface:
                found[name] = thing.pose_world
            elif mine or name in problem.estimates:
                poses = [
                    pose for number in mine for pose in _iter_poses(problem, camera, thing, number)
                ]
                if name in problem.estimates:
                    poses.append(camera @ problem.estimates[name].pose_camera)
                found[name] = min(poses, key=_misfit(problem, camera, thing, mine))
        yield camera, found


def _iter_poses(problem: Problem, camera: Pose, thing: UnknownBody, number: int) -> Iterator[Pose]:
    """Yield the body poses of the two IPPE solutions of a tag."""
    tag = problem.tags[number]
    on = tag.pose_world.inverse() @ thing.pose_world
    for view in square_poses(problem.lens, problem.seen[number], tag.half):
        yield camera @ view @ on


def _misfit(
    problem: Problem, camera: Pose, thing: UnknownBody, numbers: Sequence[int]
) -> Callable[[Pose], float]:
    """Return a function of the misfit of a body pose: squared tilt and corner residuals."""

    def of(pose: Pose) -> float:
        # Penalise tilt, and strongly a pose upside down.
        total = float(np.sum((_tilt(pose, thing.pose_world) / LOOSE) ** 2))
        total += 100.0 * (pose.rotation[2] @ thing.pose_world.rotation[2] < 0)
        for number in numbers:
            tag = problem.tags[number]
            there = problem.pixels(camera, corners(tag.half, problem.place(tag, pose)))
            total += float(np.sum(((there - problem.seen[number]) / (3 * NOISE)) ** 2))
        return total

    return of
