"""The safety predicate p_safe(s_t) of the paper, as pure functions of the cached state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.description import Limits
from palpate.robots.robot import RobotState
from palpate.robots.sheet import Links
from palpate.trace.samples import STANDARD_GRAVITY

JOINT_MARGIN = 0.01  # rad: a joint nearer to its end stop is a violation
ORIGIN = Pose.of((0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Expectation:
    """Forces that the current action of the arm explains."""

    holding: bool = False  # an object is on the hand: a vertical force up to the payload is normal
    contact: bool = False  # contact is the purpose: force up to the limit is normal
    grasped: bool = False  # the fingers must hold an object; losing it is a slip
    # N, as in `Reflex`: a force is unexplained only if it and its change from this one are both too
    # large.
    pressed: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # N: largest force that errors of the joint torques imitate where the arm moves; it is no
    # contact.
    mistaken: float = 0.0


def violation(
    state: RobotState,
    limits: Limits,
    expected: Expectation,
    pose_world_base: Pose = ORIGIN,
    gravity: float = STANDARD_GRAVITY,
    links: Links | None = None,
) -> str | None:
    """Return the first violated predicate with its figures; None while the state is safe.

    Checks of the sensor data come first: the other checks need finite and recent values. `gravity` (m/s^2)
    gives the weight of a held object. `links` has the torque thresholds of contact with a link; None skips
    this check.
    """
    return (
        state.fault
        or _not_finite(state)
        or _stale(state, limits)
        or _joints(state, limits)
        or _workspace(state, limits, pose_world_base)
        or _tracking(state, limits)
        or _forces(state, limits, expected, gravity)
        or (links and links.stop_reason(*state.unexplained))
        or _torques(state, limits)
        or _slip(state, expected)
    )


def unexplained_force(
    state: RobotState, limits: Limits, holding: bool, gravity: float = STANDARD_GRAVITY
) -> Array:
    """Return the external force (3,), N, less the weight of a held object up to the payload."""
    force = state.contact[:3].copy()
    if holding:
        force[2] -= min(max(force[2], 0.0), limits.payload * gravity)
    return force


def _not_finite(state: RobotState) -> str | None:
    names = ("q", "dq", "tau", "tau_ext", "wrench", "contact", "twist")
    signals = [getattr(state, name) for name in names]
    pose = state.pose_world_tcp
    everything = np.concatenate([*signals, pose.position, pose.quaternion])
    if np.isfinite(everything).all() and math.isfinite(state.width):
        return None
    bad = [name for name, v in zip(names, signals, strict=True) if not np.isfinite(v).all()]
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
    place = pose_world_base.rotation.T @ (position - pose_world_base.position)
    low, high = limits.workspace_min, limits.workspace_max
    if (low <= place).all() and (place <= high).all():
        return None
    return (
        f"the TCP is at {_vector(place)} m from the base, outside the workspace "
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
    weight, lift = limits.payload * gravity, state.contact[2]
    if expected.holding and lift > weight + limits.overload:
        return (
            f"the held object pulls with {lift:.1f} N, more than the payload of "
            f"{limits.payload:g} kg ({weight:.1f} N)"
        )
    force = unexplained_force(state, limits, expected.holding, gravity)
    size, torque = _norm(force), _norm(state.contact[3:])
    if size > limits.force_max:
        return f"external force {size:.1f} N exceeds the limit of {limits.force_max:.0f} N"
    if torque > limits.torque_max:
        return f"external torque {torque:.1f} N m exceeds the limit of {limits.torque_max:.0f} N m"
    explained = max(limits.free_force, expected.mistaken)  # N, by the current action
    if expected.holding:
        explained = max(explained, limits.reflexes.carrying.force)
    if expected.contact:
        explained = limits.force_max
    if size > explained and math.dist(state.contact[:3], expected.pressed) > explained:
        return (
            f"unexpected contact: {size:.1f} N {_vector(force)} where at most "
            f"{explained:g} N is explained"
        )
    return None


def _slip(state: RobotState, expected: Expectation) -> str | None:
    if not expected.grasped or state.gripping:
        return None
    return f"slip: the fingers closed to {1e3 * state.width:.1f} mm and hold nothing any more"


def _norm(v: Array) -> float:
    return math.sqrt(v @ v)


def _vector(v: Array) -> str:
    return f"({', '.join(f'{c:.2f}' for c in v)})"
