"""Cartesian and joint impedance control, run by MuJoCo at every 1 ms step.

The springs and dampers are actuators: three along the world's axes and an orientation servo between the TCP and the
world, one at each joint. Their set-points, and the nominal model's feed-forward and null-space torques, are the
controls. Feedback is the encoders' alone; torque sensing does not enter the loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from palpate.pose import Array
from palpate.robots.model import ARM, wrench

STIFFNESS = 3000.0
"""N/m: 1.5 kg sag by 5 mm, and at 0.015 m/s a contact's force rises by 45 N/s."""
TURNING_STIFFNESS = 150.0
"""N m/rad."""
JOINT_STIFFNESS = np.array([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
"""N m/rad: franka_ros' joint impedance defaults."""
POSTURE_STIFFNESS, POSTURE_DAMPING = 10.0, 6.0
"""N m/rad and N m s/rad, of the null-space posture."""

PREFIX = "robot/"
ORIGIN = PREFIX + "origin"
AXES = tuple(f"{PREFIX}cartesian_{axis}" for axis in "xyz")
ORIENTATION = PREFIX + "orientation"
DRIVES = tuple(f"{PREFIX}drive{i}" for i in range(1, 8))


def equip(world: mujoco.MjSpec) -> None:
    """Add the controller's actuators to a world that the robot is attached to."""
    world.worldbody.add_site(name=ORIGIN, group=4)
    site = mujoco.mjtTrn.mjTRN_SITE
    for i, name in enumerate(AXES):
        axis = world.add_actuator(name=name, trntype=site, target=PREFIX + "tcp", refsite=ORIGIN)
        axis.gear = np.eye(6)[i]
        axis.set_to_position(kp=1.0, kv=1.0)
    turn = world.add_actuator(name=ORIENTATION, trntype=site, target=PREFIX + "tcp", refsite=ORIGIN)
    turn.set_to_orientation(kp=1.0, kv=1.0, ctrlspec=mujoco.mjtCtrlChart.mjCHART_QUAT)
    for name, joint in zip(DRIVES, ARM, strict=True):
        drive = world.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=PREFIX + joint)
        drive.set_to_position(kp=1.0, kv=1.0)
    for joint in ARM:
        world.joint(PREFIX + joint).actgravcomp = True


class Damping(NamedTuple):
    """Critical damping at one configuration: (3,) N s/m, N m s/rad, (7,) N m s/rad."""

    linear: Array
    turning: float
    joints: Array


def critical_damping(mass_matrix: Array, jacobian: Array) -> Damping:
    """2 sqrt(k m) with the apparent inertia that each spring moves.

    Args:
        mass_matrix: (7, 7). jacobian: (6, 7), world axes about the TCP.
    """
    apparent = np.linalg.inv(jacobian @ np.linalg.solve(mass_matrix, jacobian.T) + 1e-6 * np.eye(6))
    along = np.diag(apparent)
    return Damping(2 * np.sqrt(STIFFNESS * along[:3]), 2 * float(np.sqrt(TURNING_STIFFNESS * along[3:].mean())),
                   2 * np.sqrt(JOINT_STIFFNESS * np.diag(mass_matrix)))


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """Which springs act now, and their damping.

    Attributes:
        cartesian: the TCP's springs act, and the joint drives take torques; else the joints' springs act.
        damping: (6, 1) at the TCP, world axes, or (7, 7) at the joints.
    """

    cartesian: bool
    damping: Array

    def joint_damping(self, jacobian: Array) -> Array:
        """What all dampers come to at the joints, (7, 7)."""
        return jacobian.T @ (self.damping * jacobian) if self.cartesian else self.damping


class Actuators:
    """Where the controller's actuators are in a model, and the setting of their gains.

    Attributes:
        position, orientation, drives: indices into `ctrl`.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._gain, self._bias = model.actuator_gainprm, model.actuator_biasprm
        self._axes = [model.actuator(name).id for name in AXES]
        self._turn = model.actuator(ORIENTATION).id
        self._drives = [model.actuator(name).id for name in DRIVES]
        first = model.actuator_ctrladr
        self.position = slice(int(first[self._axes[0]]), int(first[self._axes[0]]) + 3)
        self.orientation = slice(int(first[self._turn]), int(first[self._turn]) + 4)
        self.drives = slice(int(first[self._drives[0]]), int(first[self._drives[0]]) + 7)

    def cartesian(self, damping: Damping) -> Gains:
        """Let the TCP's springs act; the joint drives become torque inputs."""
        self._spring(self._axes, STIFFNESS, damping.linear)
        self._spring(self._turn, TURNING_STIFFNESS, damping.turning)
        self._gain[self._drives, 0], self._bias[self._drives] = 1.0, 0.0
        return Gains(True, np.concatenate([damping.linear, np.full(3, damping.turning)])[:, None])

    def joints(self, damping: Damping) -> Gains:
        """Let the joints' springs act alone."""
        self._spring(self._axes, 0.0, 0.0)
        self._spring(self._turn, 0.0, 0.0)
        self._spring(self._drives, JOINT_STIFFNESS, damping.joints)
        return Gains(False, np.diag(damping.joints))

    def _spring(self, which: list[int] | int, stiffness: Array | float, damping: Array | float) -> None:
        self._gain[which, 0] = stiffness
        self._bias[which, 1], self._bias[which, 2] = -np.asarray(stiffness), -np.asarray(damping)


def posture_torque(q: Array, dq: Array, posture: Array, jacobian: Array) -> Array:
    """(7,) N m towards `posture`, projected so that the TCP feels no force of it."""
    torque = POSTURE_STIFFNESS * (posture - q) - POSTURE_DAMPING * dq
    return torque - jacobian.T @ wrench(jacobian, torque)
