"""The campaign engine: cases, their rows, and a file of rows that a later run continues."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, Protocol, TypeVar

import numpy as np

from bench.harm.judge import Harm
from bench.harm.probe import Probed
from palpate.studies.workers import Lines, Processes, WorkerLost

LONGEST = 120
"""s of processor time after which a case counts as hung."""


class Case(Protocol):
    """A case, with a name that is unique within its kind."""

    @property
    def name(self) -> str: ...

    def blank(self) -> Row:
        """Its row before it is executed."""
        ...


AnyCase = TypeVar("AnyCase", bound=Case)


@dataclass(frozen=True, slots=True)
class Row:
    """Result of a case.

    Attributes:
        kind: of the case.
        case: its name.
        what: description.
        command: repeats it.
        outcome: in a word.
        said: messages of palpate.
        crash: a traceback.
        beyond: what exceeds the limits, in words.
        touches: contact forces: thing, peak, mean10, mean20, tail, sideways.
        figures: anything else, by name.
    """

    kind: str
    case: str
    what: str
    command: str
    outcome: str = ""
    said: tuple[str, ...] = ()
    crash: str = ""
    beyond: tuple[str, ...] = ()
    touches: tuple[dict[str, Any], ...] = ()
    figures: dict[str, Any] = field(default_factory=dict[str, Any])

    @classmethod
    def named(cls, kind: str, case: str, what: str) -> Row:
        """Blank row of a case with a name of its own."""
        return cls(kind, case, what, f"python -m bench faults --kind {kind} --case '{case}'")


@dataclass(frozen=True, slots=True)
class Drawn:
    """A random case, identified by seed and number."""

    kind: str
    seed: int
    number: int

    @property
    def name(self) -> str:
        return f"{self.seed}/{self.number}"

    @property
    def command(self) -> str:
        """Command line that repeats it."""
        return f"python -m bench faults --kind {self.kind} --seed {self.seed} --case {self.number}"

    def random(self, *stream: int) -> np.random.Generator:
        """Generator of the case, always the same; independent ones for each `stream`."""
        return np.random.default_rng([self.seed, self.number, *stream])

    def blank(self) -> Row:
        return Row(self.kind, self.name, "", self.command)


def drawn(kind: str, seed: int, count: int) -> list[Drawn]:
    """The first `count` cases of a seed."""
    return [Drawn(kind, seed, number) for number in range(count)]


TOUCH = ("thing", "part", "load", "peak", "mean10", "mean20", "tail", "over", "sideways")


def touches_of(seen: Harm) -> tuple[dict[str, Any], ...]:
    """The contact forces of a judgement, rounded, as a row holds them."""
    kept: list[dict[str, Any]] = []
    for touch in seen.touches:
        figures = {name: getattr(touch, name) for name in TOUCH}
        kept.append({n: round(v, 4) if isinstance(v, float) else v for n, v in figures.items()})
    return tuple(kept)


def judged_run(blank: Row, seen: Probed) -> Row:
    """Row of an executed plan: end of the run, and harm."""
    done = seen.execution
    return replace(
        blank,
        outcome=done.status,
        said=(done.stopped_by,) if done.stopped_by else (),
        beyond=seen.harm.beyond,
        touches=touches_of(seen.harm),
        figures={"robot_seconds": round(done.robot_seconds, 2)},
    )


class Overtime(BaseException):
    """A case takes too long; not an `Exception`, so that no handler of palpate's swallows it."""


def judged(case: AnyCase, work: Callable[[AnyCase, Row], Row]) -> Row:
    """Execute a case by `work`, which fills its blank row; a failure or overtime is a row, too. Only
    in the main thread of a process, which receives the timer's signal."""
    blank = case.blank()

    def overtime(_signum: int, _frame: FrameType | None) -> None:
        raise Overtime

    previous = signal.signal(signal.SIGPROF, overtime)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        return work(case, blank)
    except Overtime:
        return replace(blank, outcome="hung", crash=f"not done after {LONGEST} s")
    except Exception:
        return replace(blank, outcome="crashed", crash=traceback.format_exc(limit=-8))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, previous)


@dataclass(frozen=True, slots=True)
class Ledger:
    """A file of rows, one a line."""

    file: Path

    def rows(self) -> list[Row]:
        """Read all rows.

        Raises:
            InputError: the file holds something else.
        """
        return Lines(self.file).read_as(Row)

    def complete(
        self,
        cases: Sequence[AnyCase],
        work: Callable[[AnyCase, Row], Row],
        workers: int = 1,
        say: Callable[[str], None] = lambda _: None,
    ) -> list[Row]:
        """Execute the cases that have no row yet; return the rows of all of them, in their order.

        `work` and `cases` must be picklable if there are several workers.

        Raises:
            Lost: the process that executed a case ended.
        """
        done = {row.case: row for row in self.rows()}
        names = [case.blank().case for case in cases]
        todo = [case for case, name in zip(cases, names, strict=True) if name not in done]
        for _, row in Processes(workers).each(partial(judged, work=work), todo):
            if isinstance(row, WorkerLost):
                raise row
            Lines(self.file).add(asdict(row))
            done[row.case] = row
            if row.crash or row.beyond:
                say(f"{row.kind} {row.case}: {row.outcome}; {'; '.join(row.beyond[:3])}")
        return [done[name] for name in names]
