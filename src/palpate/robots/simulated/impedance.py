"""Cartesian and joint impedance control, run by MuJoCo at every 1 ms step.

The springs and dampers are actuators: three along the world's axes and an orientation servo between
the TCP and the world, one at each joint, and a damper of the null space. Their set-points, and the nominal
model's feed-forward and posture torques, are the controls. Feedback is from the encoders alone; torque
sensing is not in the loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.description import RobotDescription
from palpate.robots.model import PREFIX
from palpate.robots.nominal import RIDGE
from palpate.robots.sheet import Stiffness

POSTURE_RATE = 5.0  # rad/s, natural frequency of the null space about its posture
MOST_AWAY = 0.5  # rad from the posture at which its pull saturates

ORIGIN = PREFIX + "origin"
AXES = tuple(f"{PREFIX}cartesian_{axis}" for axis in "xyz")
ORIENTATION = PREFIX + "orientation"
DRIVES = tuple(f"{PREFIX}drive{i}" for i in range(1, 8))
NULL_SPACE = PREFIX + "null_space"


def add_actuators(world: mujoco.MjSpec, arm: RobotDescription) -> None:
    """Add the controller's actuators to a world that the robot is attached to.

    They inherit the arm's own defaults, and none of the scene's.
    """
    own = world.find_default(PREFIX + "main")
    world.worldbody.add_site(own, name=ORIGIN, group=4)
    site, tcp = mujoco.mjtTrn.mjTRN_SITE, PREFIX + arm.tcp
    for i, name in enumerate(AXES):
        axis = world.add_actuator(own, name=name, trntype=site, target=tcp, refsite=ORIGIN)
        axis.gear = np.eye(6)[i]
        axis.set_to_position(kp=1.0, kv=1.0)
    turn = world.add_actuator(own, name=ORIENTATION, trntype=site, target=tcp, refsite=ORIGIN)
    turn.set_to_orientation(kp=1.0, kv=1.0, ctrlspec=mujoco.mjtCtrlChart.mjCHART_QUAT)
    for name, joint in zip(DRIVES, arm.joints, strict=True):
        drive = world.add_actuator(
            own, name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=PREFIX + joint
        )
        drive.set_to_position(kp=1.0, kv=1.0)
        world.joint(PREFIX + joint).actgravcomp = True
    # A tendon whose length is n q, with the null space's axis n of the present run of cycles.
    tendon = world.add_tendon(own, name=NULL_SPACE)
    for joint in arm.joints:
        tendon.wrap_joint(PREFIX + joint, 1.0)
    swivel = world.add_actuator(
        own, name=NULL_SPACE, trntype=mujoco.mjtTrn.mjTRN_TENDON, target=NULL_SPACE
    )
    swivel.set_to_position(kp=1.0, kv=1.0)


class Inertia(NamedTuple):
    """Inertia that the springs act on in one configuration."""

    tcp: Array  # (6, 6), world axes
    joints: Array  # (7, 7)

    @classmethod
    def of(cls, mass_matrix: Array, jacobian: Array) -> Inertia:
        """Compute both from the joint-space inertia M (7, 7) and the Jacobian J (6, 7), world axes
        about the TCP: (J M^-1 J^T)^-1."""
        mobility = jacobian @ np.linalg.solve(mass_matrix, jacobian.T)
        inverse = np.linalg.inv(mobility + 1e-6 * np.eye(6))  # finite in singular poses, too
        return cls(np.asarray(inverse, dtype=np.float64), mass_matrix)


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """Stiffness of the active springs, and their critical damping 2 sqrt(k m) with the inertia that
    each moves."""

    # True if the TCP's springs act, and the joint drives take torques; else the joints' springs act
    cartesian: bool
    stiffness: Array  # (6,) at the TCP, world axes, or (7,) at the joints
    damping: Array  # likewise
    inertia: Array  # (6, 6) or (7, 7) that they move
    own: Array  # (7,) kg m^2, each joint's own

    @classmethod
    def of_tcp(cls, springs: Stiffness, inertia: Inertia) -> Gains:
        """Return the gains of the TCP's springs."""
        stiffness = np.repeat([springs.translation, springs.rotation], 3)
        along = np.diag(inertia.tcp).copy()
        along[3:] = along[3:].mean()  # the orientation servo has one damping for all axes
        damping = 2 * np.sqrt(stiffness * along)
        return cls(True, stiffness, damping, inertia.tcp, np.diag(inertia.joints))

    @classmethod
    def of_joints(cls, springs: Stiffness, inertia: Inertia) -> Gains:
        """Return the gains of the joints' springs."""
        own = np.diag(inertia.joints)
        return cls(False, springs.joints, 2 * np.sqrt(springs.joints * own), inertia.joints, own)

    @classmethod
    def of_torques(cls, inertia: Array) -> Gains:
        """Return zero gains: the joint drives take torques. `inertia` (7, 7) kg m^2."""
        return cls(False, np.zeros(7), np.zeros(7), inertia, np.diag(inertia))

    def dampers(self, jacobian: Array, swivel: Swivel) -> Array:
        """Map all dampers to the joints, (7, 7): J^T D J for the TCP's, beside the null space's."""
        if not self.cartesian:
            return np.diag(self.damping)
        own = swivel.damping * np.outer(swivel.axis, swivel.axis)
        return jacobian.T @ (self.damping[:, None] * jacobian) + own

    def on(self, rows: Array, each: Array, jacobian: Array) -> Array:
        """Map rows of joint angles or rates (n, 7) through `stiffness` or `damping` to torques (n, 7), with the
        Jacobians (n, 6, 7)."""
        if not self.cartesian:
            return rows * each
        forces = (jacobian @ rows[:, :, None])[:, :, 0] * each
        return (forces[:, None] @ jacobian)[:, 0]

    def lead(self, rate: Array, acceleration: Array) -> Array:
        """Compute the lead (n, 6 or 7) of the springs' set-points for a motion without lag.

        Args:
            rate, acceleration: (n, 6 or 7) of the motion, in the springs' axes.
        """
        return (self.damping * rate + acceleration @ self.inertia) / self.stiffness


class Swivel(NamedTuple):
    """Motion of the elbow with the TCP at rest, in one configuration: the null space of an arm with seven joints."""

    axis: Array  # (7,) unit vector n of joint rates without a twist, J n = 0; torques along it make no force
    damping: float  # N m s/rad, critical with the inertia n^T M n of the joints alone
    own: Array  # (7,) kg m^2, that inertia joint by joint

    @classmethod
    def of(cls, jacobian: Array, own: Array) -> Swivel:
        """Compute it from the Jacobian J (6, 7) and the joints' own inertia (7,), kg m^2."""
        from scipy.linalg.lapack import dposv

        # The projection 1 - J^T (J J^T)^-1 J is n n^T: its largest column shows n.
        onto = np.eye(7) - jacobian.T @ dposv(jacobian @ jacobian.T + RIDGE, jacobian)[1]
        axis = onto[:, int(onto.diagonal().argmax())]
        axis = axis / math.sqrt(axis @ axis)
        return cls(axis, 2 * POSTURE_RATE * float(own @ axis**2), own)

    def torque(self, away: Array, rates: Array) -> Array:
        """Compute the torques along the axis (n,), N m, that close the distance `away` (7,), rad, and follow the rates
        (n, 7), rad/s, on top of the damper."""
        near = np.minimum(np.maximum(away, -MOST_AWAY), MOST_AWAY)
        torques = self.own * (POSTURE_RATE**2 * near + 2 * POSTURE_RATE * rates)
        return torques @ self.axis


class Actuators:
    """The controller's actuators in a model, and the setting of their gains.

    Attributes:
        position, orientation, drives, swivel: indices into `ctrl`.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._gain, self._bias = model.actuator_gainprm, model.actuator_biasprm
        self._axes = [model.actuator(name).id for name in AXES]
        self._turn = model.actuator(ORIENTATION).id
        self._drives = [model.actuator(name).id for name in DRIVES]
        first = model.actuator_ctrladr
        place, turn, drive = (int(first[i]) for i in (self._axes[0], self._turn, self._drives[0]))
        self.position, self.orientation = slice(place, place + 3), slice(turn, turn + 4)
        self.drives = slice(drive, drive + 7)
        self._swivel = model.actuator(NULL_SPACE).id
        self.swivel = int(first[self._swivel])
        wraps = int(model.tendon_adr[model.tendon(NULL_SPACE).id])
        self._axis = model.wrap_prm[wraps : wraps + 7]

    def set(self, gains: Gains) -> None:
        """Activate these springs alone; where the joints' are off, their drives are torque inputs."""
        if gains.cartesian:
            self._spring(self._axes, gains.stiffness[:3], gains.damping[:3])
            self._spring(self._turn, gains.stiffness[3], gains.damping[3])
            self._gain[self._drives, 0], self._bias[self._drives] = 1.0, 0.0
        else:
            self._spring([*self._axes, self._turn, self._swivel], 0.0, 0.0)
            self._spring(self._drives, gains.stiffness, gains.damping)
        if not gains.stiffness.any():
            self._gain[self._drives, 0] = 1.0

    def damp(self, swivel: Swivel) -> None:
        """Damp the null space, with its torque as the control."""
        self._axis[:] = swivel.axis
        self._spring(self._swivel, 0.0, swivel.damping)
        self._gain[self._swivel, 0] = 1.0

    def _spring(
        self, which: list[int] | int, stiffness: Array | float, damping: Array | float
    ) -> None:
        self._gain[which, 0] = stiffness
        self._bias[which, 1], self._bias[which, 2] = -np.asarray(stiffness), -np.asarray(damping)
