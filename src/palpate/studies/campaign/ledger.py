"""The rows of a campaign: appended case by case, so that one that was stopped goes on."""

from __future__ import annotations

import json
import signal
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from palpate.studies.harm import Harm

LONGEST = 120
"""s of the processor for one case; beyond, it hangs."""


@dataclass(frozen=True, slots=True)
class Row:
    """One case and how it went.

    Attributes:
        kind: which part of the campaign. case: names it within its kind.
        what: what was done, in words. command: repeats it.
        outcome: in a word. said: what palpate said about it.
        crash: a traceback, where there was one.
        beyond: what it did to the world that is worse than the figures allow.
        touches: forces on everything that was touched: thing, peak, mean10, mean20, tail, sideways.
        figures: anything else, by name.
    """

    kind: str
    case: str
    what: str
    command: str
    outcome: str
    said: tuple[str, ...] = ()
    crash: str = ""
    beyond: tuple[str, ...] = ()
    touches: tuple[dict[str, Any], ...] = ()
    figures: dict[str, Any] = field(default_factory=dict[str, Any])

    @classmethod
    def read(cls, document: dict[str, Any]) -> Row:
        """A row from its line of a file."""
        fields = dict(document)
        for name in ("said", "beyond", "touches"):
            fields[name] = tuple(fields[name])
        return cls(**fields)


TOUCH = ("thing", "part", "load", "peak", "mean10", "mean20", "tail", "over", "sideways")


def touches_of(seen: Harm) -> tuple[dict[str, Any], ...]:
    """The forces of a judgement, as a row keeps them."""
    kept: list[dict[str, Any]] = []
    for touch in seen.touches:
        figures = {name: getattr(touch, name) for name in TOUCH}
        kept.append({n: round(v, 4) if isinstance(v, float) else v for n, v in figures.items()})
    return tuple(kept)


class Overtime(BaseException):
    """A case takes too long. Nothing that catches `Exception` keeps it from ending."""


def within_time(work: Callable[[], Row], otherwise: Row, seconds: int = LONGEST) -> Row:
    """What `work` gives, or `otherwise` with its traceback; for the main thread of a process."""

    def overtime(_signum: int, _frame: FrameType | None) -> None:
        raise Overtime

    previous = signal.signal(signal.SIGPROF, overtime)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        return work()
    except Overtime:
        return _ended(otherwise, "hung", f"not done after {seconds} s")
    except Exception:
        return _ended(otherwise, "crashed", traceback.format_exc(limit=-8))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, previous)


def _ended(row: Row, outcome: str, crash: str) -> Row:
    return Row(row.kind, row.case, row.what, row.command, outcome, crash=crash)


@dataclass(frozen=True, slots=True)
class Ledger:
    """A file of rows, one JSON object a line."""

    file: Path

    def rows(self) -> list[Row]:
        """All so far; a line that was cut off is left out."""
        if not self.file.exists():
            return []
        found: list[Row] = []
        for line in self.file.read_text(encoding="utf-8").splitlines():
            try:
                found.append(Row.read(json.loads(line)))
            except (ValueError, TypeError, KeyError):
                continue
        return found

    def add(self, rows: Iterable[Row]) -> None:
        """Append rows."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        with self.file.open("a", encoding="utf-8") as file:
            for row in rows:
                file.write(json.dumps(asdict(row), ensure_ascii=False) + "\n")

    def complete(
        self,
        cases: Sequence[Any],
        name: Callable[[Any], str],
        work: Callable[[Any], Row],
        workers: int = 1,
        say: Callable[[str], None] = lambda _: None,
    ) -> list[Row]:
        """Do the cases that have no row yet; returns the rows of all of them, in their order.

        `work` and `cases` must be picklable where there is more than one worker.
        """
        done = {row.case: row for row in self.rows()}
        todo = [case for case in cases if name(case) not in done]
        for row in _each(work, todo, workers):
            self.add([row])
            done[row.case] = row
            if row.crash or row.beyond:
                say(f"{row.kind} {row.case}: {row.outcome}; {'; '.join(row.beyond[:3])}")
        return [done[name(case)] for case in cases if name(case) in done]


def _each(work: Callable[[Any], Row], cases: Sequence[Any], workers: int) -> Iterable[Row]:
    if workers == 1 or len(cases) < 2:
        yield from map(work, cases)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from (done.result() for done in as_completed([pool.submit(work, c) for c in cases]))
