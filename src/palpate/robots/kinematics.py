"""Forward and inverse kinematics of the nominal arm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache, lru_cache
from threading import Lock
from typing import NamedTuple

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.safety import JOINT_MARGIN

POSITION_TOLERANCE, ANGLE_TOLERANCE = 0.001, np.radians(0.5)  # m, rad
# rad: margin at the end stops, for the impedance controller's deviations. The safety predicate has
# a smaller margin.
LIMIT_MARGIN = 0.05
MAX_ITERATIONS = 30
STALLED = 1e-4  # rad: a smaller Gauss-Newton step far from the target indicates a local minimum
# Weight of the distance from the posture against 1 rad or 1 m of error. It only selects among the
# solutions.
POSTURE_COST = 1e-3
CACHED_POSES = 4096


def inverse_kinematics(
    arm: RobotDescription, pose_world_tcp: Pose, pose_world_base: Pose, seed_q: Array | None = None
) -> Array | None:
    """Compute joint angles (7,), rad, for a pose of the TCP; None if none is found.

    The result is within 1 mm, 0.5° and the joint range less a margin. It is deterministic: of the many
    solutions, the one near `seed_q`, by default near the ready posture turned towards the target, elbow up.
    """
    # Round the pose so that results can be cached; q and -q are one orientation.
    pose = pose_world_base.inverse() @ pose_world_tcp
    sign = 1.0 if pose.quaternion[np.argmax(np.abs(pose.quaternion))] > 0 else -1.0
    key = (*np.round(pose.position, 5).tolist(), *np.round(sign * pose.quaternion, 5).tolist())
    seed = None if seed_q is None else tuple(np.round(seed_q, 5).tolist())
    found = _solve(arm, key, seed)
    return None if found is None else np.array(found)


def too_far(arm: RobotDescription, pose_base_tcp: Pose) -> bool:
    """Test if a pose is out of reach. The test is quick, and false for some poses out of reach.

    The joint before the last lies on a circle about the axis of the last joint. The pose is out of reach if every point
    of that circle is farther from the shoulder than the links between them can reach.
    """
    links = _links(arm)
    # Distance from the shoulder to the nearest point of the circle.
    apart = pose_base_tcp.apply(links.wrist) - links.shoulder
    along = float(apart @ (pose_base_tcp.rotation @ links.axis))
    across = math.sqrt(max(float(apart @ apart) - along * along, 0.0))
    return not math.hypot(along, across - links.radius) <= links.stretched + links.missed


def within_joint_limits(arm: RobotDescription, q: Array, margin: float = JOINT_MARGIN) -> bool:
    """Test if joint angles (7,), rad, are finite and within the joint range less a margin, by default
    the margin of the safety predicate.
    """
    low, high = arm.limits.q_min, arm.limits.q_max
    return bool(((q >= low + margin) & (q <= high - margin)).all())


@cache
def model_without_fingers(arm: RobotDescription) -> mujoco.MjModel:
    """Compile the nominal arm and hand: the base at the origin."""
    spec = arm.spec()
    for finger in arm.hand.fingers:
        spec.delete(spec.joint(finger).parent)
    return spec.compile()


@lru_cache(CACHED_POSES)
def forward_kinematics(arm: RobotDescription, q: tuple[float, ...]) -> Pose:
    """Compute the TCP's pose relative to the base at joint angles `q` (7), rad."""
    model = model_without_fingers(arm)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    site, quaternion = data.site(arm.tcp), np.empty(4)
    mujoco.mju_mat2Quat(quaternion, site.xmat)
    return Pose(site.xpos.copy(), quaternion)


class _Solver:
    """mink's differential inverse kinematics on the nominal arm, stepped like Gauss-Newton."""

    def __init__(self, arm: RobotDescription) -> None:
        import mink

        model = model_without_fingers(arm)
        self.low, self.high = arm.limits.q_min + LIMIT_MARGIN, arm.limits.q_max - LIMIT_MARGIN
        self.lock = Lock()
        self.configuration = mink.Configuration(model)
        self.reach = mink.FrameTask(
            arm.tcp, "site", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-6
        )
        self.posture = mink.PostureTask(model, cost=POSTURE_COST)
        self.limit = mink.ConfigurationLimit(model, min_distance_from_limits=LIMIT_MARGIN)

    def search(self, pose_base_tcp: Pose, q: Array) -> Array | None:
        """Search from `q`; return None where the search does not end at the pose."""
        import mink

        # Gauss-Newton steps on the task's error, with a small pull to the posture, clipped to the limits.
        self.reach.set_target(mink.SE3(pose_base_tcp.vector[[3, 4, 5, 6, 0, 1, 2]]))
        self.posture.set_target(q)
        self.configuration.update(np.clip(q, self.low, self.high))
        for _ in range(MAX_ITERATIONS):
            if self._is_at_goal():
                return self.configuration.q.copy()
            step = mink.solve_ik(  # pyright: ignore[reportUnknownMemberType] (mink leaves its **kwargs untyped)
                self.configuration, [self.reach, self.posture], 1.0, "daqp", limits=[self.limit]
            )
            self.configuration.update(np.clip(self.configuration.q + step, self.low, self.high))
            if np.abs(step).max() < STALLED:
                break
        return self.configuration.q.copy() if self._is_at_goal() else None

    def _is_at_goal(self) -> bool:
        error = self.reach.compute_error(self.configuration)
        return bool(
            np.linalg.norm(error[:3]) < POSITION_TOLERANCE / 2
            and np.linalg.norm(error[3:]) < ANGLE_TOLERANCE / 2
        )


_solver = cache(_Solver)


@lru_cache(CACHED_POSES)
def _solve(
    arm: RobotDescription, key: tuple[float, ...], seed: tuple[float, ...] | None
) -> tuple[float, ...] | None:
    pose = Pose.of(key[:3], key[3:])
    if too_far(arm, pose):
        return None
    solver = _solver(arm)
    with solver.lock:
        for q in _seeds(arm, pose, seed):
            found = solver.search(pose, q)
            if found is not None:
                return tuple(found.tolist())
    return None


def _seeds(
    arm: RobotDescription, pose_base_tcp: Pose, seed: tuple[float, ...] | None
) -> Iterator[Array]:
    """Yield start postures of the search: home turned towards the target, with the yaw of the pose's
    tool, then the other postures."""
    if seed is not None:
        yield np.array(seed)
    # Home, turned about the base towards the target, with the last joint set by the tool's yaw.
    first, last = np.eye(len(arm.joints))[[0, -1]]
    azimuth = float(np.arctan2(pose_base_tcp.position[1], pose_base_tcp.position[0]))
    ready = arm.home + azimuth * first
    tool_x = pose_base_tcp.rotation[:, 0]
    turned = azimuth - float(np.arctan2(tool_x[1], tool_x[0]))
    yield ready + np.remainder(turned + np.pi, 2 * np.pi) * last - np.pi * last
    for posture in arm.postures:
        yield ready + posture


class _Links(NamedTuple):
    """The arm between its second joint and its last.

    The joint before the last lies on a circle about the axis of the last joint.
    """

    shoulder: Array  # (3,) m, the second joint in the base
    wrist: Array  # (3,) m, centre of the circle in the tool frame
    axis: Array  # (3,) axis of the circle in the tool frame
    radius: float  # m
    stretched: float  # m, largest distance of the joint before the last from the shoulder
    missed: float  # m, error of the circle where the tool is within the tolerances


@cache
def _links(arm: RobotDescription) -> _Links:
    model = model_without_fingers(arm)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # Anchors and axes of the joints in the reference configuration.
    joints = [model.joint(name).id for name in arm.joints]
    at, axes, tcp = data.xanchor[joints], data.xaxis[joints], data.site(arm.tcp)

    def parts(link: int, joint: int) -> Array:
        """Return the components, m, along and across the axis of a joint, of the way from joint `link` to the
        next.
        """
        way = at[link + 1] - at[link]
        along = float(way @ axes[joint])
        return np.array([along, float(np.linalg.norm(way - along * axes[joint]))])

    # Two links reach farthest when they point the same way from the axis of the joint between them. A
    # last single link adds its length.
    end = len(joints) - 1
    stretched = sum(
        float(np.linalg.norm(parts(i - 1, i) + parts(i, i))) for i in range(2, end - 1, 2)
    )
    if end % 2:
        stretched += float(np.linalg.norm(parts(end - 2, end - 2)))
    # The circle of the joint before the last in the tool frame, and its error within the tolerances.
    along, radius = parts(end - 1, end).tolist()
    to_tool = tcp.xmat.reshape(3, 3).T
    wrist = to_tool @ (at[end] - along * axes[end] - tcp.xpos)
    missed = POSITION_TOLERANCE + float(ANGLE_TOLERANCE * np.linalg.norm(wrist))
    return _Links(at[1].copy(), wrist, to_tool @ axes[end], radius, stretched, missed)
