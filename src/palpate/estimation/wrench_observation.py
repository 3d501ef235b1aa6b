"""Observation of a wrench at the TCP by the joint torques.

A wrench W at the TCP appears in the joint torques as J^T W. Seven torques determine the three
unknowns of a load better than the wrench (J^T)^+ tau computed from them: each sensor has its own
noise and gain. Without the arm's kinematic chain in the trace, the signals are the wrench itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.estimation.motion import Mask, smoothed_with_rate
from palpate.estimation.rigid_bodies import own_motion, tool_kinematics
from palpate.trace.recording import Chain, NominalHand
from palpate.trace.samples import Samples, Trace

FOLLOWED = 0.1
"""s: averaging time of speeds and torques. Between 8 and 30 Hz the torque of a real arm does not follow its links'
motion, as gears, encoders and controller ripple and resonate. Sensitive: mass std ×1.05 at `lab`; on a recorded FR3 it
halves it. With 0.02 s in a lift, the encoder ripple reads as −2.5 N/m along it at `measured`."""
CHAIN_ROWS = 20
"""rows on which the arm's kinematics must reproduce the wrench. Not sensitive."""
CHAIN_FORCE = 0.5
"""N, median over those rows: with a larger difference the wrench itself is used. Not sensitive."""
CROSSTALK_SHARE = 0.25
"""fraction (1 sigma) of the gain error that applies to the torques of other joints; 0.14 % where
gains are known to ±1 %. Bending is read as torsion: 0.43 N m of 54 N m in an uncalibrated sensor
designed against it (Design and Optimization of a Joint Torque Sensor with Small Crosstalk Error for
Robots, econbiz.de/Record/10013300597). Sensitive: mass above 1 kg std ×1.02–1.08 at `measured`."""
TORQUE_LEVER = 0.3
"""m: converts these forces to moments about the TCP (typical lever arm of the wrist joints).
Sensitive: com 0.07 σ, std ×0.9–1.1."""

WRENCH_SCALE = np.array([1.0] * 3 + [TORQUE_LEVER] * 3)
"""Typical size of each part of a wrench per newton."""

GAIN, CROSSTALK = "gain", "cross-talk"
"""Names of causes: gains of the sensors, and their response to the torques of other joints."""


@dataclass(frozen=True, slots=True, eq=False)
class WrenchObservation:
    """Joint torques and Jacobians that observe the wrench at the TCP."""

    signals: Array  # (n, m) N m of m joints; or the wrench, N and N m
    scale: Array  # (m,) typical size of each signal per newton at the TCP
    chain: Chain | None  # None where the signals are the wrench
    turn: Array  # (3, 3) axes of the base in the world
    sensed: bool = (
        False  # the signals are the wrench of a six-axis sensor, without the hand's inertia
    )

    @property
    def knows_links(self) -> bool:
        """True if the signals are free of the inertia of the arm's links, or it is known."""
        return self.sensed or (self.chain is not None and bool(self.chain.links))

    def maps(self, q: Array) -> Array:
        """Compute the signals (k, m, 6) of unit wrenches at joint angles `q` (k, 7), rad.

        The wrenches are in world axes about the TCP.
        """
        if self.chain is None:
            return np.broadcast_to(np.eye(6), (len(q), 6, 6))
        # Transposed Jacobian, turned from the base to the world.
        _, _, jacobian = tool_kinematics(self.chain, q)
        turned = np.concatenate([self.turn @ jacobian[:, :3], self.turn @ jacobian[:, 3:]], axis=1)
        return turned.transpose(0, 2, 1)

    def wrenches(self, q: Array) -> Array:
        """Compute the wrenches (k, 6, m) of unit signals at joint angles `q` (k, 7): the
        least-squares inverse of `maps`.

        The wrenches are in world axes about the TCP.
        """
        maps = self.maps(q)
        turned = maps.transpose(0, 2, 1)
        # Regularised normal equations: ten times faster than a singular value decomposition, and
        # finite in singular poses.
        return np.linalg.solve(turned @ maps + 1e-12 * np.eye(6), turned).astype(np.float64)

    def own_motion(self, samples: Samples, rows: Mask, over: float = FOLLOWED) -> Array:
        """Compute the torque (n, m), N m, that moved the arm's own links in `rows` (n,), else 0.

        Rates are averaged over `over` s. The result is (n, 0) where the links are unknown.
        """
        if self.sensed:
            return np.zeros(self.signals.shape)
        if self.chain is None or not self.chain.links or len(samples) < 2:
            return np.zeros((len(samples), 0))
        rates, changes = smoothed_with_rate(samples.dq, samples.t, over)
        found = np.zeros(samples.q.shape)
        found[rows] = own_motion(self.chain, samples.q[rows], rates[rows], changes[rows])
        return found

    def links_motion(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Compute the torque (n, m), N m, that moves the arm's own links; 0 where the links are unknown.

        Args:
            q: (n, 7) rad.
            dq: (n, 7) rad/s.
            ddq: (n, 7) rad/s².
        """
        if self.chain is None or not self.chain.links:
            return np.zeros((len(q), self.signals.shape[1]))
        return own_motion(self.chain, q, dq, ddq)


def is_sensed(trace: Trace) -> bool:
    """Return True if the trace has the readings of a six-axis sensor."""
    return trace.hand.wrench_sensor is not None and trace.samples.wrench_sensor.shape[1] == 6


def observe_wrench(trace: Trace) -> WrenchObservation:
    """Observe by a six-axis sensor, whose external wrench the samples have, else as `observe`."""
    if not is_sensed(trace):
        return observe(trace)
    return WrenchObservation(trace.samples.wrench, WRENCH_SCALE, None, np.eye(3), sensed=True)


def observe(trace: Trace) -> WrenchObservation:
    """Observe by the joint torques where the arm's chain is known and reproduces the wrench, else
    by the wrench. The wrench of a six-axis sensor is no test of the torques."""
    chain, samples = trace.hand.chain, trace.samples
    if chain is not None and len(samples):
        # Axes of the base in the world, from the computed and the measured tool axes.
        _, tool, _ = tool_kinematics(chain, samples.q[:1])
        measured = Pose.of(samples.pose_world_tcp[0, :3], samples.pose_world_tcp[0, 3:])
        observed = observation_of_torques(samples.tau_ext, chain, measured.rotation @ tool[0].T)
        if is_sensed(trace):
            return observed
        # Where torques do not reproduce the recorded wrench, signs or frames are inconsistent.
        rows = np.linspace(0, len(samples) - 1, min(CHAIN_ROWS, len(samples))).astype(int)
        made = observed.wrenches(samples.q[rows]) @ observed.signals[rows][:, :, None]
        apart = np.linalg.norm((made[:, :, 0] - samples.wrench[rows])[:, :3], axis=1)
        if bool(np.median(apart) < CHAIN_FORCE):
            return observed
    # Fall back on the recorded wrench.
    return WrenchObservation(samples.wrench, WRENCH_SCALE, None, np.eye(3))


def observation_of_torques(torques: Array, chain: Chain, turn: Array) -> WrenchObservation:
    """Observe by joint torques (n, m), N m; `turn` (3, 3) holds the axes of the base in the world."""
    return WrenchObservation(torques, np.full(len(chain.axes), TORQUE_LEVER), chain, turn)


def force_gain(hand: NominalHand) -> float:
    """Half width of the relative error of a measured force: of a six-axis sensor, or of the joints' torques."""
    if hand.wrench_sensor is None:
        return hand.torque_gain
    return float(np.sqrt(3.0)) * hand.wrench_sensor.gain


def gain_root(hand: NominalHand, signals: int) -> Array:
    """Compute the effects (m, m) of m independent causes, one standard deviation each, on the relative gains of m
    torque sensors.

    A stated half width is that of a uniform distribution of each gain (GUM, JCGM 100:2008, 4.3.7). For calibrated
    joints the matrix is the symmetric root of their covariance, so that each cause is mostly one joint's.
    """
    if hand.gain_covariance is None or len(hand.gain_covariance) != signals:
        return hand.torque_gain / np.sqrt(3.0) * np.eye(signals)
    # Symmetric square root by eigenvalues; rounding may make them slightly negative.
    sizes, axes = np.linalg.eigh(np.array(hand.gain_covariance))
    return (axes * np.sqrt(np.maximum(sizes, 0.0))) @ axes.T


def common_gain(hand: NominalHand) -> float:
    """Standard deviation of a relative gain error that all torque sensors share.

    A datasheet bounds each gain and states nothing about a common part, such as temperature or
    reference. The covariance of a calibrated arm includes it.
    """
    return hand.torque_gain / np.sqrt(3.0) if hand.gain_covariance is None else 0.0


def crosstalk(hand: NominalHand, torque: Array) -> Array:
    """Compute the cross-talk (k, m), N m (1 sigma), of each of m sensors from the torques (k, m) of the other joints.

    The torques of one load are nearly in proportion to each other in all poses. A single column for each sensor
    therefore represents its response to all of them. It is 0 where the signals are a wrench, and after a calibration,
    whose weight included it in the gains.
    """
    if torque.shape[1] != len(hand.joints) or hand.gain_covariance is not None:
        return np.zeros_like(torque)
    # Root sum of squares of the torques of the other joints.
    squares = torque**2
    others = squares.sum(axis=1, keepdims=True) - squares
    return CROSSTALK_SHARE * hand.torque_gain / np.sqrt(3.0) * np.sqrt(np.maximum(others, 0.0))
