"""Messages for franky's exceptions and the modes of a control box, each with a remedy."""

from __future__ import annotations

from typing import Any

MODES = {  # the control box's own modes, in words
    "Other": "not ready (brakes closed, or another mode in Desk)",
    "Idle": "ready",
    "Move": "moving",
    "Guiding": "guided by hand",
    "Reflex": "stopped by a reflex",
    "UserStopped": "stopped by the user stop",
    "AutomaticErrorRecovery": "recovering",
}
REMEDIES = {  # all by a person: no program restarts an arm that stopped
    "UserStopped": "release the user stop, see that nothing is held or in the way, and run again",
    "Reflex": "see what it met, clear the error in Desk, and run again",
    "Guiding": "take the hands off the guiding button, and run again",
    "Other": "open the brakes and activate FCI in Desk, and run again",
}


def mode_of(state: Any) -> str:
    """Return the name of the control box's mode."""
    return str(state.robot_mode.name)


def errors_of(state: Any) -> list[str]:
    """List the errors that are set, by libfranka's names."""
    errors = state.current_errors
    return [
        name for name in dir(errors) if not name.startswith("_") and getattr(errors, name) is True
    ]


def of_mode(state: Any) -> str | None:
    """Return the reason that an arm in this mode cannot move; None if it can."""
    mode = mode_of(state)
    if mode in ("Idle", "Move"):
        return None
    return f"the arm is {MODES.get(mode, mode)}: {REMEDIES.get(mode, 'look at Desk')}"


def of_error(error: BaseException, mode: str | None = None) -> str:
    """Describe the error of a motion."""
    text = " ".join(str(error).split())
    lowered = text.lower()
    if "user stop" in lowered or mode == "UserStopped":
        return f"the user stop was pressed: {REMEDIES['UserStopped']}"
    if is_network(error):
        return "the connection to the control box is lost: look at the network cable and at Desk"
    if "reflex" in lowered or mode == "Reflex":
        return f"the arm stopped itself ({text}): {REMEDIES['Reflex']}"
    if "communication_constraints" in lowered:
        return (
            "too many of the control box's cycles got no answer in time: use a realtime kernel, and a "
            f"network card and cable of its own ({text})"
        )
    return f"{type(error).__name__}: {text}"


def is_network(error: BaseException) -> bool:
    """Test for a lost connection, which franky reports in several ways."""
    text = str(error).lower()
    return "net exception" in text or "udp" in text or type(error).__name__ == "NetworkException"
