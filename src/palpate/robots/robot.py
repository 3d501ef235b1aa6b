"""The one narrow protocol every robot speaks, simulated or real.

State is cached and reading it never blocks; motions are started, never awaited; the behavior tree
polls `state.moving`. Time is the robot's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import Limits
from palpate.robots.reflex import Reflex
from palpate.robots.trajectory.straight import Stretch
from palpate.trace.recording import Hand
from palpate.trace.samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """The latest cached state.

    Attributes:
        t: robot time now, s.
        stamp: robot time of the newest sensor sample, s.
        q, dq: (7,) rad, rad/s.
        tau: (7,) N m, measured behind the gears.
        tau_ext: (7,) N m, its part from outside.
        pose_world_tcp: measured TCP pose.
        target_world_tcp: commanded equilibrium pose.
        twist: (6,) TCP velocity, world axes.
        wrench: (6,) external wrench, the convention of `palpate.trace`.
        contact: (6,) the same with the arm's own inertia taken out: what a contact, or a load, and
            not the arm's acceleration, exerts. Every threshold looks at this one.
        reflex: why the arm stopped itself since the last motion was started; None if it did not.
        width: m between the fingers.
        gripping: fingers stopped on something before closing fully.
        fault: why what the sensors say cannot be believed (`palpate.robots.sense`), or why the arm
            does not move any more, whatever it is told; None while all is well.
        mode: what a real arm's controller says it is in; empty where there is no such thing.
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
    contact: Array
    width: float
    gripping: bool
    moving: bool
    gripper_moving: bool
    reflex: str | None = None
    fault: str | None = None
    mode: str = ""


class Robot(Protocol):
    """A 7-axis arm with a parallel hand and joint torque sensing.

    Its life: it is made connected, at rest and logging; then motions and `advance` alternate, once
    a tick; `close` ends it. Between two calls of `advance` nothing that is read changes. Every
    motion may be started while another is under way, and goes on from its position and velocity
    without a jerk. No method but `advance` takes robot time.
    """

    @property
    def limits(self) -> Limits:
        """Safety limits from the description; they never change."""
        ...

    @property
    def hand(self) -> Hand:
        """Data of the nominal arm for the estimators; part of every trace."""
        ...

    @property
    def gravity(self) -> float:
        """m/s^2, magnitude, along world -z, where the arm stands."""
        ...

    @property
    def state(self) -> RobotState:
        """State as of the last `advance`; reading it never blocks. A lost connection shows in its
        `stamp`, which grows old."""
        ...

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """Start a motion with bounded jerk to joint positions `q` (7,), rad.

        `speed` in (0, 1] scales the description's pace. `state.moving` until it has ended.
        """
        ...

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        """Start a straight motion with bounded jerk of the commanded TCP pose to `target` (world),
        at most `speed` m/s, and no faster than its effective mass allows (`robots.pace`); `slower`
        says how fast one part after the other of the way may be gone, up to its end, m/s.

        The arm follows like a spring: what is in its way bears a force, and it may end beside the
        target. `state.moving` until the command has ended.
        """
        ...

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        """Move the TCP straight as `move_pose`, along unit `direction` (3,) (world) at `speed` m/s for `travel` m, with
        the orientation kept."""
        ...

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        """Start turning the commanded pose of the TCP to and fro about itself: a sine of `angle`
        rad and `frequency` Hz about the unit axis `about` (3,) of the tool, for `cycles` periods,
        between one in which it grows and one in which it fades. It begins at rest and ends where it
        began. `state.moving` until then.
        """
        ...

    def open_gripper(self) -> None:
        """Start opening the fingers fully. `state.gripper_moving` until they have stopped."""
        ...

    def close_gripper(self, force: float | None = None) -> None:
        """Start closing the fingers with at most `force` N of both together, the description's
        grasp force by default, until they meet resistance (then `state.gripping`) or each other.
        `state.gripper_moving` until they have stopped. Closed ones are told so to press more."""
        ...

    def hold(self) -> None:
        """Stop the arm smoothly and hold it there; a contact keeps the force that it has, and the
        fingers their grasp. Without effect at rest."""
        ...

    def set_reflex(self, thresholds: Reflex) -> None:
        """From now on the arm stops itself, within 1 ms, when it feels more than `thresholds`
        allow; `limits.reflexes` has those for free air, carrying, probing and contact. Those for
        contact, the widest, hold until the first call.

        After a reflex the arm yields: its equilibrium follows where it stands, so that nothing is
        pressed any more, `state.moving` ends, and `state.reflex` says why. The fingers keep their
        grasp. The next motion clears it.

        On a Franka this is `setCollisionBehavior`, and `automaticErrorRecovery` before the next
        motion; a KUKA has force conditions that break a motion.
        """
        ...

    def advance(self, duration: float) -> None:
        """Let `duration` s of robot time pass, and take in what was sensed: simulated robots step,
        real ones sleep until the time has come.

        Raises:
            ExecutionAborted: the robot cannot go on; nothing is commanded any more.
        """
        ...

    def drain(self) -> Samples:
        """The samples logged since the last call, in order of time; after `close` the last ones."""
        ...

    def close(self) -> None:
        """Stop, and let go of the connection. May be called twice, and at any time."""
        ...


@runtime_checkable
class Recoverable(Protocol):
    """A robot, or its workplace, that stays as it is once something stopped it."""

    def recover(self) -> None:
        """A person has seen what stopped it, and lets it go on.

        Raises:
            Unavailable: it cannot go on all the same; the message says what to do.
        """
        ...


@runtime_checkable
class Remembering(Protocol):
    """A robot that knows more of its last seconds than its samples say."""

    def black_box(self) -> Mapping[str, Array] | None:
        """Return the control loop's inputs and outputs of the last seconds before it was stopped, by name, one
        row a cycle; None where nothing stopped it."""
        ...
