"""A connection to a control box and its hand: made within a time limit, watched, and closed."""

from __future__ import annotations

import atexit
import ctypes
import time
from contextlib import suppress
from typing import Any

import numpy as np

from palpate.errors import Stopped, Unavailable
from palpate.geometry.pose import Pose
from palpate.robots.franky import faults
from palpate.robots.franky.control_box import Address, require_answer
from palpate.robots.franky.library import Call, Late, franky
from palpate.robots.franky.readout import pose_of
from palpate.robots.reflex import Reflex

CONNECTED = 4.0  # s within which the control box must answer
LET_GO = 0.6  # s to wait for the end of a control loop
ANSWERS = 2.0  # s within which a guided arm and its hand report their pose
TORQUES = 0.9
"""Share of a joint's torque limit that an external torque may reach before the control box stops the
arm."""

_abandoned: list[Any] = []
"""Objects of franky whose destructors would wait for a control box that is lost."""


class Session:
    """franky's robot and gripper at an address.

    Attributes:
        robot, gripper: franky's.
        model: the arm's own dynamics.
    """

    def __init__(self, address: Address) -> None:
        """Connect.

        Raises:
            Unavailable: no answer within `CONNECTED`, or the arm is not ready.
        """
        require_answer(address)
        module = franky()
        config = module.RealtimeConfig
        realtime = config.Enforce if address.realtime else config.Ignore
        self.address = address
        deadline = time.perf_counter() + CONNECTED
        arm = Call(lambda: module.Robot(address.host, realtime_config=realtime), "palpate arm")
        hand = Call(lambda: module.Gripper(address.host), "palpate hand")
        self.robot: Any = self._made(arm, deadline, "arm")
        try:
            self.gripper: Any = self._made(hand, deadline, "hand")
        except Unavailable:
            self.abandon()
            raise
        self.model: Any = self.robot.model

    def state(self) -> Any:
        """Return franky's newest state, without blocking on a mute control box.

        Raises:
            Unavailable: there is none.
        """
        try:
            return Call(lambda: self.robot.state, "palpate state").result(CONNECTED)
        except Late as late:
            self.abandon()
            raise Unavailable(f"the robot at {self.address} sends no states: {late}") from None
        except Exception as error:
            raise Unavailable(f"the robot at {self.address}: {faults.of_error(error)}") from error

    def set_thresholds(self, widest: Reflex, torque_max: Any) -> None:
        """Set the control box's own collision thresholds: the outermost limit, as they cannot be
        changed while a control loop runs."""
        force = widest.force + widest.load
        wrench = [force] * 3 + [widest.torque] * 3
        torques = (TORQUES * np.asarray(torque_max)).tolist()
        self.robot.set_collision_behavior(torques, torques, wrench, wrench)

    def recover(self) -> None:
        """Clear the errors that stopped the arm, on a person's order.

        Raises:
            Unavailable: it is still not ready.
        """
        with suppress(Exception):
            Call(self.robot.recover_from_errors, "palpate recover").result(CONNECTED)
        if problem := faults.of_mode(self.state()):
            raise Unavailable(f"the robot at {self.address}: {problem}")

    def close(self, lost: bool = False) -> None:
        """End the control loop without a jerk, and disconnect; an arm that does not answer is
        abandoned, immediately where it is known to be `lost`."""
        if lost:
            self.abandon()
            return
        ending = Call(self._end, "palpate end")
        try:
            ending.result(LET_GO)
        except Late:
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

    def _made(self, call: Call[Any], deadline: float, part: str) -> Any:
        where = f"the {part} at {self.address}"
        try:
            return call.result(max(deadline - time.perf_counter(), 0.01))
        except Late:
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
                reason = f"{faults.MODES[mode]}: {faults.REMEDIES[mode]}"
                raise Stopped(
                    f"{where} cannot be used: it is {reason}, or at a terminal, which asks"
                ) from error
            raise Unavailable(f"{where} cannot be used: {connecting(error)}") from error


class Guided:
    """An arm that a person guides by hand: read, never commanded. Implements
    `palpate.cells.teach.GuidedHand`."""

    def __init__(self, session: Session, pose_world_base: Pose) -> None:
        self._session, self._base = session, pose_world_base

    def where(self) -> tuple[Pose, float]:
        session = self._session
        try:
            state = Call(lambda: session.robot.state, "palpate state").result(ANSWERS)
            fingers = Call(lambda: session.gripper.state, "palpate fingers").result(ANSWERS)
        except Exception as error:
            raise Unavailable(f"{session.address}: {faults.of_error(error)}") from error
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
    """Keep the destructors of abandoned objects from running."""
    for thing in _abandoned:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))
