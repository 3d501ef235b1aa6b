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
from palpate.option import declared
from palpate.settings import Settings

EXIT = {"complete": 0, "failed": 1, "rejected": 3, "aborted": 4, "running": 4}
"""Exit status of a run, by its status."""

ERRORS: dict[type[PalpateError], int] = {
    InputError: 2,
    PlanRejected: 3,
    ExecutionAborted: 4,
    Unavailable: 5,
}

_FLAGS = {option.field.name: option.flags[-1] for option in declared(Settings)}
# Of the commands that read recordings.
_FLAGS.update({name: f"--{name}" for name in ("columns", "loaded", "empty", "hand")})
_ARGUMENT = re.compile(rf"\b({'|'.join(_FLAGS)})=(?=[\s\w,:.*]|$)")


def exit_status(error: PalpateError) -> int:
    """The process's exit status for an error."""
    found = [status for kind, status in ERRORS.items() if isinstance(error, kind)]
    return found[0] if found else 1


def in_flags(message: str) -> str:
    """Rewrite the library's `scene=D.xml` as `--scene D.xml`, and `scene=` alone as `--scene`."""

    def flag(found: re.Match[str]) -> str:
        value_follows = message[found.end() : found.end() + 1] not in " ,:."
        return _FLAGS[found.group(1)] + " " * value_follows

    return _ARGUMENT.sub(flag, message)
