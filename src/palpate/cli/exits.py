"""Exit statuses of the command line, and flags for arguments."""

from __future__ import annotations

import re

from palpate.errors import (
    ExecutionAborted,
    InputError,
    PalpateError,
    PlanRejected,
    Unavailable,
)

EXIT = {"complete": 0, "failed": 1, "rejected": 3, "aborted": 4, "running": 4}
"""Of a run, by its status."""

ERRORS: dict[type[PalpateError], int] = {
    InputError: 2,
    PlanRejected: 3,
    ExecutionAborted: 4,
    Unavailable: 5,
}

FLAGS = {"request": "-r", "images": "--image"}
"""Flags that differ from the argument's name."""

_ARGUMENT = re.compile(
    r"\b(request|scene|root|poses|images|world|robot|robot_config|arm|planner|noise|seed|out|base_url|remeasure|within|robot_body|twin)="
    r"(?=[\s\w,:.]|$)"
)


def exit_status(error: PalpateError) -> int:
    """The process's exit status for an error."""
    found = [status for kind, status in ERRORS.items() if isinstance(error, kind)]
    return found[0] if found else 1


def in_flags(message: str) -> str:
    """A message of the library, which writes arguments as `scene=D.xml`, as `--scene D.xml`."""

    def flag(found: re.Match[str]) -> str:
        name = found.group(1)
        return FLAGS.get(name, "--" + name.replace("_", "-")) + _gap(message, found.end())

    return _ARGUMENT.sub(flag, message)


def _gap(message: str, end: int) -> str:
    """A space before a value; none where the argument is named alone."""
    return " " if message[end : end + 1].isalnum() else ""
