"""Many independent trials of planners, several at once, each kept in a file the moment it is done.

A killed study goes on where it was: what is in the file is not asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from itertools import islice, product
from pathlib import Path
from statistics import fmean
from typing import Any

from pydantic import TypeAdapter, ValidationError

from palpate.errors import Unavailable
from palpate.studies.engine.lines import Lines

OUTAGES = 3
"""Trials in a row that find the provider unavailable, after which no further one is begun."""


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """One independent attempt of a planner at a scenario's task.

    Attributes:
        scenario: its name. planner: planner string.
        configuration: what was left out of the prompt, `full` if nothing.
        number: from 0; also the seed of the simulated world's sensors.
    """

    scenario: str
    planner: str
    configuration: str
    number: int


def every_trial(
    scenario: str, planners: Iterable[str], configurations: Iterable[str], number: int
) -> list[Trial]:
    """`number` trials of every configuration with every planner, planner by planner."""
    trials: list[Trial] = []
    for planner, configuration, i in product(planners, configurations, range(number)):
        trials.append(Trial(scenario, planner, configuration, i))
    return trials


@dataclass(frozen=True, slots=True)
class Record:
    """What came of a trial; one line of the results file.

    Attributes:
        syntax: the first answer is a plan that compiles to a behavior tree.
        valid: a plan passed the check.
        success: the executed tree acquired exactly what it should; None where the task defines no
            success.
        reason: why not.
        figures: tokens, cost, latency, the model's name as the provider reports it.
    """

    trial: Trial
    syntax: bool
    valid: bool
    success: bool | None
    reason: str = ""
    figures: dict[str, Any] = field(default_factory=dict[str, Any])

    @property
    def tokens(self) -> int:
        """Tokens of all prompts and answers of the trial."""
        return self.figures.get("input_tokens", 0) + self.figures.get("output_tokens", 0)

    @property
    def cost(self) -> float | None:
        """US dollars; None where an answer has no known price."""
        return self.figures.get("cost_usd")


@dataclass(frozen=True, slots=True)
class Rate:
    """`hits` of `trials` with the 95 % Wilson score interval."""

    hits: int
    trials: int

    @classmethod
    def of(cls, outcomes: Iterable[bool]) -> Rate:
        """How many of the outcomes are hits."""
        listed = list(outcomes)
        return cls(sum(listed), len(listed))

    @property
    def interval(self) -> tuple[float, float]:
        """(low, high) of the rate."""
        from scipy.stats import binomtest

        if self.trials == 0:
            return 0.0, 1.0
        found = binomtest(self.hits, self.trials).proportion_ci(method="wilson")
        return float(found.low), float(found.high)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits}/{self.trials} [{low:.2f}, {high:.2f}]"


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a table: a configuration of the prompt with a model, over its trials."""

    configuration: str
    planner: str
    syntax: Rate
    valid: Rate
    success: Rate | None
    tokens: float
    cost: float | None
    """US dollars of all trials together; None where an answer has no known price."""


def run_trials(
    trials: Sequence[Trial],
    attempt: Callable[[Trial], Record],
    file: Path,
    in_flight: int = 4,
    say: Callable[[str], None] = lambda _: None,
) -> list[Record]:
    """All trials' records, in order: those in `file` as they are, the others by `attempt`, appended
    to it.

    Raises:
        InputError: `file` is not a results file.
        Unavailable: the provider could not be reached; what is done is kept.
    """
    kept = {record.trial: record for record in read_records(file)}
    Lines(file).add()  # what is paid for can be kept
    todo = [trial for trial in trials if trial not in kept]
    done = len(trials) - len(todo)
    say(f"{done} of {len(trials)} trials are done already")
    for record in _attempted(todo, attempt, in_flight):
        Lines(file).add(asdict(record))
        kept[record.trial] = record
        done += 1
        say(f"{done} of {len(trials)}: {_told(record)}")
    return [kept[trial] for trial in trials]


def read_records(file: Path) -> list[Record]:
    """The records in a results file, none when there is no file.

    Raises:
        InputError: it is another file.
    """
    lines = Lines(file)
    record = TypeAdapter(Record)
    try:
        return [record.validate_python(line) for line in lines.read()]
    except ValidationError:
        raise lines.other() from None


def table(records: Iterable[Record]) -> list[Row]:
    """One row for each configuration and planner, in order of first appearance."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record.trial.configuration, record.trial.planner), []).append(record)
    return [_row(*key, group) for key, group in groups.items()]


def _row(configuration: str, planner: str, records: Sequence[Record]) -> Row:
    judged = [r.success for r in records if r.success is not None]
    return Row(
        configuration,
        planner,
        Rate.of(r.syntax for r in records),
        Rate.of(r.valid for r in records),
        Rate.of(judged) if judged else None,
        fmean(r.tokens for r in records),
        _cost(records),
    )


def _cost(records: Iterable[Record]) -> float | None:
    total = 0.0
    for record in records:
        if record.cost is None:
            return None
        total += record.cost
    return total


def _attempted(
    trials: Sequence[Trial], attempt: Callable[[Trial], Record], in_flight: int
) -> Iterator[Record]:
    """Records as they come, at most `in_flight` trials at a time; ends early when the provider
    stays out."""
    waiting = iter(trials)
    outage: Unavailable | None = None
    in_a_row = 0
    with ThreadPoolExecutor(in_flight) as pool:
        running = {pool.submit(attempt, trial) for trial in islice(waiting, in_flight)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                try:
                    yield future.result()
                    in_a_row = 0
                except Unavailable as error:
                    outage, in_a_row = error, in_a_row + 1
            # As many begin as have ended, so that no more than `in_flight` are under way.
            if in_a_row < OUTAGES:
                running |= {pool.submit(attempt, trial) for trial in islice(waiting, len(done))}
    if outage is not None:
        raise Unavailable(f"{outage} — the finished trials are kept; run the study again to go on")


def _told(record: Record) -> str:
    """A record in one line."""
    trial = record.trial
    syntax = "syntax valid" if record.syntax else "syntax not valid"
    return (
        f"{trial.configuration}, {trial.planner}, trial {trial.number}: {syntax}, {_ended(record)}"
    )


def _ended(record: Record) -> str:
    if record.success is None:
        return "not judged"
    if record.success:
        return "success"
    return f"no success ({record.reason})"
