"""The protocol of every robot, simulated or real.

State is cached and reading it never blocks; motions are started, never awaited; the behavior tree
polls `state.moving`. Time is the robot's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import Limits
from palpate.robots.reflex import Reflex
from palpate.robots.trajectory import Stretch
from palpate.trace.recording import Hand
from palpate.trace.samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """The latest cached state."""

    t: float  # robot time now, s
    stamp: float  # robot time of the newest sensor sample, s
    q: Array  # (7,) rad
    dq: Array  # (7,) rad/s
    tau: Array  # (7,) N m, measured behind the gears
    tau_ext: Array  # (7,) N m, its external part
    pose_world_tcp: Pose  # measured
    target_world_tcp: Pose  # commanded equilibrium
    twist: Array  # (6,) TCP velocity, world axes
    wrench: Array  # (6,) external wrench, the convention of `palpate.trace`
    # (6,) the same without the arm's inertia: the wrench of a contact or a load, not of the arm's
    # acceleration. All thresholds apply to it.
    contact: Array
    width: float  # m between the fingers
    gripping: bool  # the fingers stopped on an object before closing fully
    moving: bool  # the arm's commanded motion has not ended
    gripper_moving: bool  # the fingers have not stopped
    reflex: str | None = None  # reason of a reflex since the last motion was started
    # Reason that the sensors cannot be trusted (`palpate.robots.sense`), or that the arm does not
    # move any more whatever is commanded.
    fault: str | None = None
    mode: str = ""  # of a real arm's controller
    # N m, norm of the joint torques of a contact or a load that no force at the TCP explains, and N, that
    # force (`palpate.robots.nominal.unexplained`).
    unexplained: tuple[float, float] = (0.0, 0.0)


class Robot(Protocol):
    """A 7-axis arm with a parallel hand and joint torque sensing.

    Lifecycle: it is constructed connected, at rest and logging; then motions and `advance`
    alternate, once a tick; `close` ends it. Between two calls of `advance` no property changes.
    Every motion may be started during another, and continues from its position and velocity without
    a jerk. Only `advance` takes robot time.
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
        """m/s^2, magnitude, along world -z, at the arm's place."""
        ...

    @property
    def state(self) -> RobotState:
        """State as of the last `advance`; reading it never blocks. After a lost connection its
        `stamp` grows old."""
        ...

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """Start a motion with bounded jerk to joint positions `q` (7,), rad.

        `speed` in (0, 1] scales the description's pace. `state.moving` until its end.
        """
        ...

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        """Start a straight motion with bounded jerk of the commanded TCP pose to `target` (world),
        at most `speed` m/s, and no faster than its effective mass allows (`robots.pace`); `slower`
        lists lower limits, m/s, of consecutive parts of the motion.

        The arm follows like a spring: it presses on an obstacle, and may end beside the target.
        `state.moving` until the command has ended.
        """
        ...

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        """Move the TCP straight as `move_pose`, along unit `direction` (3,) (world) at `speed` m/s
        for `travel` m, with the orientation kept."""
        ...

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        """Start swinging the commanded pose about the TCP: a sine of `angle` rad and `frequency` Hz
        about the unit axis `about` (3,) of the tool, for `cycles` periods, between one in which it
        grows and one in which it fades. It begins at rest and ends where it began. `state.moving`
        until then."""
        ...

    def turn_about(self, axis: Array, point: Array, angle: float, speed: float) -> None:
        """Start a motion with bounded jerk of the commanded pose on an arc: by `angle` rad about the unit
        `axis` (3,) through a `point` (3,), m (world), and turned with it, at most `speed` m/s. It begins at
        rest. `state.moving` until the command has ended."""
        ...

    def open_gripper(self) -> None:
        """Start opening the fingers fully. `state.gripper_moving` until they have stopped."""
        ...

    def close_gripper(self, force: float | None = None) -> None:
        """Start closing the fingers with at most `force` N of both together, the description's
        grasp force by default, until they meet resistance (then `state.gripping`) or each other.
        `state.gripper_moving` until they have stopped. On a held object it changes the force."""
        ...

    def hold(self) -> None:
        """Stop the arm smoothly and hold it there; a contact keeps its force, and the fingers their
        grasp. Without effect at rest."""
        ...

    def set_reflex(self, thresholds: Reflex) -> None:
        """Set the `thresholds` at which the arm stops itself within 1 ms; `limits.reflexes` has those
        for free air, carrying, probing and contact. Until the first call, those for contact, the
        widest, hold.

        After a reflex the arm yields: its equilibrium follows its measured pose, so that it presses
        on nothing, `state.moving` ends, and `state.reflex` has the reason. The fingers keep their
        grasp. The next motion clears it.

        On a Franka this is `setCollisionBehavior`, and `automaticErrorRecovery` before the next
        motion; a KUKA has force conditions that break a motion.
        """
        ...

    def advance(self, duration: float) -> None:
        """Let `duration` s of robot time pass, and update the state: simulated robots step, real
        ones wait.

        Raises:
            ExecutionAborted: the robot cannot go on; it takes no commands any more.
        """
        ...

    def drain(self) -> Samples:
        """Return the samples since the last call, in order of time; after `close` the last ones."""
        ...

    def close(self) -> None:
        """Stop, and disconnect. May be called twice, and at any time."""
        ...


@runtime_checkable
class RunsOn(Protocol):
    """A robot whose time passes only as it is asked to, as a simulated one's."""

    def run_on(self, ticks: int, tick: float) -> None:
        """Let up to `ticks` times `tick` s of robot time pass: less where the commanded motion ends, the
        arm stops itself, the fingers stop or let go, or something is felt; in whole ticks."""
        ...


@runtime_checkable
class Recoverable(Protocol):
    """A robot, or its workplace, that needs a person after a stop."""

    def recover(self) -> None:
        """Go on, after a person has seen to the reason of the stop.

        Raises:
            Unavailable: it cannot go on; the message names the remedy.
        """
        ...


@runtime_checkable
class Remembering(Protocol):
    """A robot that records the last seconds of its control loop."""

    def black_box(self) -> Mapping[str, Array] | None:
        """Return the control loop's inputs and outputs of the last seconds before a stop, by name,
        one row a cycle; None without a stop."""
        ...
