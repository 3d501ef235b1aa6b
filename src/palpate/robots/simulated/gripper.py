"""The parallel hand: a servo of limited force, and its encoders."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.sheet import ParallelHand

DRIVE = "fingers"
LAG = 0.015  # s that the fingers are behind their set-point
STANDSTILL = 0.001  # m/s: slower fingers stand still
STANDING = 0.1  # s of standstill before they count as stopped
NOTHING = 0.002  # m: an opening below this is an empty hand
ROUNDING = 0.0015
"""m: radius of a finger's edges: 1.5 times the indentation by an object held at one edge of a pad."""


def add_drive(robot: mujoco.MjSpec, hand: ParallelHand) -> None:
    """Couple the two fingers into one mechanism, with one drive that pushes each with half its force.

    Its control is each finger's distance from the middle, m. It is damped so that its full force
    moves the fingers no faster than their speed limit: it follows an object that yields, without an
    impact.
    """
    tendon = robot.add_tendon(name=DRIVE)
    for finger in hand.fingers:
        tendon.wrap_joint(finger, 0.5)
    mirrored = robot.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT, name1=hand.fingers[0], name2=hand.fingers[1]
    )
    mirrored.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
    mirrored.solref[:2], mirrored.solimp[:3] = (0.004, 1.0), (0.98, 0.999, 0.0005)
    drive = robot.add_actuator(
        name=DRIVE,
        trntype=mujoco.mjtTrn.mjTRN_TENDON,
        target=DRIVE,
        ctrlrange=(-0.01, hand.opening / 2),
        forcerange=(-hand.force, hand.force),
    )
    damping = hand.force / hand.speed  # N s/m, of both fingers together
    drive.set_to_position(kp=damping / LAG, kv=damping)


def round_fingers(robot: mujoco.MjSpec, hand: ParallelHand) -> None:
    """Round the edges of the fingers' colliding boxes, within the same outlines.

    A box that is smaller by the radius, with the radius as its margin, is the Minkowski sum with a
    ball. Contacts stay within the margin, and so out of a defect of the collision detection: where
    an edge enters a cylinder, normals are off by up to 90 degrees (MuJoCo 4.0.0 with several contacts
    a pair, mended by its commit bbb71a28), and a can between the edges of the pads would be squeezed
    out against all friction.
    """
    for finger in hand.fingers:
        for geom in robot.joint(finger).parent.geoms:
            if geom.type == mujoco.mjtGeom.mjGEOM_BOX and geom.contype:
                radius = min(ROUNDING, float(geom.size.min()) / 2)
                geom.size -= radius
                geom.margin += radius


class Gripper:
    """Set-points for the fingers, and their state. Times are robot time, s.

    Attributes:
        force: N, limit of the drive.
        width: m between the fingers.
        moving: True while a command is executed.
    """

    def __init__(self, hand: ParallelHand) -> None:
        self._open, self._closed, self._speed = hand.opening / 2, -hand.overclose, hand.speed
        self._strongest = self.force = hand.force
        self._damping = hand.force / hand.speed
        self.width = 2 * self._open
        self.moving = False
        self._goal = self._from = self._open
        self._since = self._last_moved = 0.0

    @property
    def gripping(self) -> bool:
        """True if closed, and stopped by an object."""
        return self._goal == self._closed and not self.moving and self.width > NOTHING

    def open(self, t: float) -> None:
        """Start opening fully."""
        self._start(t, self._open, self._strongest)

    def close(self, t: float, force: float | None = None) -> None:
        """Start closing with `force` N, by default the full force, until something resists."""
        self._start(t, self._closed, self._strongest if force is None else force)

    def setpoints(self, t: Array) -> Array | float:
        """Compute each finger's commanded distance from the middle, m, at times `t` (n,), until the
        next observation of the fingers."""
        duration = abs(self._goal - self._from) / self._speed
        if t[0] - self._since > duration:
            return self._goal
        way = self._speed * (t - self._since)
        if self._goal > self._from:
            return np.minimum(self._from + way, self._goal)
        return np.maximum(self._from - way, self._goal)

    def observe(self, t: float, fingers: Sequence[float], speeds: Sequence[float]) -> None:
        """Update the state from the fingers' distances from the middle, m, and their speeds, m/s.

        Fingers that touch are closed, however much the end stops yield under the drive. The set-point
        leads the fingers by no more than the full force needs: they do not jump when an obstacle
        yields at last.
        """
        self.width = max(0.0, sum(fingers))
        middle, speed = sum(fingers) / 2, max(map(abs, speeds))
        commanded = float(np.max(self.setpoints(np.array([t]))))
        lead = LAG * (self.force / self._damping + speed)  # m, at this speed and full force
        pressed = commanded == self._goal or commanded < middle - lead
        self._from, self._since = min(max(commanded, middle - lead), middle + lead), t
        if not self.moving:
            return
        if speed > STANDSTILL or not pressed:
            self._last_moved = t
        self.moving = t - self._last_moved < STANDING

    def _start(self, t: float, goal: float, force: float) -> None:
        self._from = float(np.max(self.setpoints(np.array([t]))))
        self._since = self._last_moved = t
        self.force = min(force, self._strongest)
        self._goal, self.moving = goal, True
