"""The safety predicate p_safe(s_t) of the paper: pure functions of the cached state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import Limits
from palpate.robots.robot import RobotState
from palpate.trace.samples import STANDARD_GRAVITY

JOINT_MARGIN = 0.01
"""rad: a joint this near to its end stop is a violation."""

ORIGIN = Pose.of((0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Expectation:
    """Forces that the current action of the arm explains.

    Attributes:
        holding: an object hangs on the hand, so vertical force up to the payload is normal.
        contact: touching something is the purpose, so force up to the limit is normal.
        grasped: the fingers must still be on something; losing it is a slip.
    """

    holding: bool = False
    contact: bool = False
    grasped: bool = False


def violation(
    state: RobotState,
    limits: Limits,
    expected: Expectation,
    pose_world_base: Pose = ORIGIN,
    gravity: float = STANDARD_GRAVITY,
) -> str | None:
    """The first violated predicate, worded with its figures; None while the state is safe.

    Sensor data comes first: nothing else can be judged by values that are stale or not numbers.
    `gravity` (m/s^2) is what a held object's mass is weighed with.
    """
    return (
        state.fault
        or _not_finite(state)
        or _stale(state, limits)
        or _joints(state, limits)
        or _workspace(state, limits, pose_world_base)
        or _tracking(state, limits)
        or _forces(state, limits, expected, gravity)
        or _torques(state, limits)
        or _slip(state, expected)
    )


def unexplained_force(
    state: RobotState, limits: Limits, holding: bool, gravity: float = STANDARD_GRAVITY
) -> Array:
    """(3,) N: the external force less what a held object up to the payload may weigh."""
    force = state.contact[:3].copy()
    if holding:
        force[2] -= min(max(force[2], 0.0), limits.payload * gravity)
    return force


def _not_finite(state: RobotState) -> str | None:
    signals = (
        state.q,
        state.dq,
        state.tau,
        state.tau_ext,
        state.wrench,
        state.contact,
        state.twist,
        state.pose_world_tcp.position,
        state.pose_world_tcp.quaternion,
    )
    if np.isfinite(np.concatenate(signals)).all() and math.isfinite(state.width):
        return None
    bad = [
        name
        for name in ("q", "dq", "tau", "tau_ext", "wrench", "contact", "twist")
        if not np.isfinite(getattr(state, name)).all()
    ]
    return f"sensor data is not finite: {', '.join(bad) or 'pose or width'}"


def _stale(state: RobotState, limits: Limits) -> str | None:
    age = state.t - state.stamp
    if age <= limits.stale_after:
        return None
    return f"sensor data is {1e3 * age:.0f} ms old, more than {1e3 * limits.stale_after:.0f} ms"


def _joints(state: RobotState, limits: Limits) -> str | None:
    room = np.minimum(state.q - limits.q_min, limits.q_max - state.q)
    if room.min() < JOINT_MARGIN:
        i = int(room.argmin())
        return (
            f"joint {i + 1} is at {state.q[i]:.3f} rad, within {JOINT_MARGIN:g} rad of its range "
            f"[{limits.q_min[i]:.3f}, {limits.q_max[i]:.3f}]"
        )
    excess = np.abs(state.dq) - limits.dq_max
    if excess.max() > 0:
        i = int(excess.argmax())
        return f"joint {i + 1} moves at {state.dq[i]:.2f} rad/s, more than {limits.dq_max[i]:.2f} rad/s"
    return None


def _workspace(state: RobotState, limits: Limits, pose_world_base: Pose) -> str | None:
    position = state.pose_world_tcp.position
    x, y, z = pose_world_base.rotation.T @ (position - pose_world_base.position)
    low, high = limits.workspace_min, limits.workspace_max
    if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
        return None
    return (
        f"the TCP is at {_vector(np.array([x, y, z]))} m from the base, outside the workspace "
        f"{_vector(low)} to {_vector(high)} m"
    )


def _tracking(state: RobotState, limits: Limits) -> str | None:
    speed = _norm(state.twist[:3])
    if speed > limits.speed_max:
        return f"the TCP moves at {speed:.2f} m/s, more than {limits.speed_max:.2f} m/s"
    error = state.pose_world_tcp.distance_to(state.target_world_tcp)
    if error > limits.tracking_max:
        return (
            f"the TCP is {1e3 * error:.0f} mm from where it is commanded, more than "
            f"{1e3 * limits.tracking_max:.0f} mm: something holds it back"
        )
    return None


def _torques(state: RobotState, limits: Limits) -> str | None:
    size = np.abs(state.tau)
    excess = size - limits.tau_max
    if excess.max() <= 0:
        return None
    i = int(excess.argmax())
    return f"joint {i + 1} bears {size[i]:.1f} N m, more than {limits.tau_max[i]:.0f} N m"


def _forces(state: RobotState, limits: Limits, expected: Expectation, gravity: float) -> str | None:
    weight = limits.payload * gravity
    if expected.holding and state.contact[2] > weight + limits.overload:
        return (
            f"the held object pulls with {state.contact[2]:.1f} N, more than the payload of {limits.payload:g} kg "
            f"({weight:.1f} N)"
        )
    force = unexplained_force(state, limits, expected.holding, gravity)
    size, twisting = _norm(force), _norm(state.contact[3:])
    if size > limits.force_max:
        return f"external force {size:.1f} N exceeds the limit of {limits.force_max:.0f} N"
    if twisting > limits.torque_max:
        return (
            f"external torque {twisting:.1f} N m exceeds the limit of {limits.torque_max:.0f} N m"
        )
    explained = _explained(limits, expected)
    if size > explained:
        return (
            f"unexpected contact: {size:.1f} N {_vector(force)} where at most "
            f"{explained:g} N is explained"
        )
    return None


def _explained(limits: Limits, expected: Expectation) -> float:
    """N that belong to what the arm is doing, besides a weight."""
    if expected.contact:
        return limits.force_max
    if expected.holding:
        return max(limits.free_force, limits.reflexes.carrying.force)
    return limits.free_force


def _slip(state: RobotState, expected: Expectation) -> str | None:
    if not expected.grasped or state.gripping:
        return None
    return f"slip: the fingers closed to {1e3 * state.width:.1f} mm and hold nothing any more"


def _norm(v: Array) -> float:
    return math.sqrt(v @ v)


def _vector(v: Array) -> str:
    return f"({', '.join(f'{c:.2f}' for c in v)})"
