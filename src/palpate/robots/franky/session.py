"""A connection to a control box and its hand: made within a deadline, watched, and let go."""

from __future__ import annotations

import atexit
import time
from contextlib import suppress
from typing import Any

import numpy as np

from palpate.errors import Stopped, Unavailable
from palpate.robots.franky import faults
from palpate.robots.franky.address import Address
from palpate.robots.franky.library import Call, Late, franky
from palpate.robots.franky.preflight import require_answer
from palpate.robots.reflex import Reflex

CONNECTED = 4.0
"""s within which the control box must have answered."""
LET_GO = 0.6
"""s that the end of a control loop is waited for."""
TORQUES = 0.9
"""Part of a joint's torque limit that it may feel from outside before the control box stops it."""

_abandoned: list[Any] = []
"""Objects of franky whose destructors would wait for a control box that is gone."""


class Session:
    """franky's robot and gripper at an address.

    Attributes:
        robot, gripper: franky's.
        model: the arm's own dynamics.
    """

    def __init__(self, address: Address) -> None:
        """Connect.

        Raises:
            Unavailable: nobody answers within `CONNECTED`, or the arm is not ready.
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
        """franky's newest state, without waiting for a mute control box.

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
        """At what the control box itself stops the arm, whatever it does: the outermost wall, as
        thresholds cannot be changed while a control loop runs."""
        force = widest.force + widest.load
        wrench = [force] * 3 + [widest.torque] * 3
        torques = (TORQUES * np.asarray(torque_max)).tolist()
        self.robot.set_collision_behavior(torques, torques, wrench, wrench)

    def recover(self) -> None:
        """Clear the errors that stopped the arm, because a person says so.

        Raises:
            Unavailable: it is not ready all the same.
        """
        with suppress(Exception):
            Call(self.robot.recover_from_errors, "palpate recover").result(CONNECTED)
        if problem := faults.of_mode(self.state()):
            raise Unavailable(f"the robot at {self.address}: {problem}")

    def close(self, lost: bool = False) -> None:
        """End the control loop without a jerk, and let go; an arm that does not answer is left
        alone, at once where it is known to be `lost`."""
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
        """Forget a control box that is gone, without waiting for it."""
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
            if (mode := stopped_in(error)) is not None:
                reason = f"{faults.MODES[mode]}: {faults.REMEDIES[mode]}"
                raise Stopped(
                    f"{where} cannot be used: it is {reason}, or at a terminal, which asks"
                ) from error
            raise Unavailable(f"{where} cannot be used: {connecting(error)}") from error


def stopped_in(error: Exception) -> str | None:
    """The mode of an arm that was stopped, where that is why it refuses a connection."""
    text = str(error)
    if "Reflex" in text:
        return "Reflex"
    if "UserStopped" in text or "User stopped" in text:
        return "UserStopped"
    return None


def connecting(error: Exception) -> str:
    """Word the error of a connection that was not made."""
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
    """Destructors of what was abandoned never run."""
    for thing in _abandoned:
        _immortal(thing)


def _immortal(thing: Any) -> None:
    import ctypes

    ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))
