"""The true arm: the nominal model with an individual robot's deviations.

The deviations are drawn once per robot. The encoders, and all quantities computed from them, use the
nominal arm.
"""

from __future__ import annotations

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.description import RobotDescription, pads_end
from palpate.robots.simulated.noise.model import ModelErrors, Streams
from palpate.robots.trajectory import rotate_quaternion

SHARE = 0.3  # of a body's mass that may be moved to shift its centre of mass


class TrueArm:
    """Deviations of an individual robot from the nominal model, applied to a world."""

    def __init__(self, model: ModelErrors, streams: Streams) -> None:
        self._model, self._streams = model, streams
        geometry = (model.base_tilt, model.base_position, model.base_yaw, model.joint_offset)
        # True if the TCP may differ from the reported one, or the compensated weight may differ
        # from the controller's model.
        self.askew = any(drawn.any for drawn in (*geometry, model.link_length, model.gravity))

    def base(self, pose_world_base: Pose) -> Pose:
        """Return the true pose of a base whose stated pose is `pose_world_base`."""
        model, streams = self._model, self._streams
        shift = model.base_position.draw(streams("model.base_position"))
        tilt = model.base_tilt.draw(streams("model.base_tilt"))
        turn = np.array([*tilt, model.base_yaw.number(streams("model.base_yaw"))])
        if not (shift.any() or turn.any()):
            return pose_world_base
        quaternion = rotate_quaternion(pose_world_base.quaternion, turn[None])[0]
        return Pose(pose_world_base.position + shift, quaternion)

    def gravity(self, assumed: Array) -> Array:
        """Return the true gravity (3,), m/s^2, for the stated gravity `assumed` (3,)."""
        more = self._model.gravity.number(self._streams("model.gravity"))
        size = float(np.linalg.norm(assumed))
        return assumed * (1.0 + more / size) if size else assumed

    def build(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """Change the nominal model into the true one. Gravity compensation stays that of the nominal
        model.
        """
        self._set_geometry(robot, arm)
        self._set_masses(robot, arm)
        self._set_fingertips(robot, arm)

    def width(self) -> float:
        """Return the reported less the true opening of the fingers, m."""
        return self._model.finger_width.number(self._streams("model.finger_width"))

    def _set_geometry(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """Set the encoders' zeros and the links' lengths."""
        offsets = self._model.joint_offset.draw(self._streams("model.joint_offset"))
        lengths = self._model.link_length.draw(self._streams("model.link_length"))
        for name, offset, longer in zip(arm.joints, offsets, lengths, strict=True):
            joint = robot.joint(name)
            joint.ref -= offset  # an angle reads `ref` in the model's reference pose
            # A longer link moves its body along the link, or along the joint's axis where the link has no
            # length.
            body = joint.parent
            position = np.array(body.pos)
            length = float(np.linalg.norm(position))
            along = position / length if length else np.array(joint.axis)
            body.pos = position + longer * along

    def _set_masses(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """Set the true masses and centres of links and hand."""
        for body in robot.bodies:
            if body.name != "world":
                body.gravcomp = 1.0
        # Split links whose mass or centre differs; the sum is the true link.
        model, streams = self._model, self._streams
        masses = model.link_mass.draw(streams("model.link_mass"))
        shifts = model.link_com.draw(streams("model.link_com"))
        links = [robot.joint(name).parent for name in arm.joints]
        if model.link_mass.any or model.link_com.any:
            for body, more, shift in zip(links, masses, shifts, strict=True):
                split_body(body, more * body.mass, shift)
        if model.hand_mass.any or model.hand_com.any:
            more = model.hand_mass.number(streams("model.hand_mass"))
            shift = model.hand_com.draw(streams("model.hand_com"))
            split_body(robot.body(arm.hand.body), more, shift)

    def _set_fingertips(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """Shift the fingertips to their true place, relative to the place that the arm's owner knows."""
        model = robot.compile()
        along = self._model.tip_offset.number(self._streams("model.tip_offset"))
        lateral = self._model.tip_lateral.draw(self._streams("model.tip_lateral"))
        shift = np.array([*lateral, arm.tip - pads_end(model, arm.hand) + along])
        if not shift.any():
            return
        # The shift is in the hand's frame: turn it into the frame of each finger.
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        in_world = data.body(arm.hand.body).xmat.reshape(3, 3) @ shift
        for name in arm.hand.fingers:
            finger = robot.joint(name).parent
            in_finger = data.body(finger.name).xmat.reshape(3, 3).T @ in_world
            for geom in finger.geoms:
                if np.isfinite(geom.fromto[0]):  # a capsule given by its ends
                    geom.fromto = np.array(geom.fromto) + np.tile(in_finger, 2)
                else:
                    geom.pos = np.array(geom.pos) + in_finger


def split_body(body: mujoco.MjsBody, more: float, shift: Array) -> None:
    """Split a link to give it its true mass and centre, and keep its gravity compensation.

    MuJoCo's `gravcomp` acts at a body's own centre with its own mass. So one part stays at the nominal
    centre, with the compensation of the whole nominal link. An uncompensated part makes up the difference:
    `more` kg, and the `shift` (3,), m, of the centre.
    """
    nominal, centre = body.mass, np.array(body.ipos)
    # Mass and centre of the second part, so that both together have the true mass and centre.
    mass = nominal + more
    rest = max(mass - (1.0 - SHARE) * nominal, 1e-3 * nominal)
    other = body.add_body(
        name=f"{body.name}_rest",
        mass=rest,
        ipos=centre + shift * mass / rest,
        explicitinertial=True,
    )
    body.mass, body.gravcomp = (1.0 - SHARE) * nominal, 1 / (1 - SHARE)
    if np.isnan(body.fullinertia[0]):  # a file states principal moments or all six components
        other.iquat, other.inertia = body.iquat, SHARE * body.inertia
        body.inertia = (1.0 - SHARE) * body.inertia
    else:
        other.fullinertia = SHARE * body.fullinertia
        body.fullinertia = (1.0 - SHARE) * body.fullinertia
