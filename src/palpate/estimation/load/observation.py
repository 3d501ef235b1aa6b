"""Observation of a wrench at the TCP: by the joint torques, or by the wrench itself where the trace
does not state the arm's kinematic chain.

A wrench W at the TCP shows in the joint torques as J^T W. Seven of them determine a load's three unknown
numbers better than the wrench (J^T)^+ tau computed from them: each sensor has its own noise and gain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.hinges import hinges
from palpate.estimation.load.inverse_dynamics import own_motion
from palpate.estimation.windows import Mask, gained
from palpate.geometry.pose import Array, Pose
from palpate.trace.recording import Chain
from palpate.trace.samples import Samples, Trace


@dataclass(frozen=True, slots=True, eq=False)
class WrenchObservation:
    """Joint torques and Jacobians that observe the wrench at the TCP.

    Attributes:
        signals: (n, m) N m of m joints; or the wrench, N and N m.
        scale: (m,) typical size of each signal per newton at the TCP.
        chain: None where the signals are the wrench.
        turn: (3, 3) base axes in world axes.
    """

    signals: Array
    scale: Array
    chain: Chain | None
    turn: Array

    @property
    def knows_links(self) -> bool:
        """The inertial parameters of the arm's links are known."""
        return self.chain is not None and bool(self.chain.links)

    def maps(self, q: Array) -> Array:
        """(k, m, 6): the signals of unit wrenches (world axes about the TCP) at joint angles `q`
        (k, 7)."""
        if self.chain is None:
            return np.broadcast_to(np.eye(6), (len(q), 6, 6))
        _, _, jacobian = _kinematics(self.chain, q)
        turned = np.concatenate([self.turn @ jacobian[:, :3], self.turn @ jacobian[:, 3:]], axis=1)
        return turned.transpose(0, 2, 1)

    def own_motion(self, samples: Samples, rows: Mask) -> Array:
        """(n, m) N m that moved the arm's own links, in `rows` (n,), else 0; (n, 0) where the link model
        is unknown."""
        if self.chain is None or not self.chain.links or len(samples) < 2:
            return np.zeros((len(samples), 0))
        rates, changes = gained(samples.dq, samples.t, tuning.SPEED_SHORT)
        found = np.zeros(samples.q.shape)
        found[rows] = own_motion(self.chain, samples.q[rows], rates[rows], changes[rows])
        return found

    def links_motion(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(n, m) N m that move the arm's own links at joint angles `q` (n, 7), rad, rates and
        accelerations; 0 where the link model is unknown."""
        if self.chain is None or not self.chain.links:
            return np.zeros((len(q), self.signals.shape[1]))
        return own_motion(self.chain, q, dq, ddq)


def observe(trace: Trace) -> WrenchObservation:
    """Observation by the joint torques where the arm's chain is known and reproduces the wrench, else by
    the wrench."""
    chain, samples = trace.hand.chain, trace.samples
    if chain is not None and len(samples):
        observed = observation_of_torques(samples.tau_ext, chain, _turn(chain, samples))
        if _explains(observed, samples):
            return observed
    scale = np.array([1.0] * 3 + [tuning.TORQUE_LEVER] * 3)
    return WrenchObservation(samples.wrench, scale, None, np.eye(3))


def observation_of_torques(torques: Array, chain: Chain, turn: Array) -> WrenchObservation:
    """Observation by joint torques (n, m), N m; `turn` (3, 3): the base's axes in the world."""
    return WrenchObservation(torques, np.full(len(chain.axes), tuning.TORQUE_LEVER), chain, turn)


def _explains(observed: WrenchObservation, samples: Samples) -> bool:
    """The joint torques reproduce the recorded wrench, so signs and frames are consistent."""
    rows = np.linspace(0, len(samples) - 1, min(tuning.CHAIN_ROWS, len(samples))).astype(int)
    maps = observed.maps(samples.q[rows])
    made: Array = np.linalg.pinv(maps) @ observed.signals[rows][:, :, None]
    apart = np.linalg.norm((made[:, :, 0] - samples.wrench[rows])[:, :3], axis=1)
    return bool(np.median(apart) < tuning.CHAIN_FORCE)


def _turn(chain: Chain, samples: Samples) -> Array:
    """(3, 3) the base's axes in the world: the rotation from the computed to the measured tool."""
    row = slice(0, 1)
    _, tool, _ = _kinematics(chain, samples.q[row])
    measured = Pose.of(samples.pose_world_tcp[0, :3], samples.pose_world_tcp[0, 3:])
    return measured.rotation @ tool[0].T


def _kinematics(chain: Chain, q: Array) -> tuple[Array, Array, Array]:
    """TCP (k, 3), tool (k, 3, 3) and Jacobian (k, 6, m) about the TCP, in the base's axes.

    Its columns are the hinges' twists (Lynch and Park, Modern Robotics, 2017, chapter 5).
    """
    turned = hinges(chain, q)
    last = turned[-1]
    tcp = last.frame @ np.array(chain.tcp) + last.origin
    columns: list[Array] = []
    for hinge in turned:
        about_tcp = np.cross(hinge.axis, tcp - hinge.anchor)
        columns.append(np.concatenate([about_tcp, hinge.axis], axis=1))
    return tcp, last.frame @ np.array(chain.tool), np.stack(columns, axis=2)
