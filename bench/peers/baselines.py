"""Two published estimators of a load, from recordings of an arm with and without it. They share no code with palpate's.

Both are weighted least squares in the ten inertial parameters of the load, and state its textbook deviations: those
of independent residuals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from bench.peers.recordings import ARM, CYCLES, GRAVITY, SECONDS, LoadedLog
from palpate.common.pose import Array
from palpate.estimation.rigid_bodies import link_parameters, load_torques, regressor
from palpate.robots.owner import load_description
from palpate.trace.recording import Chain

LOW_PASS = 10.0
"""Hz: zero-phase Butterworth filter of all signals (Khalil and Dombre, section 12.4)."""
EVERY = 20
"""Rows of 1 kHz for each row of a fit: parallel decimation, as there."""
ROUNDS = 3
"""Solutions in which the weights of the joints are learned from the residuals."""
RIDGE = 0.05
"""Fraction of a link's mass, of its radius of 0.1 m and of their product, by which links may differ (1 sigma)."""
LINK_RADIUS = 0.1
"""m."""
SLOW = 0.05
"""rad/s: slower rows of a joint are left out of the difference, as its friction is discontinuous there."""


@dataclass(frozen=True, slots=True, eq=False)
class PeerEstimate:
    """Ten parameters of a load about the TCP in the tool's axes, kg, kg m and kg m², and their covariance."""

    value: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Filtered signals of an arm at n times, and the rows with a load."""

    q: Array
    dq: Array
    ddq: Array
    tau: Array
    held: Array

    @classmethod
    def of(cls, recording: LoadedLog, every: int = EVERY) -> Motion:
        """Filter a recording, and keep the rows of both motions."""
        log, (start, stop) = recording.log, recording.window
        step = float(np.median(np.diff(log.t)))
        filtered = butter(4, LOW_PASS, fs=1.0 / step, output="sos")
        q, dq, tau = (sosfiltfilt(filtered, each, axis=0) for each in (log.q, log.dq, log.tau))
        ddq = np.gradient(dq, step, axis=0)
        # The motion of the empty hand ends one rest before that with the load.
        rest = start / 2.0 - SECONDS / 2.0
        held = (log.t >= start) & (log.t < stop)
        empty = (log.t >= rest) & (log.t < rest + SECONDS)
        rows = np.flatnonzero(held | empty)[::every]
        return cls(q[rows], dq[rows], ddq[rows], tau[rows], held[rows])


def links_free(recording: LoadedLog) -> PeerEstimate:
    """Fit load, links, Coulomb and viscous friction, and offsets by weighted least squares with a ridge on the links.

    Source: W. Khalil and E. Dombre, Modeling, Identification and Control of Robots, 2002, chapter 12; load by two
    motions: W. Khalil, M. Gautier and P. Lemoine, Identification of the payload inertial parameters of industrial
    manipulators, ICRA 2007. Ridge towards the described links: as in T. Lee, P. Wensing and F. Park, T-RO 2020.
    """
    motion, chain = Motion.of(recording), _chain()
    n, joints = motion.q.shape
    links = regressor(chain, motion.q, motion.dq, motion.ddq, GRAVITY)
    described = np.array([link_parameters(chain, i) for i in range(joints)])
    y = motion.tau - np.einsum("njlp,lp->nj", links, described)
    # Columns: load in its rows, links, and three of each joint.
    load = (
        load_torques(chain, motion.q, motion.dq, motion.ddq, GRAVITY) * motion.held[:, None, None]
    )
    own = [np.sign(motion.dq), motion.dq, np.ones_like(motion.dq)]
    each = [one[:, :, None] * np.eye(joints) for one in own]
    design = np.concatenate([load, links.reshape(n, joints, -1), *each], axis=2)
    sizes = np.array([1.0, *[LINK_RADIUS] * 3, *[LINK_RADIUS**2] * 6])
    ridge = np.zeros(design.shape[2])
    ridge[10 : 10 + links.shape[2] * 10] = 1.0 / (RIDGE * np.outer(described[:, 0], sizes)).ravel()
    return _weighted(design, y, np.ones_like(y, dtype=bool), ridge)


def equal_motion(recording: LoadedLog) -> PeerEstimate:
    """Fit the load to the difference of torques at equal phase of two equal motions, averaged over periods.

    The torques of the links, offsets, and friction that does not depend on the load cancel. Source: the method of
    boyazeno/franka_payload_id (docs/THEORY.md, sections 4 and 8); J. Swevers et al., IEEE Control Systems Magazine
    27(5), 2007, for the average over periods.
    """
    motion, chain = Motion.of(recording, every=1), _chain()

    def periods(signal: Array, held: bool) -> Array:
        """Mean (n, 7) over the periods with or without the load, decimated."""
        rows = signal[motion.held == held]
        length = len(rows) // CYCLES
        return rows[: CYCLES * length].reshape(CYCLES, length, -1).mean(axis=0)[::EVERY]

    y = periods(motion.tau, True) - periods(motion.tau, False)
    q, dq, ddq = (periods(each, True) for each in (motion.q, motion.dq, motion.ddq))
    return _weighted(load_torques(chain, q, dq, ddq, GRAVITY), y, np.abs(dq) > SLOW, np.zeros(10))


BASELINES: dict[str, Callable[[LoadedLog], PeerEstimate]] = {
    "least squares, links free": links_free,
    "difference on equal motion": equal_motion,
}
"""Published estimators by name."""


def _chain() -> Chain:
    """Return the kinematics and links of the described arm."""
    chain = load_description(ARM).nominal.chain
    assert chain is not None
    return chain


def _weighted(design: Array, y: Array, used: Array, ridge: Array) -> PeerEstimate:
    """Solve weighted least squares of rows (n, 7, p), with weights of the joints from their residuals."""
    std, mean, inverse = np.ones(y.shape[1]), np.zeros(design.shape[2]), np.eye(design.shape[2])
    for _ in range(ROUNDS):
        weight = used / std
        x, z = design * weight[:, :, None], y * weight
        x = x.reshape(-1, x.shape[2])
        inverse = np.linalg.inv(x.T @ x + np.diag(ridge**2))
        mean = inverse @ (x.T @ z.ravel())
        left = (y - design @ mean) * used
        std = np.sqrt((left**2).sum(axis=0) / used.sum(axis=0))
    return PeerEstimate(mean[:10], inverse[:10, :10])
