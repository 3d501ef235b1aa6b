"""Sensor readout of the arm: from franky's states at 1 kHz to logged samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.robots.franky.course import CYCLE
from palpate.robots.franky.drive import Row
from palpate.robots.franky.faults import mode_of
from palpate.robots.nominal import NominalArm, wrenches
from palpate.trace.samples import Samples

BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * CYCLE
MATCH, TURNED = 0.002, np.radians(0.5)  # m, rad between the TCP of description and control box
SIGNALS = ("q", "dq", "tau_J", "tau_J_d", "tau_ext_hat_filtered", "O_F_ext_hat_K")
"""Of franky's states in the black box, under their own names."""


class Readout:
    """The latest sensed state, and the samples of each run of cycles.

    Torques are those behind the gears less gravity torques by the arm's own model, which has the
    hand that Desk is set to; `contact` is the arm's own estimate of the contact wrench.

    Attributes:
        stamp: s, robot time of the newest cycle.
        q, dq: (7,).
        tau, tau_ext: (7,) N m, of the last block.
        commanded: (7,) N m, without gravity torques.
        wrench, contact, twist: (6,).
        contact_torque: (7,) N m, the arm's own estimate of a contact's joint torques.
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
        """`gravity` (3,) m/s^2 in the base's axes; `gains` (7,) are measured relative errors of the
        sensors, which are corrected."""
        self._nominal, self._model, self._gravity = nominal, model, gravity
        self._base, self._gains = pose_world_base, 1.0 + gains
        self._turn = pose_world_base.rotation
        self._total = (state.m_total, np.array(state.F_x_Ctotal))
        self._block: list[Row] = []
        self._index: int | None = None
        self.wrench = self.twist = np.zeros(6)
        self.look(state)
        self.tau, self.commanded = np.array(state.tau_J), np.array(state.tau_J_d)
        self.tau_ext = self.tau / self._gains - self._gravity_torque(self.q)
        self.contact = self._in_world(state.O_F_ext_hat_K)
        self.contact_torque = np.array(state.tau_ext_hat_filtered)

    def look(self, state: Any) -> None:
        """Take the newest state."""
        self.state, self.stamp = state, state.time.to_sec()
        self.q, self.dq = np.array(state.q), np.array(state.dq)
        self.pose_world_tcp = self._base @ pose_of(state.O_T_EE)
        self.jacobian = self._nominal.kinematics(self.q[None]).jacobian[0]

    def read(self, rows: Sequence[Row], width: float) -> Samples:
        """Return the samples that some cycles complete; `width`: m between the fingers."""
        parts: list[Samples] = []
        # A busy computer's queue may deliver a cycle after a newer state: it is dropped.
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
        """Average a block's cycles; the stamp is the last one's."""
        states = [row.state for row in block]

        def mean(name: str) -> Array:
            return np.mean([getattr(state, name) for state in states], axis=0)

        q, dq, self.tau = mean("q"), mean("dq"), mean("tau_J") / self._gains
        self.tau_ext = self.tau - self._gravity_torque(q)
        self.commanded, self.contact = mean("tau_J_d"), self._in_world(mean("O_F_ext_hat_K"))
        self.contact_torque = mean("tau_ext_hat_filtered")
        jacobian = self._nominal.kinematics(q[None]).jacobian
        self.wrench = wrenches(jacobian, self.tau_ext[None, :, None])[0, :, 0]
        self.twist = jacobian[0] @ dq
        # The TCP's pose: the mean position, and the orientation in the middle.
        place = np.mean([state.O_T_EE.translation for state in states], axis=0)
        middle = pose_of(states[len(states) // 2].O_T_EE)
        return Samples(
            t=np.array([states[-1].time.to_sec()]),
            q=q[None],
            dq=dq[None],
            tau_ext=self.tau_ext[None],
            wrench=self.wrench[None],
            pose_world_tcp=(self._base @ Pose(place, middle.quaternion)).vector[None],
            twist=self.twist[None],
            target_world_tcp=block[len(block) // 2].target[None],
            width=np.array([width]),
        )

    def _gravity_torque(self, q: Array) -> Array:
        return np.array(self._model.gravity(q, *self._total, self._gravity))

    def _in_world(self, wrench: Any) -> Array:
        """Turn a wrench (6,) from base axes into world axes."""
        return np.concatenate([self._turn @ wrench[:3], self._turn @ wrench[3:]])


def pose_of(affine: Any) -> Pose:
    """Convert franky's transform, whose quaternions are xyzw."""
    x, y, z, w = affine.quaternion
    return Pose(np.array(affine.translation), np.array([w, x, y, z]))


def require_end_effector(state: Any, nominal: NominalArm, pose_world_base: Pose) -> float:
    """Require the control box's TCP to agree with the description's; return their distance, m.

    Raises:
        InputError: it does not.
    """
    row = nominal.poses(np.array(state.q)[None])[0]
    mine, theirs = Pose(row[:3], row[3:]), pose_world_base @ pose_of(state.O_T_EE)
    away, turned = mine.distance_to(theirs), mine.angle_to(theirs)
    if away > MATCH or turned > TURNED:
        raise InputError(
            f"the end effector that Desk is set to has its TCP {1e3 * away:.1f} mm and "
            f"{np.degrees(turned):.1f}° from where the arm's description has it: set the Franka Hand as "
            "end effector in Desk, or describe the one that is there (docs/arms.md)"
        )
    return away


def black_box(rows: Sequence[Row], why: str) -> Mapping[str, Array] | None:
    """Collect the last cycles at 1 kHz, one row a cycle, for diagnosis; None without any.

    Keys: `t`, `mode`, `SIGNALS`, the commanded pose `target_world_tcp`, the share of commands that
    `arrived`; and `why` the arm stopped.
    """
    if not rows:
        return None
    states = [row.state for row in rows]
    arrays: dict[str, Array] = {"why": np.array(why)}
    for name in SIGNALS:
        arrays[name] = np.array([getattr(state, name) for state in states])
    arrays["t"] = np.array([state.time.to_sec() for state in states])
    arrays["mode"] = np.array([mode_of(state) for state in states])
    arrays["arrived"] = np.array([state.control_command_success_rate for state in states])
    arrays["target_world_tcp"] = np.array([row.target for row in rows])
    return arrays
