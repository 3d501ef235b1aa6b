"""Springs of an impedance controller: the inertia that they move, their gains, and the null space of the arm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.common.pose import Array
from palpate.robots.nominal import RIDGE
from palpate.robots.sheet import ControllerStiffness

POSTURE_RATE = 5.0  # rad/s, natural frequency of the null space about its posture
MOST_AWAY = 0.5  # rad from the posture at which its pull saturates


class SpringInertia(NamedTuple):
    """Inertia that the springs act on in one configuration."""

    tcp: Array  # (6, 6), world axes
    joints: Array  # (7, 7)

    @classmethod
    def of(cls, mass_matrix: Array, jacobian: Array) -> SpringInertia:
        """Compute both from the joint-space inertia M (7, 7) and the Jacobian J (6, 7), world axes about the TCP.

        The inertia at the TCP is (J M^-1 J^T)^-1.
        """
        mobility = jacobian @ np.linalg.solve(mass_matrix, jacobian.T)
        inverse = np.linalg.inv(mobility + 1e-6 * np.eye(6))  # finite in singular poses, too
        return cls(np.asarray(inverse, dtype=np.float64), mass_matrix)


@dataclass(frozen=True, slots=True, eq=False)
class SpringGains:
    """Stiffness of the active springs, and their critical damping 2 sqrt(k m), where m is the
    inertia that each spring moves."""

    # True if the TCP's springs act, and the joint drives take torques; else the joints' springs act
    cartesian: bool
    stiffness: Array  # (6,) at the TCP, world axes, or (7,) at the joints
    damping: Array  # (6,) or (7,), in the axes of the stiffness
    inertia: Array  # (6, 6) or (7, 7) that they move
    own: Array  # (7,) kg m^2, diagonal of the joint-space inertia

    @classmethod
    def of_tcp(cls, springs: ControllerStiffness, inertia: SpringInertia) -> SpringGains:
        """Return the gains of the TCP's springs."""
        stiffness = np.repeat([springs.translation, springs.rotation], 3)
        along = np.diag(inertia.tcp).copy()
        along[3:] = along[3:].mean()  # the orientation servo has one damping for all axes
        damping = 2 * np.sqrt(stiffness * along)
        return cls(True, stiffness, damping, inertia.tcp, np.diag(inertia.joints))

    @classmethod
    def of_joints(cls, springs: ControllerStiffness, inertia: SpringInertia) -> SpringGains:
        """Return the gains of the joints' springs."""
        own = np.diag(inertia.joints)
        return cls(False, springs.joints, 2 * np.sqrt(springs.joints * own), inertia.joints, own)

    @classmethod
    def of_torques(cls, inertia: Array) -> SpringGains:
        """Return zero gains: the joint drives take torques. `inertia` (7, 7) kg m^2."""
        none = np.zeros(len(inertia))
        return cls(False, none, none, inertia, np.diag(inertia))

    def dampers(self, jacobian: Array, swivel: Swivel) -> Array:
        """Map all dampers to the joints, (7, 7): J^T D J of the TCP's dampers plus the null space's."""
        if not self.cartesian:
            return np.diag(self.damping)
        own = swivel.damping * np.outer(swivel.axis, swivel.axis)
        return jacobian.T @ (self.damping[:, None] * jacobian) + own

    def on(self, rows: Array, each: Array, jacobian: Array) -> Array:
        """Map rows of joint angles or rates (n, 7) through `stiffness` or `damping`, given as `each`.

        Return torques (n, 7), computed with the Jacobians (n, 6, 7).
        """
        if not self.cartesian:
            return rows * each
        forces = (jacobian @ rows[:, :, None])[:, :, 0] * each
        return (forces[:, None] @ jacobian)[:, 0]

    def lead(self, rate: Array, acceleration: Array) -> Array:
        """Compute the lead (n, 6 or 7) of the springs' set-points for a motion without lag, from its rate and
        acceleration (n, 6 or 7) in the springs' axes.
        """
        return (self.damping * rate + acceleration @ self.inertia) / self.stiffness


class Swivel(NamedTuple):
    """Motion of the elbow with the TCP at rest, in one configuration: the null space of an arm with seven joints.

    An arm with six joints has none: its axis and its damping are zero.
    """

    axis: Array  # (7,) unit vector n of joint rates without a twist, J n = 0; torques along it make no force
    damping: float  # N m s/rad, critical with the inertia n^T M n of the joints alone
    own: Array  # (7,) kg m^2, that inertia joint by joint

    @classmethod
    def of(cls, jacobian: Array, own: Array) -> Swivel:
        """Compute it from the Jacobian J (6, 7) and the joints' own inertia (7,), kg m^2."""
        from scipy.linalg.lapack import dposv

        joints = jacobian.shape[1]
        if joints <= len(jacobian):
            return cls(np.zeros(joints), 0.0, own)
        # The projection 1 - J^T (J J^T)^-1 J is n n^T: its largest column is parallel to n.
        onto = np.eye(joints) - jacobian.T @ dposv(jacobian @ jacobian.T + RIDGE, jacobian)[1]
        axis = onto[:, int(onto.diagonal().argmax())]
        axis = axis / math.sqrt(axis @ axis)
        return cls(axis, 2 * POSTURE_RATE * float(own @ axis**2), own)

    def torque(self, away: Array, rates: Array) -> Array:
        """Compute the torques along the axis (n,), N m, for a PD motion to the posture.

        `away` (7,), rad, is the distance from the posture; `rates` (n, 7), rad/s, are those of the posture.
        They add to the torque of the damper.
        """
        near = np.minimum(np.maximum(away, -MOST_AWAY), MOST_AWAY)
        torques = self.own * (POSTURE_RATE**2 * near + 2 * POSTURE_RATE * rates)
        return torques @ self.axis
