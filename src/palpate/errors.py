"""Every error palpate raises on purpose, each with the exit status the command line gives it.

A message names the thing, lists the valid choices where there are any, and says what to do.
"""

from __future__ import annotations

from collections.abc import Iterable


class PalpateError(Exception):
    """Base of the tree. `exit_code` is the process exit status (see the command line reference)."""

    exit_code: int = 1


class InputError(PalpateError):
    """The user's files, names or options are not usable (exit 2)."""

    exit_code = 2


class PlanRejected(PalpateError):
    """No plan exists for the request, or none passed the check (exit 3). The text is the
    explanation."""

    exit_code = 3


class ExecutionAborted(PalpateError):
    """The robot stopped safely before the plan was finished (exit 4)."""

    exit_code = 4


class Unavailable(PalpateError):
    """A planner's provider, or a robot, could not be reached or used (exit 5)."""

    exit_code = 5


def unknown_name(kind: str, name: str, valid: Iterable[str], hint: str = "") -> InputError:
    """An `InputError` that names what is unknown and lists the valid choices."""
    choices = ", ".join(sorted(valid)) or "none"
    tail = f" {hint}" if hint else ""
    return InputError(f"unknown {kind} '{name[:80]}'; valid: {choices}.{tail}")
