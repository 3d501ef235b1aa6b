"""Estimates of objects that the arm is done with, made while it handles the next."""

from __future__ import annotations

import os
from collections.abc import Collection, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from palpate.beside import Beside, can_copy
from palpate.cells.cell import Cell
from palpate.runs.run import Run
from palpate.stages.estimating import Judged, judged
from palpate.trace.around import reach

if TYPE_CHECKING:
    from palpate.stages.replaying import Given
    from palpate.vocabulary.base import Recorder


class Ahead:
    """Estimates made by copies of this process, on processors that are idle while a simulated arm moves.

    They are the same as those made at the end: whoever uses them compares the evidence (`Judged.key`).
    """

    def __init__(self, made: Run, beside: Beside[Given] | None) -> None:
        """Begin without any; `beside` is a copy that is at work already."""
        self._made, self._beside = made, beside
        of_objects = (one.object for one in made.plan.parameters)
        self._due = [name for name in dict.fromkeys(of_objects) if name in made.scene.objects]
        self._copies: dict[str, Beside[Judged | None]] = {}
        self._leaves = 0

    @property
    def begun(self) -> Collection[str]:
        """Objects whose estimates are made, or in the making."""
        return self._copies.keys()

    def look(self, recorder: Recorder) -> None:
        """After a leaf has ended, begin with an object whose evidence is complete. A further attempt has a
        recorder of its own: its evidence is only a part, and no estimate is begun."""
        if len(recorder.leaves) < self._leaves:
            self._due.clear()
        if len(recorder.leaves) == self._leaves or not self._due:
            return
        self._leaves = len(recorder.leaves)
        now = recorder.leaves[-1].end
        for name in self._due:
            reached = reach(recorder, name)
            if reached is not None and reached[1] < now and self._is_idle():
                self._due.remove(name)
                sofar = replace(self._made, recorded=recorder.snapshot())
                with suppress(OSError):  # no process to be had
                    self._copies[name] = Beside(partial(_tried, sofar, name))
                return

    def results(self) -> Mapping[str, Judged]:
        """Wait for what was begun, by object."""
        found = {name: copy.result() for name, copy in self._copies.items()}
        return {name: one for name, one in found.items() if one is not None}

    def _is_idle(self) -> bool:
        """Test for a processor beside that of the execution which no copy uses."""
        working = sum(copy.running for copy in (*self._copies.values(), self._beside) if copy)
        return can_copy() and working < len(os.sched_getaffinity(0)) - 1

    def close(self) -> None:
        """Give up what was not asked for."""
        for copy in self._copies.values():
            copy.close()


@contextmanager
def ahead_of(made: Run, cell: Cell, beside: Beside[Given] | None) -> Generator[Ahead | None]:
    """Yield the estimates to be made while a simulated arm moves; None beside a real one, which needs the
    processor. `beside`: a copy that is at work already."""
    if not cell.simulated:
        yield None
        return
    ahead = Ahead(made, beside)
    try:
        yield ahead
    finally:
        ahead.close()


def _tried(made: Run, name: str) -> Judged | None:
    """Estimates of an object; None where they fail, so that they are made, and fail, at the end."""
    try:
        return judged(made, name)
    except Exception:
        return None
