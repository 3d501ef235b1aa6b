"""Commands as trajectories: the springs' equilibrium as a function of time, for any robot.

Springs simulated by MuJoCo, or a real arm's controller, follow it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.nominal import NominalArm, wrench
from palpate.robots.pace import free_speeds, joint_rates
from palpate.robots.trajectory import (
    Motion,
    Path,
    PosePath,
    Stretch,
    quintic,
    slowed,
    stop,
    straight,
    stretches,
    swing,
    turned,
    wrist_turn,
)
from palpate.trace.recording import Hand

STANDING = 1e-4  # m: a shorter motion has no direction, and so no effective mass
ARC_PIECES = 50.0
"""Quintics per second of an arc: the error of the position is less than a micrometre."""
GIVING_WAY = 0.2
"""s, about 2 d / k of the TCP's springs: a stop this long moves the equilibrium on by its lead over
the arm, so that a contact keeps its force."""


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """Rotation by `angle` rad about the unit `axis` (3,) through a `point` (3,), m, world."""

    axis: Array
    point: Array
    angle: float

    def state(self, start: Array, into_tool: Array, share: Motion) -> Motion:
        """Position and rotation vector (6,) that began at `start` (3,), m, and their rates, after a `share`
        (1,) of the angle; `into_tool` (3, 3) turns to the axes of the hand at the start."""
        angle, rate, change = (self.angle * float(part[0]) for part in share)
        apart = start - self.point
        along = (apart @ self.axis) * self.axis
        across, sideways = apart - along, np.cross(self.axis, apart)
        outwards = np.cos(angle) * across + np.sin(angle) * sideways
        onwards: Array = np.cross(self.axis, outwards).astype(np.float64)
        about = into_tool @ self.axis
        return Motion(
            np.concatenate([self.point + along + outwards, angle * about]),
            np.concatenate([rate * onwards, rate * about]),
            np.concatenate([change * onwards - rate**2 * outwards, change * about]),
        )


class Commanded:
    """Base class of robots: members of `Robot` that do not depend on the controller."""

    def __init__(self, arm: RobotDescription, nominal: NominalArm, gravity: float) -> None:
        """`gravity`: m/s^2, stated or measured."""
        self._arm, self._nominal, self._gravity = arm, nominal, gravity

    @property
    def limits(self) -> Limits:
        return self._arm.limits

    @property
    def hand(self) -> Hand:
        return self._arm.nominal

    @property
    def gravity(self) -> float:
        return self._gravity

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        raise NotImplementedError

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        now, origin = self._pose_begin()
        way = travel * np.asarray(direction, dtype=float)
        self.move_pose(Pose(now.p[:3] + way, origin), speed)

    def _pose_begin(self) -> tuple[Motion, Array]:
        """Return the start of a Cartesian motion now, and the orientation (4,) that its rotation
        vector is relative to."""
        raise NotImplementedError

    def _joint_path(self, t: float, now: Motion, goal: Array, speed: float) -> Path:
        """Move from `now` at time `t`, s, to joint positions `goal` (7,), rad, at the share `speed` of
        the arm's pace, which none of its parts exceeds."""
        rates = speed * np.array(joint_rates(self._nominal, self._arm, now.p, goal))
        distance = max(float(np.abs(goal - now.p).max()), 1e-6)
        acceleration = self._arm.pace.joint_acceleration / distance
        return straight(t, now, goal, stretches(rates), acceleration)

    def _pose_path(
        self,
        t: float,
        begin: tuple[Motion, Array],
        target: Pose,
        speed: float,
        slower: Sequence[Stretch],
        q: Array,
    ) -> tuple[PosePath, Path]:
        """Move straight to `target` (world), with a joint path of the null space from joint positions
        `q` (7,), rad; within the limits of the arm's effective mass and of `slower`."""
        (now, origin), pace = begin, self._arm.pace
        bent = self._nominal.reach(target, self._arm.home)
        turn = wrist_turn(origin, target.quaternion, float(bent[6] - q[6]))
        goal = np.concatenate([target.position, turn])
        way = goal[:3] - now.p[:3]
        distance = max(float(np.linalg.norm(way)), 1e-6)
        angle = max(float(np.linalg.norm(goal[3:])), 1e-6)
        free = np.array([speed])
        if distance > STANDING:
            free = np.minimum(free_speeds(self._nominal, self._arm, (q, bent), way), speed)
        rates = np.minimum(free / distance, pace.turning_speed / angle)
        limits = [Stretch(part.end, part.speed / distance) for part in slower]
        parts = slowed(stretches(rates), limits)
        acceleration = min(pace.acceleration / distance, pace.turning_acceleration / angle)
        path = straight(t, now, goal, parts, acceleration)
        resting = Motion(q, np.zeros(7), np.zeros(7))
        return PosePath(path, origin), straight(t, resting, bent, parts, acceleration)

    def _arc_path(
        self, t: float, begin: tuple[Motion, Array], arc: Arc, speed: float, q: Array
    ) -> tuple[PosePath, Path]:
        """Turn by an arc, as `_pose_path`, with the same limits."""
        (now, origin), pace = begin, self._arm.pace
        start, into_tool = now.p[:3], Pose(now.p[:3], origin).rotation.T
        rest = np.zeros(1)
        end = arc.state(start, into_tool, Motion(np.ones(1), rest, rest))
        target = Pose(end.p[:3], turned(origin, end.p[None, 3:])[0])
        bent = self._nominal.reach(target, self._arm.home)
        way, angle = end.p[:3] - start, max(abs(arc.angle), 1e-6)
        length = max(angle * float(np.linalg.norm(np.cross(arc.axis, start - arc.point))), 1e-6)
        free = np.array([speed])
        if np.linalg.norm(way) > STANDING:
            free = np.minimum(free_speeds(self._nominal, self._arm, (q, bent), way), speed)
        parts = stretches(np.minimum(free / length, pace.turning_speed / angle))
        acceleration = min(pace.acceleration / length, pace.turning_acceleration / angle)
        share = straight(t, Motion(rest, rest, rest), np.ones(1), parts, acceleration)
        count = max(int(np.ceil((share.end - t) * ARC_PIECES)), 1)
        knots = np.linspace(t, share.end, count + 1)
        states = [arc.state(start, into_tool, share.at(one)) for one in knots.tolist()]
        duration = (share.end - t) / count
        pieces = [quintic(one, other, duration) for one, other in pairwise(states)]
        resting = Motion(q, np.zeros(7), np.zeros(7))
        posture = straight(t, resting, bent, parts, acceleration)
        return PosePath(Path(knots, np.array(pieces)), origin), posture

    def _stopped_joints(self, t: float, now: Motion) -> Path:
        """Stop a joint motion onwards."""
        return stop(t, now, self._arm.pace.joint_acceleration)

    def _stopped_pose(self, t: float, begin: tuple[Motion, Array]) -> PosePath:
        """Stop a Cartesian motion onwards; a contact keeps its force."""
        now, origin = begin
        return PosePath(stop(t, now, 2 * self._arm.pace.acceleration, GIVING_WAY), origin)

    def _ahead_of(
        self, pose: Pose, jacobian: Array, torque: Array, twist: Array
    ) -> tuple[Motion, Array]:
        """Compute the equilibrium with which the TCP's springs exert the joint torques `torque`
        (7,), N m, from the first step on, moving at `twist` (6,); and its reference orientation."""
        # Ahead of the measured pose by force / stiffness, and turned by torque / stiffness.
        springs, pull = self._arm.stiffness, wrench(jacobian, torque)
        ahead = pose.position + pull[:3] / springs.translation
        into_tool = pose.rotation.T
        turn = into_tool @ pull[3:] / springs.rotation
        origin = turned(pose.quaternion, turn[None])[0]
        now = Motion(
            np.concatenate([ahead, np.zeros(3)]),
            np.concatenate([twist[:3], into_tool @ twist[3:]]),
            np.zeros(6),
        )
        return now, origin


def swing_path(
    t: float,
    begin: tuple[Motion, Array],
    about: Array,
    angle: float,
    frequency: float,
    cycles: int,
) -> PosePath:
    """Swing about the unit axis `about` (3,) of the tool; see `Robot.swing`."""
    now, origin = begin
    amplitude = np.concatenate([np.zeros(3), angle * np.asarray(about, dtype=float)])
    return PosePath(swing(t, now, amplitude, frequency, cycles), origin)
