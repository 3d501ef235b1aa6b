"""Callbacks of a run: progress and confirmation."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

from palpate.execution.recovery import Resume, nobody
from palpate.runs.run import Run

if TYPE_CHECKING:
    from palpate.execution.runner import Observer
    from palpate.perception.look import Seen


T = TypeVar("T")
Progress = Callable[[str], None]  # Called with the name of the stage that begins
# Called with a plan before a real robot moves; True allows the motion.
Confirm = Callable[["Run"], bool]
ShowRun = Callable[["Run"], None]  # Called with the grown run


def ignore(_: object) -> None:
    """Ignore a call that only shows."""


def allow(_: object) -> bool:
    """Answer every question with yes."""
    return True


def refuse(_: object) -> bool:
    """Answer every question with no."""
    return False


@dataclass(frozen=True, slots=True)
class RunCallbacks:
    """Callbacks of a run: progress and confirmation. By default nothing is shown or asked."""

    observer: Observer | None = None  # called at every tick of the execution
    progress: Progress = ignore  # called with the name of the stage that begins
    # Called with the run before a real robot moves; True allows the motion.
    may_move: Confirm = allow
    # Called with a run whose plan is a proposal; True measures the proposed parameters.
    may_measure: Confirm = refuse
    # Called with the reason why a real robot stopped; True lets it continue.
    may_resume: Resume = nobody
    # Called with the run when its values are final, before twin, film and report.
    measured: ShowRun = ignore
    # Called with the run before its plan for a real robot is rehearsed, to be read meanwhile.
    planned: ShowRun = ignore
    # Called with the result of a look before the plan; True uses it.
    looked: Callable[[Seen], bool] = allow

    def unfailing(self) -> RunCallbacks:
        """Return the same callbacks; those that only show ignore failures, e.g. of a closed terminal."""
        return replace(
            self,
            progress=_unfailing(self.progress),
            measured=_unfailing(self.measured),
            planned=_unfailing(self.planned),
        )


SILENT = RunCallbacks()  # Callbacks that show nothing and ask nothing


def _unfailing(tell: Callable[[T], None]) -> Callable[[T], None]:
    def call(message: T) -> None:
        # Printing to a closed pipe may raise SystemExit (rich does).
        with suppress(Exception, SystemExit):
            tell(message)

    return call
