"""Inverse kinematics of the nominal arm: which poses it reaches, and how."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.robot import HOME
from palpate.robots.safety import JOINT_MARGIN

if TYPE_CHECKING:
    import mink

POSITION_TOLERANCE = 0.001
"""m."""
ANGLE_TOLERANCE = np.radians(0.5)
LIMIT_MARGIN = 0.05
"""rad: room at the end stops, for the impedance controller's deviations; the safety predicate stops
at less."""

MAX_ITERATIONS = 30
STALLED = 1e-4
"""rad: a Gauss-Newton step below this, away from the target, is a local minimum."""
POSTURE_COST = 1e-3
"""Weight of staying near the posture against 1 rad or 1 m of error: it only chooses among the
solutions."""
CACHED_POSES = 4096

FR3 = Path(__file__).with_name("fr3.xml")

TURNS: tuple[tuple[float, ...], ...] = (
    (0, 0, 0, 0, 0, 0, 0),
    (0, 0, 0, 0, 0, 0, 1.5),
    (0, 0, 0, 0, 0, 0, -1.5),
    (-0.8, 0, 0.8, 0, 0, 0, 0),
    (0.8, 0, -0.8, 0, 0, 0, 0),
    (0, 1.0, 0, 0.8, 0, 0.5, 0),
)
"""rad: where the search starts when the ready posture with the hand turned as a top-down pose wants
it fails,
relative to the ready posture: the hand turned otherwise, the elbow swung, the arm low."""


def inverse_kinematics(
    pose_world_tcp: Pose, pose_world_base: Pose, seed_q: Array | None = None
) -> Array | None:
    """Joint angles (7,) in rad that put the TCP at a pose, or None when none are found.

    Within 1 mm, 0.5° and the joint range less a margin. Deterministic; of the many solutions the
    one near `seed_q`, by default near the ready posture turned towards the target, elbow up.
    """
    pose = pose_world_base.inverse() @ pose_world_tcp
    sign = 1.0 if pose.quaternion[np.argmax(np.abs(pose.quaternion))] > 0 else -1.0
    key = (*np.round(pose.position, 5).tolist(), *np.round(sign * pose.quaternion, 5).tolist())
    found = _solve(key, None if seed_q is None else tuple(np.round(seed_q, 5).tolist()))
    return None if found is None else np.array(found)


def reachable(pose_world_tcp: Pose, pose_world_base: Pose) -> bool:
    """Whether the arm can put its TCP there."""
    return inverse_kinematics(pose_world_tcp, pose_world_base) is not None


def within_joint_limits(q: Array) -> bool:
    """Whether joint angles (7,), rad, are finite and where the safety predicate allows them."""
    low, high = joint_range()
    return bool(((q >= low + JOINT_MARGIN) & (q <= high - JOINT_MARGIN)).all())


def joint_range() -> tuple[Array, Array]:
    """Lowest and highest joint angles, each (7,), rad."""
    joints = nominal_arm().jnt_range
    return joints[:, 0].copy(), joints[:, 1].copy()


@cache
def nominal_arm() -> mujoco.MjModel:
    """The nominal arm and hand without fingers: seven joints, the base at the origin, site
    `tcp`."""
    spec = mujoco.MjSpec.from_file(str(FR3))
    for finger in ("left_finger", "right_finger"):
        spec.delete(spec.body(finger))
    for element in (*spec.equalities, *spec.tendons, *spec.actuators):
        spec.delete(element)
    return spec.compile()


@dataclass(frozen=True, slots=True, eq=False)
class _Solver:
    """mink's differential inverse kinematics on the nominal arm, stepped like Gauss-Newton."""

    configuration: mink.Configuration
    reach: mink.FrameTask
    posture: mink.PostureTask
    limit: mink.ConfigurationLimit
    low: Array
    high: Array
    lock: Lock

    def search(self, pose_base_tcp: Pose, q: Array) -> Array | None:
        """The solution that the search from `q` runs into, if any."""
        import mink

        self.reach.set_target(mink.SE3(pose_base_tcp.vector[[3, 4, 5, 6, 0, 1, 2]]))
        self.posture.set_target(q)
        self.configuration.update(np.clip(q, self.low, self.high))
        for _ in range(MAX_ITERATIONS):
            if self._arrived():
                return self.configuration.q.copy()
            step = mink.solve_ik(  # pyright: ignore[reportUnknownMemberType] (mink leaves its **kwargs untyped)
                self.configuration, [self.reach, self.posture], 1.0, "daqp", limits=[self.limit]
            )
            self.configuration.update(np.clip(self.configuration.q + step, self.low, self.high))
            if np.abs(step).max() < STALLED:
                break
        return self.configuration.q.copy() if self._arrived() else None

    def _arrived(self) -> bool:
        error = self.reach.compute_error(self.configuration)
        return bool(
            np.linalg.norm(error[:3]) < POSITION_TOLERANCE / 2
            and np.linalg.norm(error[3:]) < ANGLE_TOLERANCE / 2
        )


@cache
def _solver() -> _Solver:
    import mink

    arm = nominal_arm()
    low, high = joint_range()
    return _Solver(
        mink.Configuration(arm),
        mink.FrameTask("tcp", "site", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-6),
        mink.PostureTask(arm, cost=POSTURE_COST),
        mink.ConfigurationLimit(arm, min_distance_from_limits=LIMIT_MARGIN),
        low + LIMIT_MARGIN,
        high - LIMIT_MARGIN,
        Lock(),
    )


@lru_cache(CACHED_POSES)
def _solve(key: tuple[float, ...], seed: tuple[float, ...] | None) -> tuple[float, ...] | None:
    pose = Pose.of(key[:3], key[3:])
    if _too_far(pose):
        return None
    solver = _solver()
    with solver.lock:
        for q in _seeds(pose, seed):
            found = solver.search(pose, q)
            if found is not None:
                return tuple(found.tolist())
    return None


def _seeds(pose_base_tcp: Pose, seed: tuple[float, ...] | None) -> Iterator[Array]:
    if seed is not None:
        yield np.array(seed)
    azimuth = float(np.arctan2(pose_base_tcp.position[1], pose_base_tcp.position[0]))
    ready = np.array(HOME) + azimuth * np.eye(7)[0]
    tool_x = pose_base_tcp.rotation[:, 0]
    turned = azimuth - float(np.arctan2(tool_x[1], tool_x[0]))
    yield ready + np.remainder(turned + np.pi, 2 * np.pi) * np.eye(7)[6] - np.pi * np.eye(7)[6]
    for turn in TURNS:
        yield ready + turn


def _too_far(pose_base_tcp: Pose) -> bool:
    """Whether the wrist would be farther from the shoulder than all links between them,
    stretched."""
    arm = nominal_arm()
    shoulder, forearm = arm.body("fr3_link2").id, arm.body("fr3_link7").id
    stretched = np.linalg.norm(arm.body_pos[shoulder + 1 : forearm + 1], axis=1).sum()
    flange = arm.body("hand").pos[2] + arm.site("tcp").pos[2]
    wrist = pose_base_tcp.apply((0.0, 0.0, -flange))
    return bool(np.linalg.norm(wrist - arm.body("fr3_link1").pos) > stretched)
