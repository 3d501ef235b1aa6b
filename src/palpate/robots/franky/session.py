"""A connection to a control box, and the readout of its states."""

from __future__ import annotations

import atexit
import ctypes
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from palpate.common.errors import InputError, Stopped, Unavailable
from palpate.common.pose import Array, Pose
from palpate.common.processes import Call, CallTimeout
from palpate.robots.franky import control_box
from palpate.robots.franky.control_box import ANSWERS, Address, franky, mode_of, require_answer
from palpate.robots.franky.drive import CYCLE, CycleRow
from palpate.robots.nominal import NominalArm, wrenches
from palpate.robots.sheet import Reflex
from palpate.trace.samples import Samples

BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * CYCLE
MATCH, TURNED = 0.002, np.radians(0.5)  # m, rad: tolerance of the TCP
# Signals of franky's states in the black box, under their own names.
SIGNALS = ("q", "dq", "tau_J", "tau_J_d", "tau_ext_hat_filtered", "O_F_ext_hat_K")


class StateReadout:
    """The latest sensed state, and the samples of each run of cycles.

    External torques are those behind the gears less gravity torques by the arm's own model, which has the
    hand that is set in Desk. `contact` is the arm's own estimate of the contact wrench.

    Attributes:
        stamp: s, robot time of the newest cycle.
        q, dq: (7,).
        tau, tau_ext: (7,) N m, of the last block.
        commanded: (7,) N m, without gravity torques.
        wrench, contact, twist: (6,).
        contact_torque: (7,) N m, the arm's own estimate of a contact's joint torques.
        jacobian: (6, 7), world axes about the TCP.
        state: franky's newest state.
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
        """Start at the arm's present `state`.

        `gravity` (3,) is in m/s^2 in the base's axes. `gains` (7,) are measured relative errors of the
        sensors, which are corrected.
        """
        self._nominal, self._model, self._gravity = nominal, model, gravity
        self._base, self._gains = pose_world_base, 1.0 + gains
        self._turn = pose_world_base.rotation
        self._total = (state.m_total, np.array(state.F_x_Ctotal))
        self._block: list[CycleRow] = []
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

    def read(self, rows: Sequence[CycleRow], width: float) -> Samples:
        """Return the samples that some cycles complete; `width` is the distance, m, between the fingers."""
        parts: list[Samples] = []
        # A busy computer's queue may deliver a cycle after a newer state. Such cycles are dropped.
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

    def _sample(self, block: Sequence[CycleRow], width: float) -> Samples:
        """Average a block's cycles; the stamp is that of the last cycle."""
        states = [row.state for row in block]

        def mean(name: str) -> Array:
            return np.mean([getattr(state, name) for state in states], axis=0)

        # Means of the signals, and the external torque by the arm's own gravity model.
        q, dq, self.tau = mean("q"), mean("dq"), mean("tau_J") / self._gains
        self.tau_ext = self.tau - self._gravity_torque(q)
        self.commanded, self.contact = mean("tau_J_d"), self._in_world(mean("O_F_ext_hat_K"))
        self.contact_torque = mean("tau_ext_hat_filtered")
        # Wrench and twist at the mean configuration.
        jacobian = self._nominal.kinematics(q[None]).jacobian
        self.wrench = wrenches(jacobian, self.tau_ext[None, :, None])[0, :, 0]
        self.twist = jacobian[0] @ dq
        # Pose of the TCP: the mean position, and the orientation in the middle of the block.
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

    Raises InputError: they differ by more than `MATCH` or `TURNED`.
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


def black_box(rows: Sequence[CycleRow], why: str) -> Mapping[str, Array] | None:
    """Collect the last cycles at 1 kHz, one row per cycle, for diagnosis; None without any.

    Keys: `t`, `mode`, `SIGNALS`, the commanded pose `target_world_tcp`, the share of commands that
    `arrived`, and the reason `why` the arm stopped.
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


# A connection to a control box and its hand: made within a time limit, monitored, and closed.


CONNECTED = 4.0  # s within which the control box must answer
LET_GO = 0.6  # s to wait for the end of a control loop
# Share of a joint's torque limit that an external torque may reach before the control box stops the
# arm.
TORQUES = 0.9

_abandoned: list[Any] = []  # Objects of franky whose destructors would wait for a lost control box


class FrankySession:
    """franky's robot and gripper at an address.

    Attributes:
        robot, gripper: franky's objects.
        model: the arm's own dynamics.
    """

    def __init__(self, address: Address) -> None:
        """Connect. Raises Unavailable: no answer within `CONNECTED`, or the arm is not ready."""
        require_answer(address)
        module = franky()
        config = module.RealtimeConfig
        realtime = config.Enforce if address.realtime else config.Ignore
        self.address = address
        deadline = time.perf_counter() + CONNECTED
        arm = Call(lambda: module.Robot(address.host, realtime_config=realtime), "palpate arm")
        hand = Call(lambda: module.Gripper(address.host), "palpate hand")
        self.robot: Any = self._make_part(arm, deadline, "arm")
        try:
            self.gripper: Any = self._make_part(hand, deadline, "hand")
        except Unavailable:
            self.abandon()
            raise
        self.model: Any = self.robot.model

    def state(self) -> Any:
        """Return franky's newest state, without blocking on an unresponsive control box.

        Raises Unavailable: there is none.
        """
        try:
            return Call(lambda: self.robot.state, "palpate state").result(CONNECTED)
        except CallTimeout as late:
            self.abandon()
            raise Unavailable(f"the robot at {self.address} sends no states: {late}") from None
        except Exception as error:
            raise Unavailable(
                f"the robot at {self.address}: {control_box.of_error(error)}"
            ) from error

    def set_thresholds(self, widest: Reflex, torque_max: Any) -> None:
        """Set the control box's own collision thresholds: the outermost limit.

        They cannot be changed while a control loop runs.
        """
        force = widest.force + widest.load
        wrench = [force] * 3 + [widest.torque] * 3
        torques = (TORQUES * np.asarray(torque_max)).tolist()
        self.robot.set_collision_behavior(torques, torques, wrench, wrench)

    def recover(self) -> None:
        """Clear the errors that stopped the arm, on a person's order. Raises Unavailable: it is still not ready."""
        with suppress(Exception):
            Call(self.robot.recover_from_errors, "palpate recover").result(CONNECTED)
        if problem := control_box.of_mode(self.state()):
            raise Unavailable(f"the robot at {self.address}: {problem}")

    def close(self, lost: bool = False) -> None:
        """End the control loop without a jerk, and disconnect.

        An arm that does not answer is abandoned, immediately if it is known to be `lost`.
        """
        if lost:
            self.abandon()
            return
        ending = Call(self._end, "palpate end")
        try:
            ending.result(LET_GO)
        except CallTimeout:
            self.abandon()
        except Exception:
            pass

    def abandon(self) -> None:
        """Drop a lost control box, without waiting for it."""
        _abandoned.append((getattr(self, "robot", None), getattr(self, "gripper", None)))

    def _end(self) -> None:
        robot = self.robot
        if robot.is_in_control:
            robot.move(franky().TorqueStopMotion(), asynchronous=True)
        with suppress(Exception):
            robot.join_motion(LET_GO)

    def _make_part(self, call: Call[Any], deadline: float, part: str) -> Any:
        where = f"the {part} at {self.address}"
        try:
            return call.result(max(deadline - time.perf_counter(), 0.01))
        except CallTimeout:
            _abandoned.append(call)
            raise Unavailable(
                f"{where} takes the connection and says nothing within {CONNECTED:g} s: is FCI "
                "activated in Desk, and no other program connected?"
            ) from None
        except Exception as error:
            text = str(error)
            mode = "Reflex" if "Reflex" in text else None
            if mode is None and ("UserStopped" in text or "User stopped" in text):
                mode = "UserStopped"
            if mode is not None:
                reason = f"{control_box.MODES[mode]}: {control_box.REMEDIES[mode]}"
                raise Stopped(
                    f"{where} cannot be used: it is {reason}, or at a terminal, which asks"
                ) from error
            raise Unavailable(f"{where} cannot be used: {connecting(error)}") from error


class Guided:
    """An arm that a person guides by hand: read, never commanded.

    Implements `palpate.execution.cell.GuidedHand`.
    """

    def __init__(self, session: FrankySession, pose_world_base: Pose) -> None:
        self._session, self._base = session, pose_world_base

    def where(self) -> tuple[Pose, float]:
        session = self._session
        try:
            state = Call(lambda: session.robot.state, "palpate state").result(ANSWERS)
            fingers = Call(lambda: session.gripper.state, "palpate fingers").result(ANSWERS)
        except Exception as error:
            raise Unavailable(f"{session.address}: {control_box.of_error(error)}") from error
        return self._base @ pose_of(state.O_T_EE), float(fingers.width)

    def close(self) -> None:
        self._session.close()


def connecting(error: Exception) -> str:
    """Describe the error of a failed connection."""
    kind, text = type(error).__name__, " ".join(str(error).split())
    if kind == "RealtimeException":
        return (
            "this computer has no realtime kernel, or no permission for realtime priority: see "
            "docs/franka.md, or give ?realtime=ignore to try what a robot on loopback can"
        )
    if kind == "IncompatibleVersionException":
        return (
            f"{text}; install the wheel of franky-control that speaks this robot's version of "
            "libfranka (its README lists them)"
        )
    return f"{kind}: {text}"


@atexit.register
def _forget() -> None:
    """Prevent the destructors of abandoned objects from running."""
    for thing in _abandoned:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))
