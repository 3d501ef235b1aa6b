"""What an arm feels a wrench with: its joint torques, or, where a trace does not say how they come
about, the wrench itself.

A wrench W at the TCP shows in the joint torques as J^T W. Seven of them tell a load's three unknown
numbers better than the wrench (J^T)^+ tau that was made of them: each has its own noise, and a
sensor's gain is its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.hinges import hinges
from palpate.estimation.load.moving import own_motion
from palpate.estimation.windows import Mask, gained
from palpate.geometry.pose import Array, Pose
from palpate.trace.recording import Chain
from palpate.trace.samples import Samples, Trace


@dataclass(frozen=True, slots=True, eq=False)
class Feeling:
    """What a trace's signals say of the wrench at the TCP.

    Attributes:
        signals: (n, m) N m of m joints; or the wrench, N and N m.
        scale: (m,) of each: what a newton at the TCP makes of it, roughly.
        chain: None where the signals are the wrench.
        turn: (3, 3) base axes in world axes.
    """

    signals: Array
    scale: Array
    chain: Chain | None
    turn: Array

    @property
    def knows_links(self) -> bool:
        """Whether it is known what moving the arm's own links takes."""
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
        """(n, m) N m that the arm's own links took to move, in `rows` (n,), else 0; (n, 0) where
        nothing is known of them."""
        if self.chain is None or not self.chain.links or len(samples) < 2:
            return np.zeros((len(samples), 0))
        rates, changes = gained(samples.dq, samples.t, tuning.SPEED_SHORT)
        found = np.zeros(samples.q.shape)
        found[rows] = own_motion(self.chain, samples.q[rows], rates[rows], changes[rows])
        return found

    def links_motion(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(n, m) N m that the arm's own links take to be moved at joint angles `q` (n, 7), rad, rates
        and accelerations; 0 where nothing is known of them."""
        if self.chain is None or not self.chain.links:
            return np.zeros((len(q), self.signals.shape[1]))
        return own_motion(self.chain, q, dq, ddq)


def feeling(trace: Trace) -> Feeling:
    """The joints of a trace where its arm's chain is known and explains its wrench, else the
    wrench."""
    chain, samples = trace.hand.chain, trace.samples
    if chain is not None and len(samples):
        felt = by_joints(samples.tau_ext, chain, _turn(chain, samples))
        if _explains(felt, samples):
            return felt
    scale = np.array([1.0] * 3 + [tuning.TORQUE_LEVER] * 3)
    return Feeling(samples.wrench, scale, None, np.eye(3))


def by_joints(torques: Array, chain: Chain, turn: Array) -> Feeling:
    """What joint torques (n, m), N m, say; `turn` (3, 3): the base's axes in the world."""
    return Feeling(torques, np.full(len(chain.axes), tuning.TORQUE_LEVER), chain, turn)


def _explains(felt: Feeling, samples: Samples) -> bool:
    """Whether the joint torques of some rows make their wrench: signs and frames are as meant."""
    rows = np.linspace(0, len(samples) - 1, min(tuning.CHAIN_ROWS, len(samples))).astype(int)
    maps = felt.maps(samples.q[rows])
    made: Array = np.linalg.pinv(maps) @ felt.signals[rows][:, :, None]
    apart = np.linalg.norm((made[:, :, 0] - samples.wrench[rows])[:, :3], axis=1)
    return bool(np.median(apart) < tuning.CHAIN_FORCE)


def _turn(chain: Chain, samples: Samples) -> Array:
    """(3, 3) the base's axes in the world: what turns the computed tool into the measured one."""
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
