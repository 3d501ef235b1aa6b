"""Simulated sensors of the arm: from recorded joint signals to logged samples, through the nominal
model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.nominal import NominalArm, wrenches
from palpate.robots.simulated.impedance import Gains
from palpate.robots.simulated.noise.disturbances import Motion
from palpate.robots.simulated.noise.line import Stamps
from palpate.robots.simulated.noise.sensors import Encoders, Sensors
from palpate.robots.simulated.timing import DAMPING_DELAY, LONGEST_RUN, PERIOD, SPRING_DELAY
from palpate.robots.simulated.world import Steps
from palpate.trace.samples import Samples

OBSERVER_TIME = 0.01  # s, time constant of the momentum observer, two log periods
LOAD_TIME = 0.2  # s, time constant with which a vertical force is taken for a load

AGES: Array = np.arange(LONGEST_RUN - 1.0, -1.0, -1.0)  # log periods of a run's samples at its end
_KEPT = math.exp(-PERIOD / OBSERVER_TIME)


class Felt(NamedTuple):
    """A run of n log periods as the arm's encoders report it."""

    steps: Steps
    t: Array  # (n,) s, world time at the end of each period
    target: Array  # (n, 7) commanded poses of the TCP
    mean: Array  # (n, 21) joint angles, rad, the TCP's pose, and gravity torques, N m
    dq: Array  # (n, 7) rad/s
    gained: Array  # (n, 7) rad/s, change of the joint rates in each period
    jacobian: Array  # (n, 6, 7) at the end of each period
    inertia_torque: Array  # (n, 7) N m, as `Kinematics`
    noise: Array  # (n, 7) rad and
    rate_noise: Array  # (n, 7) rad/s of the encoders
    stuck: Array  # (n, 7) N m that stick in the joints
    reported: tuple[Array, Pose]  # joint angles, rad, and the TCP's pose at its end
    pose_error: Array  # (3,) m at its end


class Newest(NamedTuple):
    """The newest sample that arrived."""

    stamp: float  # s, robot time
    dq: Array
    tau: Array
    tau_ext: Array
    twist: Array
    wrench: Array
    contact: Array


class Sensed(NamedTuple):
    """What the sensors have reported at the end of a run."""

    samples: Samples  # of the run
    newest: Newest
    reported: tuple[Array, Pose]  # as of the newest sample
    deviation: Array  # (7,) N m, sensed less true torque, without white noise
    load: float  # N on the hand: the slow part of the vertical force


class Readout:
    """Sensors along the runs of the arm: `feel` what its controller needs after each, and `read`
    several of them at once.

    Attributes:
        q, dq: (7,) rad, rad/s; `dq` is the last block's mean.
        pose_world_tcp: pose of the newest encoder reading, not a block's mean.
        jacobian: (6, 7).
        gravity_torque: (7,) N m, nominal.
        commanded: (7,) N m, the last block's.
        speed: (7,) rad/s at the end of the last block.
        angle_error: (7,) rad, reported less true joint angles now.
        sensed: at the end of the last run that was read.
    """

    def __init__(
        self,
        nominal: NominalArm,
        sensors: Sensors,
        encoders: Encoders,
        stamps: Stamps,
        q: Array,
        torque: Array,
        gains: Array,
    ) -> None:
        """Zero the sensors at rest at `q` (7,), rad, held up by `torque` (7,), N m; `gains` (7,) are
        measured relative errors of the sensors, which are corrected."""
        self._nominal, self._sensors, self._encoders = nominal, sensors, encoders
        self._stamps = stamps
        self._armature = nominal.armature
        reported = encoders.reported(q[None], torque[None])
        here = nominal.kinematics(reported)
        self.angle_error = reported[0] - q
        self._last = np.concatenate([reported[0], here.pose_world_tcp[0], here.gravity_torque[0]])
        self._last_noise = np.zeros(7)
        self.dq, self.speed, self._external = np.zeros(7), np.zeros(7), np.zeros(7)
        self.jacobian = here.jacobian[0]
        self.commanded = self.gravity_torque
        position = here.pose_world_tcp[:, :3]
        start = Motion(reported, np.zeros((1, 7)), self.jacobian, position)
        sensors.zero(torque, self.gravity_torque, start)
        self._gains, self._zeroed = 1.0 + gains, self.gravity_torque.copy()
        still = np.zeros(6)
        newest = Newest(0.0, self.dq, self.commanded, self.dq, still, still, still)
        self.sensed = Sensed(Samples.empty(), newest, self._place(), np.zeros(7), 0.0)

    @property
    def q(self) -> Array:
        return self._last[:7]

    @property
    def gravity_torque(self) -> Array:
        return self._last[14:]

    @property
    def pose_world_tcp(self) -> Pose:
        row = self._last[7:14]
        return Pose(row[:3] + self._encoders.pose_error, row[3:])

    @property
    def twist(self) -> Array:
        """(6,) TCP velocity, world axes."""
        return self.jacobian @ self.dq

    def _place(self) -> tuple[Array, Pose]:
        return self.q, self.pose_world_tcp

    def feel(self, steps: Steps, t: float, target: Array) -> Felt:
        """Follow a run of steps that ended at world time `t`; `target` (n, 7): commanded poses of the
        TCP."""
        gained = steps.dq.copy()
        gained[0] -= self.speed
        gained[1:] -= steps.dq[:-1]
        self.speed, self.commanded = steps.dq[-1], steps.torque[-1]
        q = self._reported(steps)
        here = self._nominal.kinematics(q, steps.dq, gained / PERIOD)
        count, encoders = len(q), self._encoders
        rows = np.empty((count + 1, 21))
        rows[0], rows[1:, :7] = self._last, q
        rows[1:, 7:14], rows[1:, 14:] = here.pose_world_tcp, here.gravity_torque
        mean = rows[1:] + rows[:-1]
        mean *= 0.5
        dq = (rows[1:, :7] - rows[:-1, :7]) / PERIOD
        self._last, self.jacobian = rows[-1], here.jacobian[-1]
        self.angle_error = q[-1] - steps.q[-1]
        stuck = noise = rate_noise = np.zeros((count, 7))
        if not self._sensors.rests.none:
            stuck = self._sensors.stuck(Motion(mean[:, :7], dq, self.jacobian, mean[:, 7:10]))
        encoders.pass_time(count)
        if not encoders.clean:
            noise = encoders.noise(count)
            rate_noise = (noise - np.concatenate([self._last_noise[None], noise[:-1]])) / PERIOD
            self._last_noise = noise[-1]
        self.dq = dq[-1] + rate_noise[-1]
        of_arm = mean, dq, gained, here.jacobian, here.inertia_torque
        of_sensors = noise, rate_noise, stuck, self._place(), encoders.pose_error.copy()
        return Felt(steps, t - PERIOD * AGES[-count:], target, *of_arm, *of_sensors)

    def read(self, runs: Sequence[Felt], gains: Gains) -> list[Sensed]:
        """Return what is sensed at the end of each run, and its samples that arrive.

        Positions, torques and derived signals are means over a sample's block.
        """
        ends = np.cumsum([len(run.t) for run in runs])
        mean, dq, jacobian = joined(runs, "mean"), joined(runs, "dq"), joined(runs, "jacobian")
        at_end = np.repeat([run.jacobian[-1] for run in runs], np.diff(ends, prepend=0), axis=0)
        true = self._link_torque(runs, at_end, gains)
        place = Motion(mean[:, :7], dq, at_end, mean[:, 7:10])
        torque, arrived, shown = self._sensors.measure(true, place, joined(runs, "stuck"), ends)
        torque = self._corrected(torque)
        deviation = self._corrected(shown) - true[ends - 1]
        tau_ext = torque - mean[:, 14:]
        both = np.empty((*tau_ext.shape, 2))
        inertia_torque = joined(runs, "inertia_torque")
        both[:, :, 0], both[:, :, 1] = tau_ext, self._observe(tau_ext - inertia_torque)
        both = wrenches(jacobian, both)
        contact = both[:, :, 1]
        self._add_noise(mean, jacobian, runs)
        dq = dq + joined(runs, "rate_noise")
        samples = Samples(
            t=self._stamps.of(joined(runs, "t")),
            q=mean[:, :7],
            dq=dq,
            tau_ext=tau_ext,
            wrench=both[:, :, 0],
            pose_world_tcp=mean[:, 7:14],
            twist=np.matmul(jacobian, dq[:, :, None])[:, :, 0],
            target_world_tcp=joined(runs, "target"),
            width=np.concatenate([run.steps.fingers.sum(1) for run in runs]),
        )
        found: list[Sensed] = []
        for i, (run, end) in enumerate(zip(runs, ends.tolist(), strict=True)):
            rows = slice(end - len(run.t), end)
            of_run, row, reported = samples.where(rows), end - 1, run.reported
            if arrived is not None and not arrived[rows].all():
                of_run = of_run.where(arrived[rows])
                row = rows.start + int(np.flatnonzero(arrived[rows]).max(initial=-1))
                reported = reported if arrived[end - 1] else self.sensed.reported
            newest = self.sensed.newest
            if row >= rows.start:
                forces = torque[row], tau_ext[row], samples.twist[row], both[row, :, 0]
                newest = Newest(float(samples.t[row]), dq[row], *forces, contact[row])
            newer = -math.expm1(-len(run.t) * PERIOD / LOAD_TIME)
            load = self.sensed.load + (contact[end - 1, 2] - self.sensed.load) * newer
            self.sensed = Sensed(of_run, newest, reported, deviation[i], load)
            found.append(self.sensed)
        return found

    def _reported(self, steps: Steps) -> Array:
        """Compute the encoders' angles (n, 7), rad, at the end of each block, without noise."""
        encoders = self._encoders
        q = encoders.reported(steps.q, steps.torque)
        if encoders.soft:
            tool = self.pose_world_tcp.rotation[:, 2]
            q = q + encoders.pressed(self.jacobian, steps.push @ tool, tool)
        return q

    def _corrected(self, torque: Array) -> Array:
        """Correct readings (..., 7), N m, for the measured gains, about the torque at zeroing."""
        return self._zeroed + (torque - self._zeroed) / self._gains

    def _add_noise(self, mean: Array, jacobian: Array, runs: Sequence[Felt]) -> None:
        """Add the encoders' errors to the angles and poses of `mean` (n, 21)."""
        noise = joined(runs, "noise")
        mean[:, 7:10] += np.repeat(
            [run.pose_error for run in runs], [len(run.t) for run in runs], axis=0
        )
        mean[:, :7] += noise
        mean[:, 7:10] += np.matmul(jacobian[:, :3], noise[:, :, None])[:, :, 0]
        mean[:, :7] = self._encoders.quantised(mean[:, :7])

    def _observe(self, residual: Array) -> Array:
        """Estimate the external joint torque (n, 7), N m, of n log periods: the momentum observer.

        The `residual` (n, 7) is the torque in each period that does not move the links: a contact or
        a load. The observer is its first-order filter, r' = K (tau_ext - r): A. De Luca, A.
        Albu-Schäffer, S. Haddadin, G. Hirzinger, "Collision Detection and Safe Reaction with the
        DLR-III Lightweight Manipulator Arm", IROS 2006. There the momentum is integrated so that no
        acceleration is needed; over one period, its gain is the mean acceleration's.
        """
        out = (1.0 - _KEPT) * residual
        before = self._external
        for row in out:
            row += _KEPT * before
            before = row
        self._external = before
        return out

    def _link_torque(self, runs: Sequence[Felt], jacobian: Array, gains: Gains) -> Array:
        """Compute the mean torques (n, 7) behind the gears in each block of some runs, without those
        of the motors' own inertia; `jacobian` (n, 6, 7): at the end of each one's run.

        The torque is sampled at the beginning of a cycle's last physics step. The integrator is
        implicit in the dampers: on average they act with the arm's speed `DAMPING_DELAY` after that.
        Springs act in every physics step with the arm's position then: on average, `SPRING_DELAY`
        before.
        """
        torque = np.concatenate([run.steps.torque for run in runs])
        gained = joined(runs, "gained")
        speed = np.concatenate([run.steps.dq for run in runs]) - gained / 2.0
        late = gains.on(gained, gains.damping * DAMPING_DELAY, jacobian)
        early = gains.on(speed, gains.stiffness * SPRING_DELAY, jacobian)
        return torque + early - (late + gained * self._armature) / PERIOD


def joined(runs: Sequence[Felt], name: str) -> Array:
    """Join a column of several runs."""
    return np.concatenate([getattr(run, name) for run in runs])
