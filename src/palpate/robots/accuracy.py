"""Uncertainty of the wrench measured at rest, from the arm's description."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import RIDGE
from palpate.robots.pace import configuration, jacobian

SUSTAINED = 3
"""ticks whose median is what is felt: 60 ms, in which the arm goes 1 mm at most where it feels its
way."""
RUBBING = 1.0
"""N m, root of the sum of squares, with which a Franka's joints rub as its sensors see it: half of phi_1 of
Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, RA-L 2019, doi:10.1109/LRA.2019.2931248."""

REVERSED = 2.2
"""Change of friction from one side to the other, where it breaks away at 1.1 of what it is under way
(`hardware.yaml`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """Standard deviations of a moment measured in one configuration, from the joints' errors.

    Attributes:
        lasting: (7,) N m, of each joint's relative errors: those of its sensor and of the links it
            bears, the same ones in every configuration, in proportion to what the joint bears.
        fleeting: N m, of all that is another at every rest: friction, drift and noise.
    """

    lasting: Array
    fleeting: float

    def of_change(self, since: Doubt) -> float:
        """N m, standard deviation of the change of the moment from one configuration to another."""
        lasting = float(np.linalg.norm(self.lasting - since.lasting))
        return float(np.hypot(lasting, np.hypot(self.fleeting, since.fleeting)))


def doubt(arm: RobotDescription, q: Array, tau: Array, axis: Array) -> Doubt:
    """Of the moment about the unit `axis` (3,), in the base's axes, that is felt at rest at joint
    angles `q` (7,), rad, with measured joint torques `tau` (7,), N m.

    The wrench at the TCP is (J J^T)^-1 J tau, and so is its deviation. A gain error of uniform
    distribution has its half width over sqrt(3) as standard deviation.
    """
    sensors, gain = arm.sensors, arm.nominal.torque_gain / np.sqrt(3.0)
    levers = _moments(arm, q).T @ axis
    relative = np.hypot(gain, sensors.link_mass)
    noise = sensors.torque_noise / np.sqrt(SUSTAINED)
    own = np.sqrt(sensors.friction**2 + noise**2 + sensors.drift**2)
    return Doubt(relative * levers * tau, float(np.linalg.norm(own * levers)))


def rubbing(arm: RobotDescription, pose_base_tcp: Pose) -> float:
    """N m about the TCP that friction of `RUBBING` may be felt as at a pose, at most.

    Where the wrist's first and last axis come to lie along each other, no torque of theirs tells a
    moment across them, and what rubs is felt as any.
    """
    return RUBBING * _magnified(arm, tuple(pose_base_tcp.vector.round(6).tolist()))


def turned_round(arm: RobotDescription, pose_base_tcp: Pose) -> float:
    """N along the ground at the TCP by which what is felt changes at most where friction of `RUBBING` turns
    round: as the arm sets out upwards after it came down."""
    there = jacobian(arm, configuration(arm, pose_base_tcp))
    level = np.linalg.solve(there @ there.T + RIDGE, there)[:2]
    return REVERSED * RUBBING * float(np.linalg.norm(level, 2))


@lru_cache(maxsize=4096)
def _magnified(arm: RobotDescription, pose: tuple[float, ...]) -> float:
    """The largest moment about the TCP, N m, of joint torques of 1 N m, at a pose in the base's axes."""
    there = Pose(np.array(pose[:3]), np.array(pose[3:]))
    return float(np.linalg.norm(_moments(arm, configuration(arm, there)), 2))


def _moments(arm: RobotDescription, q: Array) -> Array:
    """(3, 7) moments about the TCP, in the base's axes, that torques of the joints are felt as."""
    there = jacobian(arm, q)
    wrenches: Array = np.linalg.solve(there @ there.T + RIDGE, there).astype(np.float64)
    return wrenches[3:]
