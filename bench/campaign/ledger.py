"""The cases of a campaign and their rows: appended case by case, so that one that was stopped goes
on."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any, Protocol, TypeVar

import numpy as np

from bench.harm.harm import Harm
from bench.harm.probe import Probed
from palpate.studies.lines import Lines
from palpate.studies.workers import Lost, Processes

LONGEST = 120
"""s of the processor for one case; beyond, it hangs."""


class Case(Protocol):
    """What is done once; its name is its own within its kind."""

    @property
    def name(self) -> str: ...


AnyCase = TypeVar("AnyCase", bound=Case)


@dataclass(frozen=True, slots=True)
class Drawn:
    """A case that is drawn at random: which one, from a seed."""

    kind: str
    seed: int
    number: int

    @property
    def name(self) -> str:
        return f"{self.seed}/{self.number}"

    @property
    def command(self) -> str:
        """What repeats it."""
        return f"python -m bench faults --kind {self.kind} --seed {self.seed} --case {self.number}"

    def random(self, *stream: int) -> np.random.Generator:
        """The same numbers every time; others for another `stream`."""
        return np.random.default_rng([self.seed, self.number, *stream])

    def blank(self, what: str = "") -> Row:
        """Its row before anything is known."""
        return Row(self.kind, self.name, what, self.command, "")


def drawn(kind: str, seed: int, count: int) -> list[Drawn]:
    """The first `count` cases of a seed."""
    return [Drawn(kind, seed, number) for number in range(count)]


@dataclass(frozen=True, slots=True)
class Row:
    """One case and how it went.

    Attributes:
        kind: which part of the campaign.
        case: names it within its kind.
        what: what was done, in words.
        command: repeats it.
        outcome: in a word.
        said: what palpate said about it.
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
    def named(cls, kind: str, case: str, what: str) -> Row:
        """The row of a case that has a name, before anything is known."""
        return cls(kind, case, what, f"python -m bench faults --kind {kind} --case '{case}'", "")

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


def judged_run(blank: Row, seen: Probed) -> Row:
    """The row of a plan that was executed: how it ended, and what it did."""
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
        return replace(otherwise, outcome="hung", crash=f"not done after {seconds} s")
    except Exception:
        return replace(otherwise, outcome="crashed", crash=traceback.format_exc(limit=-8))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, previous)


@dataclass(frozen=True, slots=True)
class Ledger:
    """A file of rows, one a line."""

    file: Path

    def rows(self) -> list[Row]:
        """All so far.

        Raises:
            InputError: it is another file.
        """
        lines = Lines(self.file)
        try:
            return [Row.read(line) for line in lines.read()]
        except (TypeError, KeyError):
            raise lines.other() from None

    def complete(
        self,
        cases: Sequence[AnyCase],
        work: Callable[[AnyCase], Row],
        workers: int = 1,
        say: Callable[[str], None] = lambda _: None,
    ) -> list[Row]:
        """Do the cases that have no row yet; returns the rows of all of them, in their order.

        `work` and `cases` must be picklable where there is more than one worker.

        Raises:
            Lost: a case took its process with it.
        """
        done = {row.case: row for row in self.rows()}
        todo = [case for case in cases if case.name not in done]
        for _, row in Processes(workers).each(work, todo):
            if isinstance(row, Lost):
                raise row
            Lines(self.file).add(asdict(row))
            done[row.case] = row
            if row.crash or row.beyond:
                say(f"{row.kind} {row.case}: {row.outcome}; {'; '.join(row.beyond[:3])}")
        return [done[case.name] for case in cases]
