"""The true arm: its nominal model changed by what a robot of this noise model is.

All of it is drawn once a robot; the encoders, and everything that is computed of them, know the
nominal arm only.
"""

from __future__ import annotations

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import RobotDescription, pads_end
from palpate.robots.simulated.noise.model import Model
from palpate.robots.simulated.noise.values import Streams
from palpate.robots.trajectory.posed import turned

SHARE = 0.3
"""Share of a body's mass that `_split` may move to put its centre elsewhere."""


class Truth:
    """Deviations of an individual robot from the nominal model, applied to a world.

    Attributes:
        askew: whether the TCP may be elsewhere than the encoders say, or another weight be held up
            than the controller's model has.
    """

    def __init__(self, model: Model, streams: Streams) -> None:
        self._model, self._streams = model, streams
        geometry = (model.base_tilt, model.base_position, model.base_yaw, model.joint_offset)
        self.askew = any(drawn.any for drawn in (*geometry, model.link_length, model.gravity))

    def base(self, pose_world_base: Pose) -> Pose:
        """True pose of the base."""
        model, streams = self._model, self._streams
        away = model.base_position.draw(streams("model.base_position"))
        tilt = model.base_tilt.draw(streams("model.base_tilt"))
        turn = np.array([*tilt, model.base_yaw.number(streams("model.base_yaw"))])
        if not (away.any() or turn.any()):
            return pose_world_base
        quaternion = turned(pose_world_base.quaternion, turn[None])[0]
        return Pose(pose_world_base.position + away, quaternion)

    def gravity(self, assumed: Array) -> Array:
        """(3,) m/s^2, of which `assumed` (3,) is thought."""
        more = self._model.gravity.number(self._streams("model.gravity"))
        size = float(np.linalg.norm(assumed))
        return assumed * (1.0 + more / size) if size else assumed

    def build(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """Make of the nominal arm's model the true one, still held up as the nominal one is."""
        self._bend(robot, arm)
        self._load(robot, arm)
        self._wear(robot, arm)

    def width(self) -> float:
        """m that the reported opening of the fingers is more than the true one."""
        return self._model.finger_width.number(self._streams("model.finger_width"))

    def _bend(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """Encoders' zeros and links' lengths."""
        offsets = self._model.joint_offset.draw(self._streams("model.joint_offset"))
        lengths = self._model.link_length.draw(self._streams("model.link_length"))
        for name, offset, longer in zip(arm.joints, offsets, lengths, strict=True):
            joint = robot.joint(name)
            joint.ref -= offset  # an angle reads `ref` in the model's reference pose
            body = joint.parent
            way = np.array(body.pos)
            size = float(np.linalg.norm(way))
            along = way / size if size else np.array(joint.axis)
            body.pos = way + longer * along

    def _load(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """True masses and centres.

        MuJoCo's `gravcomp` acts at a body's own centre with its own mass. So each link is split: a
        part at the nominal centre, whose compensation is that of the whole nominal link, and an
        uncompensated part that makes up the rest.
        """
        for body in robot.bodies:
            if body.name != "world":
                body.gravcomp = 1.0
        model, streams = self._model, self._streams
        masses = model.link_mass.draw(streams("model.link_mass"))
        shifts = model.link_com.draw(streams("model.link_com"))
        links = [robot.joint(name).parent for name in arm.joints]
        if model.link_mass.any or model.link_com.any:
            for body, more, shift in zip(links, masses, shifts, strict=True):
                _split(body, more * body.mass, shift)
        if model.hand_mass.any or model.hand_com.any:
            more = model.hand_mass.number(streams("model.hand_mass"))
            _split(robot.body(arm.hand.body), more, model.hand_com.draw(streams("model.hand_com")))

    def _wear(self, robot: mujoco.MjSpec, arm: RobotDescription) -> None:
        """Put the fingertips where they really are, about where the arm's owner is told."""
        model = robot.compile()
        along = self._model.tip_offset.number(self._streams("model.tip_offset"))
        aside = self._model.tip_lateral.draw(self._streams("model.tip_lateral"))
        shift = np.array([*aside, arm.tip - pads_end(model, arm.hand) + along])
        if not shift.any():
            return
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        in_world = data.body(arm.hand.body).xmat.reshape(3, 3) @ shift
        for name in arm.hand.fingers:
            finger = robot.joint(name).parent
            in_finger = data.body(finger.name).xmat.reshape(3, 3).T @ in_world
            for geom in finger.geoms:
                _move(geom, in_finger)


def _move(geom: mujoco.MjsGeom, way: Array) -> None:
    """Shift a shape by `way` (3,) m in its body; capsules may be given by their ends."""
    if np.isfinite(geom.fromto[0]):
        geom.fromto = np.array(geom.fromto) + np.tile(way, 2)
    else:
        geom.pos = np.array(geom.pos) + way


def _split(body: mujoco.MjsBody, more: float, shift: Array) -> None:
    """A compensated part at the nominal centre, and one that makes up the true mass and centre.

    Args:
        more: kg beyond the nominal mass.
        shift: (3,) m of the true centre from the nominal one.
    """
    nominal, centre = body.mass, np.array(body.ipos)
    mass = nominal + more
    rest = max(mass - (1.0 - SHARE) * nominal, 1e-3 * nominal)
    other = body.add_body(
        name=f"{body.name}_rest",
        mass=rest,
        ipos=centre + shift * mass / rest,
        explicitinertial=True,
    )
    body.mass, body.gravcomp = (1.0 - SHARE) * nominal, 1 / (1 - SHARE)
    if np.isnan(body.fullinertia[0]):  # a file gives principal moments or all six
        other.iquat, other.inertia = body.iquat, SHARE * body.inertia
        body.inertia = (1.0 - SHARE) * body.inertia
    else:
        other.fullinertia = SHARE * body.fullinertia
        body.fullinertia = (1.0 - SHARE) * body.fullinertia
