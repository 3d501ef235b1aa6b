"""Sensor readout of the arm: from franky's states at 1 kHz to logged samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.franky.control.course import CYCLE
from palpate.robots.franky.control.drive import Row
from palpate.robots.nominal import NominalArm, wrenches
from palpate.trace.samples import Samples

BLOCK = 5
"""Cycles per logged sample: 200 Hz."""
PERIOD = BLOCK * CYCLE


class Readout:
    """The latest sensed state, and the samples of each run of cycles.

    Torques are those behind the gears less what holds up the arm by its own model, which knows the
    hand as Desk has it; `contact` is the arm's own estimate of what it touches.

    Attributes:
        stamp: s, robot time of the newest cycle.
        q, dq: (7,).
        tau, tau_ext: (7,) N m, of the last block.
        commanded: (7,) N m, without what holds the arm up.
        wrench, contact, twist: (6,).
        jacobian: (6, 7), world axes about the TCP.
        state: franky's newest.
    """

    def __init__(
        self,
        nominal: NominalArm,
        model: Any,
        state: Any,
        pose_world_base: Pose,
        gravity: Array,
        gains: Array,
    ) -> None:
        """`gravity` (3,) m/s^2 in the base's axes; `gains` (7,) are the relative errors of the
        sensors that were measured, and are corrected."""
        self._nominal, self._model, self._gravity = nominal, model, gravity
        self._base, self._gains = pose_world_base, 1.0 + gains
        self._turn = pose_world_base.rotation
        self._total = (state.m_total, np.array(state.F_x_Ctotal))
        self._block: list[Row] = []
        self._index: int | None = None
        self.contact = self.wrench = self.twist = np.zeros(6)
        self.tau = self.tau_ext = self.commanded = np.zeros(7)
        self.look(state)
        self.tau, self.commanded = np.array(state.tau_J), np.array(state.tau_J_d)
        self.tau_ext = self.tau / self._gains - self._weight(self.q)
        self.contact = self._in_world(state.O_F_ext_hat_K)

    def look(self, state: Any) -> None:
        """Take the newest state."""
        self.state, self.stamp = state, state.time.to_sec()
        self.q, self.dq = np.array(state.q), np.array(state.dq)
        self.pose_world_tcp = self._base @ pose_of(state.O_T_EE)
        self.jacobian = self._nominal.kinematics(self.q[None]).jacobian[0]

    def read(self, rows: Sequence[Row], width: float) -> Samples:
        """The samples that some cycles complete; `width` m between the fingers."""
        parts: list[Samples] = []
        # What a busy computer's queue brings after a newer state is told no more.
        rows = [row for row in rows if row.state.time.to_sec() > self.stamp]
        for row in rows:
            index = int(row.state.time.to_msec()) // BLOCK
            if self._index is not None and index != self._index and self._block:
                parts.append(self._sample(self._block, width))
                self._block = []
            self._index = index
            self._block.append(row)
        if rows:
            self.look(rows[-1].state)
        return parts[0] if len(parts) == 1 else Samples.concatenate(parts)

    def _sample(self, block: Sequence[Row], width: float) -> Samples:
        """The mean of a block's cycles, at its last one's time."""
        states = [row.state for row in block]
        q = np.mean([state.q for state in states], axis=0)
        dq = np.mean([state.dq for state in states], axis=0)
        tau = np.mean([state.tau_J for state in states], axis=0) / self._gains
        tau_ext = tau - self._weight(q)
        here = self._nominal.kinematics(q[None])
        wrench = wrenches(here.jacobian, tau_ext[None, :, None])[0, :, 0]
        twist = here.jacobian[0] @ dq
        self.tau, self.tau_ext, self.wrench, self.twist = tau, tau_ext, wrench, twist
        self.commanded = np.mean([state.tau_J_d for state in states], axis=0)
        felt = np.mean([state.O_F_ext_hat_K for state in states], axis=0)
        self.contact = self._in_world(felt)
        return Samples(
            np.array([states[-1].time.to_sec()]),
            q[None],
            dq[None],
            tau_ext[None],
            wrench[None],
            self._pose(states)[None],
            twist[None],
            block[len(block) // 2].target[None],
            np.array([width]),
        )

    def _pose(self, states: Sequence[Any]) -> Array:
        """(7,) the TCP in the world: the mean place, and the orientation in the middle."""
        middle = pose_of(states[len(states) // 2].O_T_EE)
        place = np.mean([state.O_T_EE.translation for state in states], axis=0)
        return (self._base @ Pose(place, middle.quaternion)).vector

    def _weight(self, q: Array) -> Array:
        """(7,) N m that hold the arm up."""
        return np.array(self._model.gravity(q, *self._total, self._gravity))

    def _in_world(self, wrench: Any) -> Array:
        """(6,) of base axes."""
        return np.concatenate([self._turn @ wrench[:3], self._turn @ wrench[3:]])


def pose_of(affine: Any) -> Pose:
    """franky's transform; its quaternions are xyzw."""
    x, y, z, w = affine.quaternion
    return Pose(np.array(affine.translation), np.array([w, x, y, z]))
