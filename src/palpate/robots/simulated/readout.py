"""Simulated sensors of the arm: from recorded joint signals to logged samples, by the nominal model."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Pose
from palpate.robots.nominal import NominalArm, wrenches
from palpate.robots.simulated.noise.disturbances import LoggedMotion
from palpate.robots.simulated.noise.line import Stamps
from palpate.robots.simulated.noise.sensors import Encoders, Sensors, WristSensor
from palpate.robots.simulated.timing import LONGEST_RUN, PERIOD
from palpate.robots.simulated.world import Steps
from palpate.robots.springs import SpringGains, Swivel
from palpate.robots.wrist import HandLoad
from palpate.trace.samples import Samples

OBSERVER_TIME = 0.01  # s, time constant of the momentum observer: two log periods
LOAD_TIME = 0.2  # s, time constant of the vertical force that counts as a load

MOST = 2 * LONGEST_RUN  # log periods that are read at once, at most
_KEPT = math.exp(-PERIOD / OBSERVER_TIME)
# Response of the observer to the residual of each period, and the decay of its previous state.
_AGES = np.subtract.outer(np.arange(MOST), np.arange(MOST))
_RESPONSE: Array = (1.0 - _KEPT) * np.tril(_KEPT ** np.maximum(_AGES, 0))
_FADE: Array = _KEPT ** np.arange(1.0, MOST + 1)[:, None]


class Followed(NamedTuple):
    """Motion of the robot over n log periods, reported by the encoders without noise."""

    mean: Array  # (n, 2 m + 7) angles of m joints, rad, the TCP's pose, and gravity torques, N m
    dq: Array  # (n, 7) rad/s
    jacobian: Array  # (n, 6, 7) at the end of each period
    inertia_torque: Array  # (n, 7) N m, as `Kinematics`
    true: Array  # (n, 7) N m, torque behind the gears
    target: Array  # (n, 7) commanded poses of the TCP
    width: Array  # (n,) m between the fingers
    wrench: Array  # (n, 6) N and N m, true wrench below a six-axis sensor; (n, 0) without one
    twist: Array  # (n, 6) mean velocity of the TCP, world axes
    acceleration: Array  # (n, 6) change of it


class Measurement(NamedTuple):
    """Torques and wrenches measured along a motion."""

    torque: Array  # (n, 7) N m
    tau_ext: Array
    wrench: Array  # (n, 6)
    contact: Array
    contact_torque: Array  # (n, 7) N m
    arrived: NDArray[np.bool_] | None  # (n,) True for samples that arrive; None for all
    sensed: Array  # (n, 6) reading of a six-axis sensor, in its axes; (n, 0) without one


class Wrist(NamedTuple):
    """A six-axis sensor, and the hand below it. The sensor then measures the external wrench."""

    sensor: WristSensor
    hand: HandLoad


class Readout:
    """The latest sensed state, and the samples of all runs of steps.

    The controller's part uses the encoders alone, and is up to date after each run (`follow`). Samples and
    the quantities derived from them are up to date after `read`.

    Attributes:
        q, rate: (7,) rad, rad/s, of the controller, whose encoders are read without noise.
        dq: (7,) rad/s, of the newest sample that arrived.
        tau, tau_ext: (7,) N m.
        wrench, contact, twist: (6,).
        contact_torque: (7,) N m, of the joints: of a contact or a load, without the arm's inertia.
        pose_world_tcp: pose of the newest encoder reading, not a block's mean.
        stamp: s, robot time of the newest sample that arrived.
        reported: joint angles (7,), rad, and pose of the TCP, as of that sample.
        jacobian: (6, 7).
        gravity_torque: (7,) N m, nominal.
        commanded: (7,) N m, of the last block.
        speed: (7,) rad/s at the end of the last block; `dq` is its mean.
        deviation: (7,) N m, sensed less true torque now, without white noise.
        load: N on the hand: the slow part of the vertical force.
        angle_error: (7,) rad, reported less true joint angles now.
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
        wrist: Wrist | None = None,
    ) -> None:
        """Zero the sensors at rest at `q` (7,), rad, with the holding torques `torque` (7,), N m.

        `gains` (7,) are measured relative errors of the sensors, which are corrected. `wrist` is a zeroed six-axis
        sensor.
        """
        self._nominal, self._sensors, self._encoders = nominal, sensors, encoders
        self._stamps, self._wrist = stamps, wrist
        self._armature = nominal.armature
        reported = encoders.reported(q[None], torque[None])
        here = nominal.kinematics(reported)
        self.angle_error = reported[0] - q
        self._last = np.concatenate([reported[0], here.pose_world_tcp[0], here.gravity_torque[0]])
        self._joints = joints = len(q)
        # Columns of the TCP's pose and position among the joint angles, the pose and the weights.
        self._pose, self._place = slice(joints, joints + 7), slice(joints, joints + 3)
        none = np.zeros(joints)
        self._last_noise = none
        self.stamp = 0.0
        self.reported = (self.q, self.pose_world_tcp)
        self.speed = none
        self.rate: Array = none
        self._followed: list[Followed] = []
        self.dq, self.tau_ext, self._external = none, none, none
        self.wrench, self.contact, self.twist = np.zeros(6), np.zeros(6), np.zeros(6)
        self.contact_torque = none
        self.deviation, self.load = none, 0.0
        self.jacobian = here.jacobian[0]
        self.tau = self.commanded = self.gravity_torque
        position = here.pose_world_tcp[:, :3]
        start = LoggedMotion(reported, none[None], self.jacobian, position)
        sensors.zero(torque, self.gravity_torque, start)
        self._gains, self._zeroed = 1.0 + gains, self.gravity_torque.copy()
        # Velocity of the TCP at the end of the last block, and the filtered wrench of a six-axis sensor.
        self._twist, self._touched = np.zeros(6), np.zeros(6)

    @property
    def q(self) -> Array:
        return self._last[: self._joints]

    @property
    def gravity_torque(self) -> Array:
        return self._last[self._joints + 7 :]

    @property
    def pose_world_tcp(self) -> Pose:
        row = self._last[self._pose]
        return Pose(row[:3] + self._encoders.pose_error, row[3:])

    @property
    def pending(self) -> bool:
        """Test if there are runs that were followed but not read."""
        return bool(self._followed)

    @property
    def full(self) -> bool:
        """Test if another run may be too long to be read with the runs followed so far."""
        return sum(len(run.dq) for run in self._followed) > MOST - LONGEST_RUN

    def read(self, t: float) -> Samples:
        """Return the samples that arrive of all runs followed since the last call, until world time `t`.

        Positions, torques and derived signals are means over a sample's block.
        """
        # Join the runs, and simulate the sensors along the whole motion.
        runs, self._followed = self._followed, []
        motion = runs[0]
        if len(runs) > 1:
            motion = Followed(*map(np.concatenate, zip(*runs, strict=True)))
        measured = self._measure(motion)
        self._encoders.pass_time(len(motion.dq))
        motion.mean[:, self._place] += self._encoders.pose_error
        dq = motion.dq if self._encoders.clean else self._add_noise(motion)
        samples = Samples(
            t=self._stamps.of(t - PERIOD * np.arange(len(dq) - 1.0, -1.0, -1.0)),
            q=motion.mean[:, : self._joints],
            dq=dq,
            tau_ext=measured.tau_ext,
            wrench=measured.wrench,
            pose_world_tcp=motion.mean[:, self._pose],
            twist=np.matmul(motion.jacobian, dq[:, :, None])[:, :, 0],
            target_world_tcp=motion.target,
            width=motion.width,
            wrench_sensor=measured.sensed,
        )
        # Drop the samples that got lost; the state is that of the newest sample that arrived.
        torque, contact, arrived = measured.torque, measured.contact, measured.arrived
        felt = measured.contact_torque
        if arrived is None or arrived[-1]:
            self.reported = (self.q, self.pose_world_tcp)
        if arrived is not None and not arrived.all():
            samples, torque, contact = samples.where(arrived), torque[arrived], contact[arrived]
            felt = felt[arrived]
        if len(samples):
            self.stamp = float(samples.t[-1])
            self.dq, self.twist, self.wrench = samples.dq[-1], samples.twist[-1], samples.wrench[-1]
            self.tau, self.tau_ext, self.contact = torque[-1], samples.tau_ext[-1], contact[-1]
            self.contact_torque = felt[-1]
        return samples

    def follow(self, steps: Steps, gains: SpringGains, swivel: Swivel, target: Array) -> None:
        """Follow a run of steps: compute the arm's motion from the encoders.

        `swivel` damps the null space; `target` (n, 7) has the commanded poses of the TCP.
        """
        # Change of the joint speeds over each block.
        gained = steps.dq.copy()
        gained[0] -= self.speed
        gained[1:] -= steps.dq[:-1]
        self.speed = steps.dq[-1]
        # Reported angles, and the kinematics of the nominal arm at the end of each block.
        q = self._report_angles(steps)
        here = self._nominal.kinematics(q, steps.dq, gained / PERIOD)
        # Means over a block are midpoints of its ends; speeds are differences of them.
        joints, weight = slice(self._joints), slice(self._joints + 7, None)
        rows = np.empty((len(q) + 1, len(self._last)))
        rows[0], rows[1:, joints] = self._last, q
        rows[1:, self._pose], rows[1:, weight] = here.pose_world_tcp, here.gravity_torque
        mean = rows[1:] + rows[:-1]
        mean *= 0.5
        dq = (rows[1:, joints] - rows[:-1, joints]) / PERIOD
        self._last, self.jacobian, self.rate = rows[-1], here.jacobian[-1], dq[-1]
        self.angle_error, self.commanded = q[-1] - steps.q[-1], steps.torque[-1]
        true = self._link_torque(steps, gained, gains, swivel, here.jacobian)
        # The torque of each physics step holds the arm at its beginning: half a step before the middle.
        true += (rows[1:, weight] - rows[:-1, weight]) * (steps.step / 2.0 / PERIOD)
        # Velocity of the TCP at the ends of the blocks, for the inertia of the hand.
        ends = np.concatenate([self._twist[None], (here.jacobian @ steps.dq[:, :, None])[:, :, 0]])
        self._twist = ends[-1]
        self._followed.append(
            Followed(
                mean,
                dq,
                here.jacobian,
                here.inertia_torque,
                true,
                target,
                steps.fingers.sum(1),
                steps.wrench,
                (ends[1:] + ends[:-1]) / 2.0,
                (ends[1:] - ends[:-1]) / PERIOD,
            )
        )

    def _report_angles(self, steps: Steps) -> Array:
        """Compute the encoders' angles (n, 7), rad, at the end of each block, without noise."""
        encoders = self._encoders
        q = encoders.reported(steps.q, steps.torque)
        if encoders.soft:
            tool = self.pose_world_tcp.rotation[:, 2]
            q = q + encoders.pressed(self.jacobian, steps.push @ tool, tool)
        return q

    def _measure(self, motion: Followed) -> Measurement:
        """Simulate the torque sensors along a motion."""
        # Read the sensors, and correct their readings for the measured gains.
        place = LoggedMotion(
            motion.mean[:, : self._joints], motion.dq, self.jacobian, motion.mean[:, self._place]
        )
        torque, arrived, shown = self._sensors.measure(motion.true, place)
        torque = self._correct_gains(torque)
        self.deviation = self._correct_gains(shown) - motion.true[-1]
        # The external torque is the torque less the nominal weight; the contact's part excludes the arm's
        # inertia.
        tau_ext = torque - motion.mean[:, self._joints + 7 :]
        both = np.empty((*tau_ext.shape, 2))
        felt = observe(tau_ext - motion.inertia_torque, self._external)
        self._external = felt[-1]
        both[:, :, 0], both[:, :, 1] = tau_ext, felt
        both = wrenches(motion.jacobian, both)
        wrench, contact, sensed = both[:, :, 0], both[:, :, 1], motion.wrench
        # A six-axis sensor measures the wrench itself.
        if self._wrist is not None:
            sensed = self._wrist.sensor.read(motion.wrench)
            attitude = motion.mean[:, self._place.stop : self._pose.stop]
            attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
            wrench = self._wrist.hand.external(sensed, attitude, motion.twist, motion.acceleration)
            contact = observe(wrench, self._touched)
            self._touched = contact[-1]
        # The load is a low-pass filter of the vertical force.
        newer = -math.expm1(-len(torque) * PERIOD / LOAD_TIME)
        self.load += (contact[-1, 2] - self.load) * newer
        return Measurement(torque, tau_ext, wrench, contact, felt, arrived, sensed)

    def _correct_gains(self, torque: Array) -> Array:
        """Correct readings (..., 7), N m, for the measured gains, about the torque at zeroing."""
        return self._zeroed + (torque - self._zeroed) / self._gains

    def _add_noise(self, motion: Followed) -> Array:
        """Add the encoders' noise to the angles and poses of `motion.mean`; return the noisy rates (n, 7),
        rad/s.
        """
        mean, dq, noise = motion.mean, motion.dq, self._encoders.noise(len(motion.mean))
        if noise is not None:
            # Noise of the angles moves the TCP by the Jacobian, and enters the rates as a difference.
            mean[:, : self._joints] += noise
            mean[:, self._place] += np.matmul(motion.jacobian[:, :3], noise[:, :, None])[:, :, 0]
            before = np.concatenate([self._last_noise[None], noise[:-1]])
            dq = dq + (noise - before) / PERIOD
            self._last_noise = noise[-1]
        joints = slice(self._joints)
        mean[:, joints] = self._encoders.quantise_angles(mean[:, joints])
        return dq

    def _link_torque(
        self, steps: Steps, gained: Array, gains: SpringGains, swivel: Swivel, jacobian: Array
    ) -> Array:
        """Compute the mean torque (n, 7) behind the gears in each block, without the torque of the motors'
        own inertia.

        Torques are sampled at the beginning of each physics step. The integrator is implicit in dampers,
        which act with the speed at the end of the step.
        """
        # Correct the dampers' torques for the change of speed within a step.
        late = gains.on(gained, gains.damping * steps.step, jacobian)
        if gains.cartesian:
            late += np.outer(gained @ swivel.axis, swivel.damping * steps.step * swivel.axis)
        return steps.torque - (late + gained * self._armature) / PERIOD


def observe(residual: Array, before: Array) -> Array:
    """Estimate the external torque or wrench (n, k) of n log periods: the momentum observer.

    The `residual` (n, k) is the torque in each period that does not move the links: a contact or a
    load. The observer is its first-order filter, r' = K (tau_ext - r), from the state `before` (k,): A. De
    Luca, A. Albu-Schäffer, S. Haddadin, G. Hirzinger, "Collision Detection and Safe Reaction with the
    DLR-III Lightweight Manipulator Arm", IROS 2006. That paper integrates the momentum so that no
    acceleration is needed. Over one period, the change of momentum equals the mean acceleration times the
    inertia.
    """
    n = len(residual)
    return _RESPONSE[:n, :n] @ residual + _FADE[:n] * before
