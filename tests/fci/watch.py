"""What an arm watches: commands that no arm can follow, its own limits, and the collisions that its
client's thresholds make of forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.robots.description import RobotDescription

from .control import Controller
from .sensing import Sensing
from .wire import Error, MotionMode, matrix

TORQUE_RATE = 1.0
"""N m that a commanded torque may change in a cycle (franka/rate_limiting.h: 1000 N m/s)."""
ACCELERATION = 10.0
"""rad/s^2 of commanded joint motions."""
CARTESIAN = ((3.0, 2.5), (9.0, 17.0))
"""m/s, rad/s and m/s^2, rad/s^2 of commanded Cartesian motions."""
SLACK = 1.01
"""A little above every limit: states are told in single precision."""
START = (1e-2, 5e-3)
"""rad, m: how far a first command may be from where the arm is."""
MOVING = 0.1
"""rad/s^2: with more of it the thresholds for phases of acceleration hold."""
DEFAULT = 20.0
"""N m, N of collisions, until a client says something else."""


class Watch:
    """Finds errors.

    Attributes:
        lower, upper: (2, 13) N m, N, N m of contacts and collisions: accelerating and else, of the
            joints and in the stiffness frame.
    """

    def __init__(self, arm: RobotDescription, controller: Controller, sensing: Sensing) -> None:
        self._limits, self._controller, self._sensing = arm.limits, controller, sensing
        self.lower = self.upper = np.full((2, 13), DEFAULT)

    def set_thresholds(self, values: Array) -> bool:
        """As SetCollisionBehavior brings them (52,); whether they are taken."""
        torques, forces = values[:28].reshape(4, 7), values[28:].reshape(4, 6)
        lower = np.concatenate([torques[[0, 2]], forces[[0, 2]]], axis=1)
        upper = np.concatenate([torques[[1, 3]], forces[[1, 3]]], axis=1)
        if (values < 0).any() or (lower > upper).any():
            return False
        self.lower, self.upper = lower, upper
        return True

    def jumps(self, torque: Array, before: Array, cycles: int) -> bool:
        """Whether a torque (7,), N m, is none that may follow the one `cycles` before."""
        return not float(np.abs(torque - before).max()) <= TORQUE_RATE * SLACK * cycles

    def impossible(self, motion: MotionMode, command: NDArray[np.void]) -> Error | None:
        """Why a motion cannot go on with a command."""
        controller, limits = self._controller, self._limits
        if motion is MotionMode.JOINT_POSITION:
            q = command["q_c"]
            if not np.abs(q - controller.desired.q).max() < START[0]:
                return Error.JOINT_START_POSE_INVALID
            if ((q < limits.q_min) | (q > limits.q_max)).any():
                return Error.JOINT_MOTION_POSITION_LIMITS
        if motion is MotionMode.CARTESIAN_POSITION:
            way = matrix(command["O_T_EE_c"])[:3, 3] - controller.target[:3, 3]
            if not np.linalg.norm(way) < START[1]:
                return Error.CARTESIAN_START_POSE_INVALID
        return None

    def too_fast(self, motion: MotionMode, cycles: int) -> Error | None:
        """Why what the controller was just told, `cycles` after the last command, is more than an
        arm can do."""
        if motion in (MotionMode.JOINT_POSITION, MotionMode.JOINT_VELOCITY):
            desired = self._controller.desired
            if not (np.abs(desired.dq) <= SLACK * self._limits.dq_max).all():
                return Error.JOINT_MOTION_VELOCITY_LIMITS
            if (np.abs(desired.ddq) > SLACK * ACCELERATION * cycles).any():
                return Error.JOINT_VELOCITY_DISCONTINUITY
            return None
        speeds, accelerations = CARTESIAN
        if not _within(self._controller.twist, speeds):
            return Error.CARTESIAN_VELOCITY_LIMITS
        if not _within(self._controller.acceleration / cycles, accelerations):
            return Error.CARTESIAN_VELOCITY_DISCONTINUITY
        return None

    def broken(self, motion: MotionMode, felt: Array) -> list[Error]:
        """Limits that the arm is beyond, and collisions; `felt` (13,) as the thresholds."""
        sensing, limits, found = self._sensing, self._limits, list[Error]()
        if (np.abs(sensing.dq) > limits.dq_max).any():
            found.append(Error.JOINT_VELOCITY)
        if (sensing.q < limits.q_min).any() or (sensing.q > limits.q_max).any():
            found.append(Error.JOINT_POSITION_LIMITS)
        if (np.abs(sensing.tau) > limits.tau_max).any():
            found.append(Error.TORQUE_RANGE)
        collided = felt > self.upper[self.phase(motion)]
        if collided[:7].any():
            found.append(Error.JOINT_REFLEX)
        if collided[7:].any():
            found.append(Error.CARTESIAN_REFLEX)
        return found

    def phase(self, motion: MotionMode) -> int:
        """Which thresholds hold: 0 while accelerating, 1 otherwise."""
        if motion is MotionMode.NONE:
            return 1
        return int(np.abs(self._controller.desired.ddq).max() <= MOVING)


def _within(rates: Array, limits: tuple[float, float]) -> bool:
    """Whether (6,) rates keep to limits of translation and rotation."""
    straight, turning = float(np.linalg.norm(rates[:3])), float(np.linalg.norm(rates[3:]))
    return straight <= SLACK * limits[0] and turning <= SLACK * limits[1]
