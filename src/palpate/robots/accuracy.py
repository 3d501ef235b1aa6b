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
"""Ticks whose median is the measured wrench: 60 ms, in which a probing arm moves 1 mm at most."""
RUBBING = 1.0
"""N m, root of the sum of squares of the friction of a Franka's joints in its sensors: half of phi_1 of
Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, RA-L 2019, doi:10.1109/LRA.2019.2931248."""
SURELY = 2.0
"""Times that, with what the owner knows of rests and noise, from which a torque is no error: conforming
runs leave up to 1.25 N m unexplained (ten scenarios at `hardware` and `measured`), 0.35 at `lab`."""


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """Standard deviations of a moment measured in one configuration, from the joints' errors."""

    # (7,) N m, of relative errors of each joint's sensor and links: equal in all configurations
    lasting: Array
    fleeting: float  # N m, of errors that differ at every rest: friction, drift and noise

    def of_change(self, since: Doubt) -> float:
        """Compute the standard deviation, N m, of the change from another configuration."""
        lasting = float(np.linalg.norm(self.lasting - since.lasting))
        return float(np.hypot(lasting, np.hypot(self.fleeting, since.fleeting)))


def doubt(arm: RobotDescription, q: Array, tau: Array, axis: Array) -> Doubt:
    """Compute the uncertainty of the moment about the unit `axis` (3,), in the base's axes, measured
    at rest at joint angles `q` (7,), rad, with joint torques `tau` (7,), N m.

    The wrench at the TCP is (J J^T)^-1 J tau, and so is its deviation. A gain error of uniform
    distribution has its half width over sqrt(3) as standard deviation.
    """
    sensors, gain = arm.sensors, arm.nominal.torque_gain / np.sqrt(3.0)
    levers = moments(arm, q).T @ axis
    relative = np.hypot(gain, sensors.link_mass)
    noise = sensors.torque_noise / np.sqrt(SUSTAINED)
    rest = np.maximum(sensors.friction, arm.rest_torque)
    own = np.sqrt(rest**2 + noise**2 + sensors.drift**2)
    return Doubt(relative * levers * tau, float(np.linalg.norm(own * levers)))


def rubbing(arm: RobotDescription, pose_base_tcp: Pose) -> float:
    """Compute the largest moment about the TCP, N m, that friction of `RUBBING` looks like at a pose.

    Where the wrist's first and last axis are nearly parallel, their torques carry no information on a
    moment across them, and friction may look like any.
    """
    return RUBBING * _magnified(arm, tuple(pose_base_tcp.vector.round(6).tolist()))


@lru_cache
def unexplained_torque(arm: RobotDescription) -> float:
    """Compute the torque, N m, norm over the joints, beyond which errors of the arm explain it no more:
    friction of `RUBBING`, what rests leave, the sensors' noise."""
    rest = np.maximum(arm.sensors.friction, arm.rest_torque)
    noise = arm.sensors.torque_noise / np.sqrt(SUSTAINED)
    return SURELY * float(np.sqrt(RUBBING**2 + rest @ rest + noise @ noise))


def mistaken_force(arm: RobotDescription, q: Array) -> float:
    """Compute the largest force on the TCP, N, that `unexplained_torque` looks like at joint angles `q` (7,), rad.

    The force is (J J^T)^-1 J tau. A stretched arm has no lever on a force along it: a little friction
    looks like a large one.
    """
    return unexplained_torque(arm) * float(np.linalg.norm(_unit_wrenches(arm, q)[:3], 2))


def mistaken_moment(arm: RobotDescription, q: Array) -> float:
    """Compute the largest moment about the TCP, N m, that `unexplained_torque` looks like, likewise."""
    return unexplained_torque(arm) * float(np.linalg.norm(moments(arm, q), 2))


@lru_cache(maxsize=4096)
def _magnified(arm: RobotDescription, pose: tuple[float, ...]) -> float:
    """Compute the largest moment about the TCP, N m, of joint torques of 1 N m, at a pose."""
    there = Pose(np.array(pose[:3]), np.array(pose[3:]))
    return float(np.linalg.norm(moments(arm, configuration(arm, there)), 2))


def moments(arm: RobotDescription, q: Array) -> Array:
    """Compute the moments about the TCP (3, 7), in the base's axes, of unit torques of the joints."""
    return _unit_wrenches(arm, q)[3:]


def _unit_wrenches(arm: RobotDescription, q: Array) -> Array:
    """Compute the wrenches at the TCP (6, 7), in the base's axes, of unit torques of the joints."""
    there = jacobian(arm, q)
    return np.linalg.solve(there @ there.T + RIDGE, there).astype(np.float64)
