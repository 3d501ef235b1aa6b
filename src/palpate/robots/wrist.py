"""External wrench at the TCP by a six-axis sensor: its reading without the hand's own weight and inertia."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose, rotations
from palpate.robots.description import RobotDescription, tool_pose


class HandLoad:
    """The nominal hand below a six-axis sensor, and the sensor's zero."""

    def __init__(self, arm: RobotDescription, gravity: Array) -> None:
        """Take the hand of an arm with a sensor, fingers half open; `gravity` (3,) is in the world, m/s^2."""
        assert arm.nominal.wrench_sensor is not None
        model = arm.spec().compile()
        data = mujoco.MjData(model)
        for name in arm.hand.fingers:
            data.qpos[int(model.joint(name).qposadr[0])] = arm.hand.opening / 4
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        # Mass, centre and inertia of the hand and its fingers, about the centre, in the tool frame.
        tool, hand = tool_pose(model, data, arm.hand), model.body(arm.hand.body).id
        whole: Any = data.body(hand)
        centre = np.asarray(whole.subtree_com, dtype=np.float64)
        self._mass = float(model.body_subtreemass[hand])
        self._centre: Array = tool.rotation.T @ (centre - tool.position)
        self._inertia: Array = np.zeros((3, 3))
        parts = [hand]
        for i in range(hand + 1, model.nbody):  # bodies follow their parents
            if model.body_parentid[i] in parts:
                parts.append(i)
        for i in parts:
            part: Any = data.body(i)
            turn = tool.rotation.T @ np.asarray(part.ximat, dtype=np.float64).reshape(3, 3)
            x, y, z = (tool.rotation.T @ (data.xipos[i] - centre)).tolist()
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            self._inertia += (turn * model.body_inertia[i]) @ turn.T
            self._inertia += float(model.body_mass[i]) * cross.T @ cross
        # Rotation and place of the sensor in the tool frame, and gravity.
        sensor = Pose(*np.split(np.array(arm.nominal.wrench_sensor.pose_tcp_sensor), [3]))
        self._turn, self._lever, self._gravity = sensor.rotation, sensor.position, gravity
        self._zero = np.zeros(6)

    def zero(self, reading: Array, quaternion: Array) -> None:
        """Zero the sensor at rest: the hand's weight explains the mean `reading` (6,), in the sensor's axes."""
        turns, still = rotations(quaternion[None]), np.zeros((1, 6))
        own = self._own(turns, still, still)[0]
        # The expected wrench at the TCP, turned into the sensor's axes and moved to its origin.
        into = (turns[0] @ self._turn).T
        moment = own[3:] - np.cross(turns[0] @ self._lever, own[:3])
        self._zero = reading - np.concatenate([into @ own[:3], into @ moment])

    def external(
        self, reading: Array, quaternions: Array, twist: Array, acceleration: Array
    ) -> Array:
        """Compute the external wrench (n, 6) at the TCP, in world axes, N and N m.

        Args:
            reading: (n, 6), in the sensor's axes about its origin.
            quaternions: (n, 4) unit quaternions of the TCP in the world.
            twist: (n, 6) velocity of the TCP, world axes; only the angular part acts.
            acceleration: (n, 6) change of the twist, m/s^2 and rad/s^2.
        """
        turns = rotations(quaternions)
        into_world = turns @ self._turn
        found = np.empty((len(reading), 6))
        force, moment = np.split(reading - self._zero, 2, axis=1)
        found[:, :3] = np.einsum("nij,nj->ni", into_world, force)
        found[:, 3:] = np.einsum("nij,nj->ni", into_world, moment)
        found[:, 3:] += np.cross(turns @ self._lever, found[:, :3])
        return found - self._own(turns, twist, acceleration)

    def _own(self, turns: Array, twist: Array, acceleration: Array) -> Array:
        """Compute the wrench (n, 6) at the TCP that holds and moves the hand, in world axes.

        Newton and Euler for a rigid body: f = m (a - g), and r x f + I alpha + w x I w about the TCP.
        """
        rate, gained = twist[:, 3:], acceleration[:, 3:]
        arms = turns @ self._centre
        inertia = turns @ self._inertia @ turns.transpose(0, 2, 1)
        moved = acceleration[:, :3] + np.cross(gained, arms) + np.cross(rate, np.cross(rate, arms))
        force = self._mass * (moved - self._gravity)
        spin = np.einsum("nij,nj->ni", inertia, rate)
        moment = np.cross(arms, force) + np.einsum("nij,nj->ni", inertia, gained)
        return np.concatenate([force, moment + np.cross(rate, spin)], axis=1)
