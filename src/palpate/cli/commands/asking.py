"""Whom the commands ask before a real robot moves, or goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.callbacks import Confirm, Progress
    from palpate.runs.run import Run


def unless(yes: bool, ask: Confirm) -> Confirm:
    """Asks whether a robot may move, unless everything was agreed to beforehand (`--yes`)."""

    def may_move(run: Run) -> bool:
        return yes or ask(run)

    return may_move


def resuming(say: Progress) -> Callable[[str], bool]:
    """Asks whether a robot that was stopped may go on; whoever draws the run is told first."""
    from palpate.cli.show.run import confirm_resuming

    def may_resume(why: str) -> bool:
        say("the robot was stopped")
        return confirm_resuming(why)

    return may_resume
