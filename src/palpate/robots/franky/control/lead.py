"""Commands as courses: each goes on from where the present one leads."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.commanded import (
    ahead_of,
    joint_path,
    pose_path,
    stopped_joints,
    stopped_pose,
    swing_path,
)
from palpate.robots.description import RobotDescription
from palpate.robots.franky.control.course import Course, joint_course, pose_course
from palpate.robots.franky.control.drive import Drive
from palpate.robots.franky.readout import Readout
from palpate.robots.nominal import NominalArm
from palpate.robots.simulated.impedance import Inertia
from palpate.robots.trajectory.path import Motion, Path
from palpate.robots.trajectory.posed import PosePath
from palpate.robots.trajectory.straight import Stretch

Maker = Callable[[Course | None, float], Course]
"""Makes a course of the present one and of how far, s, it has come."""


class Lead:
    """Makes the courses of one arm, whatever springs hold it when they begin."""

    def __init__(
        self, arm: RobotDescription, nominal: NominalArm, base: Pose, readout: Readout, drive: Drive
    ) -> None:
        self._arm, self._nominal, self._base = arm, nominal, base
        self._readout, self._drive = readout, drive

    def to_joints(self, goal: Array, speed: float) -> Maker:
        """See `Robot.move_joints`."""

        def course(before: Course | None, clock: float) -> Course:
            now = self._joint_motion(before, clock)
            path = joint_path(self._nominal, self._arm, 0.0, now, goal, speed)
            return joint_course(path, self._nominal)

        return course

    def to_pose(self, target: Pose, speed: float, slower: Sequence[Stretch]) -> Maker:
        """See `Robot.move_pose`."""

        def course(before: Course | None, clock: float) -> Course:
            begin, q = self._pose_motion(before, clock), self._readout.q
            path, posture = pose_path(
                self._nominal, self._arm, 0.0, begin, target, speed, slower, q
            )
            return pose_course(path, posture.sample(posture.knots[-1:])[0], self._base)

        return course

    def swinging(self, about: Array, angle: float, frequency: float, cycles: int) -> Maker:
        """See `Robot.swing`."""

        def course(before: Course | None, clock: float) -> Course:
            begin = self._pose_motion(before, clock)
            path = swing_path(0.0, begin, about, angle, frequency, cycles)
            return pose_course(path, self._posture(before), self._base)

        return course

    def stopping(self) -> Maker:
        """See `Robot.hold`, of an arm that moves."""

        def course(before: Course | None, clock: float) -> Course:
            assert before is not None
            if isinstance(before.path, Path):
                path = stopped_joints(self._arm, 0.0, before.path.at(clock))
                return joint_course(path, self._nominal)
            stopping = stopped_pose(self._arm, 0.0, self._pose_motion(before, clock))
            return pose_course(stopping, self._posture(before), self._base)

        return course

    def begin(self) -> tuple[Motion, Array]:
        """Return the start of a Cartesian motion now."""
        return self._pose_motion(self._drive.course, self._drive.clock)

    def inertia(self) -> Inertia:
        """Inertia that the springs act on."""
        q = self._readout.q
        return Inertia.of(self._nominal.mass_matrix(q), self._readout.jacobian)

    def _joint_motion(self, before: Course | None, clock: float) -> Motion:
        """Return the start of a joint motion: on the present one, or where the joints' springs pull as the
        TCP's do now."""
        if before is not None and isinstance(before.path, Path):
            return before.path.at(clock)
        readout = self._readout
        rate = readout.dq if self._drive.moving else np.zeros(7)
        leading = readout.q + self._sprung(before) / self._arm.stiffness.joints
        return Motion(leading, rate, np.zeros(7))

    def _pose_motion(self, before: Course | None, clock: float) -> tuple[Motion, Array]:
        """Return the start of a Cartesian motion: on the present one, or where the TCP's springs pull as
        the joints' do now."""
        if before is not None and isinstance(before.path, PosePath):
            return before.path.motion(clock), before.path.pose(clock).quaternion
        readout = self._readout
        twist = readout.twist if self._drive.moving else np.zeros(6)
        springs, torque = self._arm.stiffness, self._sprung(before)
        return ahead_of(readout.pose_world_tcp, readout.jacobian, torque, springs, twist)

    def _sprung(self, before: Course | None) -> Array:
        """(7,) N m that the springs exert at the joints now."""
        return self._readout.commanded if before is not None else np.zeros(7)

    def _posture(self, before: Course | None) -> Array:
        return self._readout.q if before is None or before.posture is None else before.posture
