"""Actuators of the simulated arm: impedance control as MuJoCo actuators, and the parallel hand."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from palpate.common.pose import Array
from palpate.robots.description import PREFIX, RobotDescription
from palpate.robots.sheet import EMPTY, ParallelHand
from palpate.robots.springs import SpringGains, Swivel

ORIGIN = PREFIX + "origin"
AXES = tuple(f"{PREFIX}cartesian_{axis}" for axis in "xyz")
ORIENTATION = PREFIX + "orientation"
DRIVE_OF = PREFIX + "drive{}"  # of a joint, counted from 1
NULL_SPACE = PREFIX + "null_space"


def add_actuators(world: mujoco.MjSpec, arm: RobotDescription) -> None:
    """Add the controller's actuators to a world that the robot is attached to.

    They inherit the arm's own defaults, and none of the scene's.
    """
    # Three actuators pull the TCP along the world's axes, one turns it.
    own = world.find_default(PREFIX + "main")
    world.worldbody.add_site(own, name=ORIGIN, group=4)
    site, tcp = mujoco.mjtTrn.mjTRN_SITE, PREFIX + arm.tcp
    for i, name in enumerate(AXES):
        axis = world.add_actuator(own, name=name, trntype=site, target=tcp, refsite=ORIGIN)
        axis.gear = np.eye(6)[i]
        axis.set_to_position(kp=1.0, kv=1.0)
    turn = world.add_actuator(own, name=ORIENTATION, trntype=site, target=tcp, refsite=ORIGIN)
    turn.set_to_orientation(kp=1.0, kv=1.0, ctrlspec=mujoco.mjtCtrlChart.mjCHART_QUAT)
    # A drive per joint acts as a spring or as a torque input.
    for i, joint in enumerate(arm.joints, 1):
        drive = world.add_actuator(
            own, name=DRIVE_OF.format(i), trntype=mujoco.mjtTrn.mjTRN_JOINT, target=PREFIX + joint
        )
        drive.set_to_position(kp=1.0, kv=1.0)
        world.joint(PREFIX + joint).actgravcomp = True
    # A tendon of length n^T q, where n is the null space's axis in the present run of cycles.
    tendon = world.add_tendon(own, name=NULL_SPACE)
    for joint in arm.joints:
        tendon.wrap_joint(PREFIX + joint, 1.0)
    swivel = world.add_actuator(
        own, name=NULL_SPACE, trntype=mujoco.mjtTrn.mjTRN_TENDON, target=NULL_SPACE
    )
    swivel.set_to_position(kp=1.0, kv=1.0)


class Actuators:
    """The controller's actuators in a model, and the setting of their gains.

    Attributes:
        position, orientation, drives, swivel: indices into `ctrl`.
    """

    def __init__(self, model: mujoco.MjModel, joints: int) -> None:
        self._gain, self._bias = model.actuator_gainprm, model.actuator_biasprm
        self._axes = [model.actuator(name).id for name in AXES]
        self._turn = model.actuator(ORIENTATION).id
        self._drives = [model.actuator(DRIVE_OF.format(i)).id for i in range(1, joints + 1)]
        first = model.actuator_ctrladr
        place, turn, drive = (int(first[i]) for i in (self._axes[0], self._turn, self._drives[0]))
        self.position, self.orientation = slice(place, place + 3), slice(turn, turn + 4)
        self.drives = slice(drive, drive + joints)
        self._swivel = model.actuator(NULL_SPACE).id
        self.swivel = int(first[self._swivel])
        wraps = int(model.tendon_adr[model.tendon(NULL_SPACE).id])
        self._axis = model.wrap_prm[wraps : wraps + joints]

    def set(self, gains: SpringGains) -> None:
        """Activate only these springs. The joint drives are torque inputs where the joints' springs are off."""
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


# Parallel hand: a servo of limited force, and its encoders.


DRIVE = "fingers"
LAG = 0.015  # s: lag of the fingers behind their set-point
STANDSTILL = 0.001  # m/s: slower fingers count as at rest
STANDING = 0.1  # s at rest before the fingers count as stopped
# m: radius of a finger's edges: 1.5 times the indentation by an object held at one edge of a pad.
ROUNDING = 0.0015


def add_drive(robot: mujoco.MjSpec, hand: ParallelHand) -> None:
    """Couple the two fingers into one mechanism, with one drive that pushes each with half its force.

    Its control is each finger's distance from the middle, m. Its damping limits the speed of the fingers at full
    force to their speed limit. So it follows an object that yields, without an impact.
    """
    # One tendon averages the two fingers; an equality keeps them symmetric.
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

    A box that is smaller by the radius, with a margin of the radius, is the Minkowski sum with a ball.
    Contacts then stay within the margin, which avoids a defect of the collision detection. Where an edge enters
    a cylinder, normals are off by up to 90 degrees (MuJoCo 4.0.0 with several contacts a pair, fixed by its
    commit bbb71a28). A can between the edges of the pads would be squeezed out against all friction.
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
        """Test if the hand is closed on an object."""
        return self._goal == self._closed and not self.moving and self.width > EMPTY

    def open(self, t: float, width: float | None = None) -> None:
        """Start opening to `width` m, or fully."""
        half = self._open if width is None else min(0.5 * width, self._open)
        self._start(t, half, self._strongest)

    def close(self, t: float, force: float | None = None) -> None:
        """Start closing with `force` N, by default the full force, until something resists."""
        self._start(t, self._closed, self._strongest if force is None else force)

    def setpoints(self, t: Array) -> Array | float:
        """Compute each finger's commanded distance from the middle, m, at times `t` (n,), until the next observation
        of the fingers.
        """
        # A ramp at the fingers' speed from the last observation to the goal.
        duration = abs(self._goal - self._from) / self._speed
        if t[0] - self._since > duration:
            return self._goal
        way = self._speed * (t - self._since)
        if self._goal > self._from:
            return np.minimum(self._from + way, self._goal)
        return np.maximum(self._from - way, self._goal)

    def observe(self, t: float, fingers: Sequence[float], speeds: Sequence[float]) -> None:
        """Update the state from the fingers' distances from the middle, m, and their speeds, m/s.

        Fingers that touch each other count as closed, although the end stops yield under the drive. The set-point
        leads the fingers by no more than the full force needs, so that they do not jump when an obstacle yields.
        """
        self.width = max(0.0, sum(fingers))
        # Limit the lead of the set-point over the fingers.
        middle, speed = sum(fingers) / 2, max(map(abs, speeds))
        commanded = float(np.max(self.setpoints(np.array([t]))))
        lead = LAG * (self.force / self._damping + speed)  # m, at this speed and full force
        pressed = commanded == self._goal or commanded < middle - lead
        self._from, self._since = min(max(commanded, middle - lead), middle + lead), t
        # A command ends once the fingers have rested for a time, at the goal or pressed.
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
