"""Least-squares fit of camera and objects to all corners of tags (bundle adjustment)."""

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
    """A body whose pose, or height, is an unknown of the fit.

    Attributes:
        name: of its body.
        pose_world: where the scene has it.
        support: the surface that it stands on in the scene, if any.
        is_surface: its height alone is open.
    """

    name: str
    pose_world: Pose
    support: str | None = None
    is_surface: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """Pose of a thing by an estimator.

    Attributes:
        pose_camera: in OpenCV's camera frame.
        covariance: (6, 6) of position, m, and rotation, rad, along the camera's axes.
    """

    pose_camera: Pose
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Corners in the picture, and what is known of lens, tags, things and camera.

    Attributes:
        seen: corners (4, 2) of each tag in the picture, pixels.
        tags: that the scene states.
        things: by name; what is not in it stands where the scene has it.
        estimates: of objects, by name.
    """

    lens: Lens
    seen: Mapping[int, Array]
    tags: Mapping[int, SceneTag]
    things: Mapping[str, UnknownBody]
    mount: Mount | None
    estimates: Mapping[str, Estimated] = field(default_factory=dict[str, Estimated])

    def without(self, odd: Outliers) -> Problem:
        """The problem without some tags and estimates, and with things that stand on nothing known."""
        seen = {number: where for number, where in self.seen.items() if number not in odd.tags}
        loose = {name: replace(self.things[name], support=None) for name in odd.leaning}
        kept = {name: one for name, one in self.estimates.items() if name not in odd.estimates}
        return replace(self, seen=seen, things={**self.things, **loose}, estimates=kept)

    def place(self, tag: SceneTag, pose: Pose | None) -> Pose:
        """Pose of a tag in the world if its thing has this pose."""
        if pose is None:
            return tag.pose_world
        return pose @ self.things[tag.body].pose_world.inverse() @ tag.pose_world

    def pixels(self, camera: Pose, points: Array, zoom: float = 1.0) -> Array:
        """(n, 2) pixels of points (n, 3) in the world; what is behind the camera is far away."""
        local = (points - camera.position) @ camera.rotation
        local[:, 2] = np.maximum(local[:, 2], 1e-3)
        return self.lens.project(local, zoom)


@dataclass(frozen=True, slots=True)
class Outliers:
    """Outliers: tags, things that do not stand as the scene has them, and things whose estimate
    their tags contradict."""

    tags: tuple[int, ...] = ()
    leaning: tuple[str, ...] = ()
    estimates: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.tags or self.leaning or self.estimates)

    def __add__(self, other: Outliers) -> Outliers:
        return Outliers(
            self.tags + other.tags,
            self.leaning + other.leaning,
            self.estimates + other.estimates,
        )


# Poses of camera and things by one least-squares fit of all tags' corners (bundle adjustment).


NOISE, BELIEVED = 0.15, 4.0
"""Pixels, 1 sigma of a corner's coordinate before any is seen, and the residuals that this counts for;
corners of rendered tags are off by 0.07, and in photographs two ways to find them differ by 0.15."""
FLOOR = 0.05
"""Pixels: least noise that residuals may show."""
GLUED = 3e-4
"""m: error of a tag's place on a thing, along its sides, 1 sigma; a ruler has no better."""
UPRIGHT, LEVEL = np.radians(0.5), 0.001
"""rad and m: tilt and height of a thing that stands on a surface, against the scene's, 1 sigma."""
OPEN = 0.3
"""m: height of a surface that the scene leaves open, 1 sigma about what is believed."""
LOOSE = np.radians(10.0)
"""rad: tilt, 1 sigma, that decides between the two poses that a single square allows."""
MOST_REFUSED = 4
"""Tags and things, one after the other, that a look gives up."""
OUTLIER = 4.5
"""Standard deviations at which a thing does not stand as the scene has it, or a tag does not fit."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Poses and covariances by the fit, and what did not fit.

    Attributes:
        poses: pose of each thing in the world.
        covariances: (6, 6) of position, m, and rotation, rad, along the world's axes.
        pose_world_camera: in OpenCV's frame.
        zoom: focal length over the lens's own.
        noise: pixels, 1 sigma of a corner's coordinate.
        refused: tags that do not fit.
        tilted: things that do not stand as the scene has them.
        doubted: things whose estimate their tags contradict.
    """

    poses: Mapping[str, Pose]
    covariances: Mapping[str, Array]
    pose_world_camera: Pose
    zoom: float
    noise: float
    refused: tuple[int, ...]
    tilted: tuple[str, ...]
    doubted: tuple[str, ...]


def solve(problem: Problem) -> Solution:
    """Fit a picture.

    Raises:
        InputError: nothing says where the camera is.
    """
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
    """The fit of the start that explains most, again with the noise that it shows."""
    fit = min((_LookFit(problem, start) for start in _starts(problem)), key=lambda fit: fit.cost)
    fit.run()
    return fit


class _LookFit:
    """Least-squares fit from one starting point."""

    def __init__(self, problem: Problem, start: tuple[Pose, Mapping[str, Pose]]) -> None:
        self.problem, (self.camera, self.start) = problem, start
        self.numbers = list(problem.seen)
        self.pixels = np.array(list(problem.seen.values())).reshape(-1, 2)
        # Camera 6, focal length 1, a thing 6 or its height, a tag 2.
        self.slices: dict[str, slice] = {}
        size = 7
        for name in self.start:
            width = 1 if problem.things[name].is_surface else 6
            self.slices[name] = slice(size, size + width)
            size += width
        self.glue = slice(size, size + 2 * len(self.numbers))
        self.noise = NOISE
        self.at: Array = np.zeros(size + 2 * len(self.numbers))
        # With the same noise as every other start's.
        self.cost = self.run()

    def run(self) -> float:
        """Fit, then estimate the noise; return the loss, with the noise before."""
        from scipy.optimize import least_squares

        found = least_squares(
            self.residuals, self.at, loss="soft_l1", f_scale=3.0, x_scale="jac", max_nfev=100
        )
        self.at, jacobian = found.x, found.jac
        self.covariance: Array = np.asarray(
            np.linalg.pinv(jacobian.T @ jacobian, hermitian=True), dtype=float
        )
        # Each corner leaves as much of its noise in the residuals as the fit has not followed.
        rows = jacobian[: 2 * len(self.pixels)]
        left = len(rows) - float(np.einsum("ij,jk,ik->", rows, self.covariance, rows))
        pixels = self.noise * found.fun[: len(rows)]
        squares = float(np.sum(pixels**2))
        # Half of the residuals are no larger than 0.67 of a normal deviation, whatever the largest are.
        middle = float(np.median(np.abs(pixels))) if len(pixels) else 0.0
        self.typical = max(FLOOR, 1.4826 * middle * math.sqrt(len(rows) / max(left, 1.0)))
        self.noise = max(FLOOR, math.sqrt((BELIEVED * NOISE**2 + squares) / (BELIEVED + left)))
        return float(found.cost)

    def pose(self, name: str, at: Array) -> Pose:
        """Pose of a thing in the world."""
        if name not in self.slices:
            thing = self.problem.things.get(name)
            return Pose.of(np.zeros(3)) if thing is None else thing.pose_world
        step = at[self.slices[name]]
        return move_pose(
            self.start[name], np.array([0, 0, step[0], 0, 0, 0]) if len(step) == 1 else step
        )

    def residuals(self, at: Array) -> Array:
        """All residuals, in standard deviations: 2 of each corner, then the priors'."""
        problem, camera = self.problem, move_pose(self.camera, at[:6])
        offsets = at[self.glue].reshape(-1, 2)
        points: list[Array] = []
        for number, offset in zip(self.numbers, offsets, strict=True):
            tag = problem.tags[number]
            stands = self.pose(tag.body, at) if tag.body in self.slices else None
            place = problem.place(tag, stands)
            points.append(corners(tag.half, place) + place.rotation[:, :2] @ offset)
        where = np.array(points).reshape(-1, 3)
        off = (problem.pixels(camera, where, float(np.exp(at[6]))) - self.pixels) / self.noise
        priors = [at[self.glue] / GLUED]
        if problem.mount is not None:
            priors.append(_camera_residuals(problem.mount, camera, at[6:7]))
        # The lens of a calibrated camera is known together with its place.
        if problem.mount is None or len(problem.mount.covariance) == 6:
            priors.append(at[6:7] / problem.lens.focal_std)
        for name in self.slices:
            priors.append(self.standing(name, at))
            if name in problem.estimates:
                priors.append(_differs(problem.estimates[name], camera, self.pose(name, at)))
        return np.concatenate([off.ravel(), *priors])

    def standing(self, name: str, at: Array) -> Array:
        """Residuals of how a thing stands: tilt and height against the scene's; of an open surface its
        height."""
        thing = self.problem.things[name]
        if thing.is_surface:
            return at[self.slices[name]] / OPEN
        if thing.support is None:
            return np.zeros(0)
        pose, below = self.pose(name, at), 0.0
        if thing.support in self.slices:
            surface = self.problem.things[thing.support].pose_world
            below = float((self.pose(thing.support, at).position - surface.position)[2])
        higher = float(pose.position[2] - thing.pose_world.position[2]) - below
        return np.array([*_tilt(pose, thing.pose_world) / UPRIGHT, higher / LEVEL])

    def outliers(self) -> Outliers:
        """The worst outlier: a tag; else estimates of things with tags; else things that do not stand as the
        scene has them."""
        problem, camera = self.problem, move_pose(self.camera, self.at[:6])
        residuals = self.residuals(self.at)[: 2 * len(self.pixels)].reshape(-1, 8)
        worst = np.abs(residuals).max(axis=1) * max(1.0, self.noise / self.typical)
        if len(worst) > 1 and worst.max() > OUTLIER:
            return Outliers(tags=(self.numbers[int(worst.argmax())],))
        tagged = {problem.tags[number].body for number in self.numbers}
        doubted = [
            name
            for name, one in problem.estimates.items()
            if name in tagged
            and np.abs(_differs(one, camera, self.pose(name, self.at))).max() > OUTLIER
        ]
        if doubted:
            return Outliers(estimates=tuple(doubted))
        leaning = [
            name
            for name, thing in problem.things.items()
            if name in self.slices
            and thing.support is not None
            and np.abs(self.standing(name, self.at)).max(initial=0.0) > OUTLIER
        ]
        return Outliers(leaning=tuple(leaning))

    def solution(self, given_up: Outliers) -> Solution:
        """Poses, covariances and noise at the minimum."""
        poses = {name: self.pose(name, self.at) for name in self.slices}
        covariances: dict[str, Array] = {}
        for name, part in self.slices.items():
            block = self.covariance[part, part]
            covariances[name] = block if len(block) == 6 else np.diag([0, 0, block[0, 0], 0, 0, 0])
        camera = move_pose(self.camera, self.at[:6])
        return Solution(
            poses,
            covariances,
            camera,
            float(np.exp(self.at[6])),
            float(self.noise),
            given_up.tags,
            given_up.leaning,
            given_up.estimates,
        )


def move_pose(pose: Pose, step: Array) -> Pose:
    """A pose after a small motion (6,): m along, and rad about, the world's axes."""
    return Pose(pose.position + step[:3], (Pose.turn(step[3:]) @ pose).quaternion)


def pose_difference(pose: Pose, other: Pose) -> Array:
    """(6,) the small motion to one pose from another, as `move_pose` takes it."""
    turn = other.rotation @ rotation_vector(other.quaternion, pose.quaternion)
    return np.concatenate([pose.position - other.position, turn])


def _camera_residuals(mount: Mount, camera: Pose, zoom: Array) -> Array:
    """(6,) or (7,) residuals of the camera's pose, and its focal length, against what is believed."""
    off = np.concatenate([pose_difference(camera, mount.pose_world_camera @ FACING), zoom])
    return _whiten(mount.covariance, off[: len(mount.covariance)])


def _differs(estimate: Estimated, camera: Pose, pose: Pose) -> Array:
    """(6,) residuals of a thing's pose in the world against its estimate."""
    return _whiten(
        estimate.covariance, pose_difference(camera.inverse() @ pose, estimate.pose_camera)
    )


def _whiten(covariance: Array, off: Array) -> Array:
    """Deviations (n,) as independent standard deviations."""
    return np.asarray(np.linalg.solve(np.linalg.cholesky(covariance), off), dtype=float)


def _tilt(pose: Pose, reference: Pose) -> Array:
    """(2,) rad by which a thing leans against how it stands in the scene."""
    return np.asarray(reference.rotation @ pose.rotation[2])[:2]


def _starts(problem: Problem) -> Iterator[tuple[Pose, Mapping[str, Pose]]]:
    """Yield poses of camera and things to begin with.

    Raises:
        InputError: nothing says where the camera is.
    """

    def area(number: int) -> float:
        return float(np.ptp(problem.seen[number], axis=0).prod())

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
    tag = problem.tags[number]
    on = tag.pose_world.inverse() @ thing.pose_world
    for view in square_poses(problem.lens, problem.seen[number], tag.half):
        yield camera @ view @ on


def _misfit(
    problem: Problem, camera: Pose, thing: UnknownBody, numbers: Sequence[int]
) -> Callable[[Pose], float]:
    """Function for how badly a pose of a thing explains its tags, with its tilt."""

    def of(pose: Pose) -> float:
        total = float(np.sum((_tilt(pose, thing.pose_world) / LOOSE) ** 2))
        total += 100.0 * (pose.rotation[2] @ thing.pose_world.rotation[2] < 0)
        for number in numbers:
            tag = problem.tags[number]
            there = problem.pixels(camera, corners(tag.half, problem.place(tag, pose)))
            total += float(np.sum(((there - problem.seen[number]) / (3 * NOISE)) ** 2))
        return total

    return of
