"""Set-points of the simulated controller: those of a motion, for all its 1 ms steps, and their correction for
the true arm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.common.pose import CONJUGATE, Array, Pose
from palpate.robots.simulated.noise.sensors import Encoders
from palpate.robots.simulated.readout import Readout
from palpate.robots.simulated.timing import BLOCK, LONGEST_RUN, PERIOD, TIMESTEP
from palpate.robots.simulated.world import World
from palpate.robots.springs import SpringGains
from palpate.robots.trajectory import PosePath, PositionPath, quaternion_matrix, rotate_quaternion

# Share of a new deviation that is applied in a run of cycles. Where joints or pads deform, the
# deviation follows the force and the force follows the set-point. The full deviation would
# oscillate where they are softer than the controller's springs.
BLEND = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Setpoints:
    """Set-points of a path, ready to slice; after its end the last one stays."""

    path: PositionPath | PosePath
    start: float  # s
    rows: Array  # (m, k) of each step
    poses: Array  # (m / 5, 7) commanded poses of each log period
    posture: Array  # (m / 5, 2 n) goal and rate of n joints for the null space, at the beginning of each period

    def first(self, t: float) -> int:
        """Return the step that begins at time `t`."""
        return min(round((t - self.start) / TIMESTEP), len(self.rows) - LONGEST_RUN * BLOCK)


def joint_setpoints(
    path: PositionPath, start: float, gains: SpringGains, poses: Callable[[Array], Array]
) -> Setpoints:
    """Make set-points for the joints' springs; `poses` maps configurations (n, 7) to TCP poses (n, 7)."""
    # Sample the path at every step, and the TCP pose in the middle of each log period.
    rows = path.sample(step_times(path, start))
    poses_world_tcp = poses(rows[BLOCK // 2 :: BLOCK])
    no_posture = np.empty((len(poses_world_tcp), 0))
    return Setpoints(path, start, rows + lead(rows, gains), poses_world_tcp, no_posture)


def pose_setpoints(
    path: PosePath, posture: PositionPath, start: float, gains: SpringGains
) -> Setpoints:
    """Make set-points for the TCP's springs, with a joint path for the null space."""
    times = step_times(path.path, start)
    # Sample the path, and the null space's configurations and rates in each log period.
    rows, configurations = path.path.sample(times), posture.sample(times[::BLOCK])
    rates = np.gradient(configurations, PERIOD, axis=0)
    # Rotation vectors are in the frame of the origin, springs in the world's.
    to_world = np.eye(6)
    to_world[3:, 3:] = Pose(np.zeros(3), path.origin).rotation
    led = rows + lead(rows @ to_world.T, gains) @ to_world
    # Convert rotation vectors to quaternions, with the lead for the springs and without it for the log.
    led_poses, poses = (
        np.concatenate([some[:, :3], rotate_quaternion(path.origin, some[:, 3:])], axis=1)
        for some in (led, rows[BLOCK // 2 :: BLOCK])
    )
    return Setpoints(path, start, led_poses, poses, np.concatenate([configurations, rates], axis=1))


def step_times(path: PositionPath, start: float) -> Array:
    """Return the times of all steps from `start` to the path's end, in whole blocks, plus one run."""
    blocks = max(0, int(np.ceil((path.end - start) / PERIOD - 1e-9)))
    return start + TIMESTEP * np.arange(1.0, (blocks + LONGEST_RUN) * BLOCK + 1)


def lead(rows: Array, gains: SpringGains) -> Array:
    """Compute the lead of the set-points over the motion `rows`, which cancels the springs' lag."""
    rate = np.gradient(rows, TIMESTEP, axis=0)
    return gains.lead(rate, np.gradient(rate, TIMESTEP, axis=0))


class Correction:
    """Correction of set-points and feed-forward torques for the true arm.

    The controller knows the reported arm; MuJoCo's springs act on the true arm. The correction is the true
    less the reported state, now and at the end of the next run of cycles.
    """

    def __init__(self, world: World, readout: Readout, encoders: Encoders, askew: bool) -> None:
        self._world, self._readout, self._encoders = world, readout, encoders
        self._needed = askew or not encoders.exact
        # (7,) N m by which the nominal arm's weight exceeds MuJoCo's compensation.
        self.torque = np.zeros_like(readout.q)
        self._turn = np.array([1.0, 0.0, 0.0, 0.0])
        self._before = self._after = self._current_error()

    def follow(self) -> None:
        """Update the deviation before a run of cycles, with a share of its change."""
        self._before, new = self._after, self._current_error()
        if self._needed:
            self._after = self._before + BLEND * (new - self._before)
        else:
            self._before = self._after = new

    def reached(self, share: float) -> None:
        """Record the share of the run of cycles after which it ended."""
        if share < 1.0:
            self._after = self._before + share * (self._after - self._before)

    def joints(self, rows: Array) -> Array:
        """Correct set-points (n, 7), rad, of the joints' springs."""
        return rows + self._ramp(len(rows), slice(3, None)) if self._needed else rows

    def positions(self, rows: Array) -> Array:
        """Correct positions (n, 3), m, of the TCP."""
        return rows + self._ramp(len(rows), slice(0, 3))

    def orientations(self, rows: Array) -> Array:
        """Correct orientations (n, 4) of the TCP."""
        return rows @ quaternion_matrix(self._turn).T if self._needed else rows

    def _ramp(self, count: int, part: slice) -> Array:
        """Interpolate from the end of the last run, so that no set-point jumps."""
        if self._before is self._after:
            return self._after[part]
        share = np.arange(1.0, count + 1)[:, None] / count
        return self._before[part] + share * (self._after - self._before)[part]

    def _current_error(self) -> Array:
        """Compute the true less reported TCP position (3) and joint angles (7), and the turn between both
        orientations.
        """
        readout, out = self._readout, np.zeros(3 + len(self._readout.q))
        if not self._needed:
            out[:3] = -self._encoders.pose_error
            return out
        # The deviation of the orientation is applied at once, as a rotation in the world.
        true, reported = self._world.true_tcp(), readout.pose_world_tcp
        turn = np.empty(4)
        mujoco.mju_mulQuat(turn, true.quaternion, CONJUGATE * reported.quaternion)
        self._turn = turn / math.sqrt(turn.dot(turn))
        self.torque = readout.gravity_torque - self._world.compensation
        out[:3], out[3:] = true.position - reported.position, -readout.angle_error
        return out
