"""Callbacks of a run: progress and confirmation, passed on from stage to stage."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

from palpate.execution.recovery import Resume, nobody

if TYPE_CHECKING:
    from palpate.execution.runner import Observer
    from palpate.runs.run import Run

T = TypeVar("T")
Progress = Callable[[str], None]
"""Told which stage begins."""
Confirm = Callable[["Run"], bool]
"""Shown a plan before a real robot moves; whether it may."""
Measured = Callable[["Run"], None]
"""Shown the run as soon as its values are final, before twin, film and report."""


def quiet(_: str) -> None:
    """Tell nobody which stage begins."""


def unasked(_: Run) -> bool:
    """Let the robot move without asking anybody."""
    return True


def unheard(_: Run) -> None:
    """Show the values to nobody before all is done."""


@dataclass(frozen=True, slots=True)
class Audience:
    """Whom a run tells how far it is, and whom it asks before it goes on; by default nobody.

    Attributes:
        observer: watches every tick of the execution.
        progress: told which stage begins.
        may_move: shown the run before a real robot moves; whether it may.
        may_resume: told what stopped a real robot; whether it may go on.
        measured: shown the run as soon as its values are final.
    """

    observer: Observer | None = None
    progress: Progress = quiet
    may_move: Confirm = unasked
    may_resume: Resume = nobody
    measured: Measured = unheard

    def unfailing(self) -> Audience:
        """The same, but who is only told may fail, e.g. on a terminal that is gone: no stage does."""
        return replace(self, progress=_unfailing(self.progress), measured=_unfailing(self.measured))


SILENT = Audience()
"""Nobody hears of the run, and nobody is asked."""


def _unfailing(tell: Callable[[T], None]) -> Callable[[T], None]:
    def told(what: T) -> None:
        # Printing to a closed pipe may raise SystemExit (rich does).
        with suppress(Exception, SystemExit):
            tell(what)

    return told
