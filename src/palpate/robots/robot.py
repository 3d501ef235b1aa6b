"""The one narrow protocol every robot speaks, simulated or real.

State is cached and reading it never blocks; motions are started, never awaited; the behavior tree
polls `state.moving`. Time is the robot's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import Limits
from palpate.trace.recording import Hand
from palpate.trace.samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """The latest cached state.

    Attributes:
        t: robot time now, s. stamp: robot time of the newest sensor sample, s.
        q, dq: (7,) rad, rad/s.
        tau: (7,) N m, measured behind the gears. tau_ext: (7,) N m, its part from outside.
        pose_world_tcp: measured TCP pose. target_world_tcp: commanded equilibrium pose.
        twist: (6,) TCP velocity, world axes.
        wrench: (6,) external wrench, the convention of `palpate.trace`.
        width: m between the fingers. gripping: fingers stopped on something before closing fully.
        moving: the arm's commanded motion is still under way.
        gripper_moving: the fingers are still under way.
    """

    t: float
    stamp: float
    q: Array
    dq: Array
    tau: Array
    tau_ext: Array
    pose_world_tcp: Pose
    target_world_tcp: Pose
    twist: Array
    wrench: Array
    width: float
    gripping: bool
    moving: bool
    gripper_moving: bool


class Robot(Protocol):
    """A 7-axis arm with a parallel hand and joint torque sensing."""

    @property
    def limits(self) -> Limits: ...
    @property
    def hand(self) -> Hand: ...
    @property
    def gravity(self) -> float:
        """m/s^2, magnitude, along world -z."""
        ...

    @property
    def state(self) -> RobotState:
        """The latest cached state; never blocks."""
        ...

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """Start a smooth (bounded jerk) motion to joint positions `q` (7,). Replaces any motion
        under way.

        `speed` scales the default speed, in (0, 1].
        """
        ...

    def move_pose(self, target: Pose, speed: float) -> None:
        """Start a smooth straight motion of the commanded TCP pose to `target` (world) at most
        `speed` m/s."""
        ...

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        """Start a straight motion along unit `direction` (3,) (world) at `speed` m/s for `travel`
        m."""
        ...

    def open_gripper(self) -> None:
        """Start opening the fingers fully."""
        ...

    def close_gripper(self) -> None:
        """Start closing the fingers with the default grasp force until they meet resistance or each
        other."""
        ...

    def hold(self) -> None:
        """Stop the arm smoothly where it is and hold there; the fingers keep their grasp."""
        ...

    def advance(self, duration: float) -> None:
        """Let robot time pass: simulated robots step, real ones sleep until the time has come."""
        ...

    def drain(self) -> Samples:
        """The samples logged since the last call."""
        ...

    def close(self) -> None:
        """Stop and let go of the connection. May be called twice."""
        ...
