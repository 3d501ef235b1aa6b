"""All exceptions that palpate raises deliberately.

    PalpateError
    ├── InputError          the caller's files, names or arguments are not usable
    ├── PlanRejected        no plan exists for the request, or none passed the check
    ├── ExecutionAborted    the robot stopped, or was not allowed to move
    └── Unavailable         a planner's provider, or a robot, is out of reach
        └── Stopped         a robot was stopped, and a person has to release it

A message names the cause, lists the valid choices where there are any, and states the remedy. It names
arguments as in Python, `scene=D.xml`; the command line converts them to flags.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class PalpateError(Exception):
    """Base class of palpate's exceptions."""


class InputError(PalpateError):
    """The caller's files, names or arguments are not usable."""


class ExecutionAborted(PalpateError):
    """The robot stopped before the plan was finished, or was not allowed to move."""


class Unavailable(PalpateError):
    """A planner's provider, or a robot, could not be reached or used."""


class Stopped(Unavailable):
    """A robot was stopped: a person has to remove the reason, and release it."""


def unknown_name(
    kind: str, name: str, valid: Iterable[str], hint: str = "", intended: str | None = None
) -> InputError:
    """Make an `InputError` for an unknown name, with the probable choice and the valid ones.

    The probable choice is `intended`, else a name with similar spelling.
    """
    # Assemble the message: the unknown name, a guess, the valid names, a hint.
    names = sorted(valid)
    choices = ", ".join(names) or "none"
    tail = f" {hint}" if hint else ""
    guess = f" did you mean '{intended}'?" if intended else perhaps(name, names)
    unknown = f"unknown {kind} '{name[:80]}';{guess}"
    return InputError(f"{unknown} valid: {choices}.{tail}")


def perhaps(name: str, names: Iterable[str]) -> str:
    """Return ` did you mean 'bottle'?` if `name` is nearly one of `names`, or the part after its last slash;
    else an empty string.
    """
    # Compare in lower case, by the whole name and by its last part.
    by_letters: dict[str, str] = {}
    for known in names:
        by_letters.setdefault(known.lower().rpartition("/")[2], known)
        by_letters[known.lower()] = known
    near = get_close_matches(name[:80].lower(), by_letters, n=1, cutoff=0.6)
    return f" did you mean '{by_letters[near[0]]}'?" if near else ""
