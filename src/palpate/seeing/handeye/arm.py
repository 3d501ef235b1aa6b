"""Errors of an arm's kinematics: 35 unknowns, the Jacobian of the hand's pose by them, and their prior deviations.

They are the zeros of the seven encoders, how the seven joints give way under the arm's weight beyond their
encoders, and the place of each of seven links in the one before, along three axes.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.trace.samples import STANDARD_GRAVITY

ZEROS = 1e-3
"""rad (1 sigma), of the encoders' zeros: uncalibrated Pandas are off by up to the order of 10 mm, calibrated
ones by 0.2 mm (Franzese, Spahn, Kober, Della Santina, 2025, arXiv:2503.12584)."""
GIVES = 2e-5
"""rad per N m (1 sigma), by which a joint gives way beyond its encoder under the arm's weight: joints of 7000 N m/rad
(franka_description), of which the arm's own computation of its angles leaves a seventh."""
LINKS = 3e-4
"""m (1 sigma): by which the place of a link in the one before is off, along each axis."""
BENT = 1e-4
"""m (1 sigma), what nothing else of the arm explains, such as links that bend."""
LEVER = 0.5
"""m: an arm that is off by its repeatability at the hand is turned by this part of it."""
STDS = np.repeat([ZEROS, GIVES, LINKS], [7, 7, 21])
"""(35,) of the errors: rad, rad per N m, m."""


def stances(arm: RobotDescription, q: Array) -> tuple[list[Pose], Array]:
    """Poses of the TCP in the base's frame at configurations (n, 7), and Jacobians (n, 6, 35) by the errors, along
    the base's axes."""
    nominal = NominalArm(arm, Pose.of([0, 0, 0]), np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    at = nominal.kinematics(q)
    gives = at.jacobian * at.gravity_torque[:, None]
    offsets = np.pad(nominal.offsets(q), ((0, 0), (0, 3), (0, 0)))
    hands = [Pose(row[:3], row[3:]) for row in at.pose_world_tcp]
    return hands, np.concatenate([at.jacobian, gives, offsets], axis=2)


def carried(point: Array) -> Array:
    """(6, 6) step of a pose at a point (3,), m and rad, by a twist about the origin."""
    x, y, z = point
    found = np.eye(6)
    found[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return found


def unexplained(repeatability: float) -> Array:
    """(6,) standard deviations, m and rad, of what is left of an error of the hand that differs at every pose."""
    place = math.hypot(repeatability, BENT)
    return np.repeat([place, place / LEVER], 3)


def uncertainty(arm: RobotDescription, q: Array, lever: Array) -> Array:
    """(6, 6) covariance of the pose, along the base's axes, of what the hand carries at `lever` (3,), m from
    the TCP, along the same, in configuration `q` (7,)."""
    way = carried(lever)
    moves = way @ stances(arm, q[None])[1][0] * STDS
    rest = way * unexplained(arm.nominal.pose_repeatability)
    return moves @ moves.T + rest @ rest.T
