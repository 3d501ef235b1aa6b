"""Many independent trials of planners, several at once, each kept in a file the moment it is done.

A killed study goes on where it was: what is in the file is not asked again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from itertools import islice
from math import sqrt
from pathlib import Path
from statistics import NormalDist
from typing import Any

from pydantic import TypeAdapter, ValidationError

from palpate.errors import InputError, Unavailable

OUTAGES = 3
"""Trials in a row that find the provider unavailable, after which no further one is begun."""


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """One independent attempt of a planner at a scenario's task.

    Attributes:
        scenario: its name. planner: planner string. configuration: what was left out of the prompt,
            `full` if nothing.
        number: from 0; also the seed of the simulated world's sensors.
    """

    scenario: str
    planner: str
    configuration: str
    number: int


@dataclass(frozen=True, slots=True)
class Record:
    """What came of a trial; one line of the results file.

    Attributes:
        syntax: the first answer is a plan that compiles to a behavior tree. valid: a plan passed
            the check.
        success: the executed tree acquired exactly what it should; None where the task defines no
            success.
        reason: why not. figures: tokens, cost, latency, the model's name as the provider reports
            it.
    """

    trial: Trial
    syntax: bool
    valid: bool
    success: bool | None
    reason: str = ""
    figures: dict[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True, slots=True)
class Rate:
    """`hits` of `trials` with the 95 % Wilson score interval."""

    hits: int
    trials: int

    @property
    def interval(self) -> tuple[float, float]:
        """(low, high) of the rate."""
        if self.trials == 0:
            return 0.0, 1.0
        n, rate, z = self.trials, self.hits / self.trials, NormalDist().inv_cdf(0.975)
        centre, half = rate + z * z / (2 * n), z * sqrt(rate * (1 - rate) / n + (z / (2 * n)) ** 2)
        scale = 1 + z * z / n
        return max(0.0, (centre - half) / scale), min(1.0, (centre + half) / scale)

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
        InputError: `file` is not a results file. Unavailable: the provider was; what is done is
            kept.
    """
    kept = {record.trial: record for record in read_records(file)}
    todo = [trial for trial in trials if trial not in kept]
    say(f"{len(trials) - len(todo)} of {len(trials)} trials are done already")
    with file.open("a", encoding="utf-8") as results:
        for record in _attempted(todo, attempt, in_flight):
            results.write(json.dumps(asdict(record), ensure_ascii=False) + "\n")
            results.flush()
            os.fsync(results.fileno())
            kept[record.trial] = record
            say(f"{sum(t in kept for t in trials)} of {len(trials)}: {_told(record)}")
    return [kept[trial] for trial in trials]


def read_records(file: Path) -> list[Record]:
    """The records in a results file, none when there is no file. A last line that a kill cut short
    is removed.

    Raises:
        InputError: another line is not a record.
    """
    if not file.exists():
        return []
    content = file.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    if whole != content:
        os.truncate(file, len(whole))
    try:
        return [TypeAdapter(Record).validate_json(line) for line in whole.splitlines()]
    except ValidationError:
        raise InputError(
            f"'{file.name}' is not a results file of a study; choose another with --results"
        ) from None


def table(records: Iterable[Record]) -> list[Row]:
    """One row for each configuration and planner, in order of first appearance."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record.trial.configuration, record.trial.planner), []).append(record)
    return [_row(*key, group) for key, group in groups.items()]


def _row(configuration: str, planner: str, records: Sequence[Record]) -> Row:
    judged = [r.success for r in records if r.success is not None]
    costs = [r.figures.get("cost_usd") for r in records]
    tokens = [r.figures.get("input_tokens", 0) + r.figures.get("output_tokens", 0) for r in records]
    return Row(
        configuration,
        planner,
        Rate(sum(r.syntax for r in records), len(records)),
        Rate(sum(r.valid for r in records), len(records)),
        Rate(sum(judged), len(judged)) if judged else None,
        sum(tokens) / len(tokens),
        None if None in costs else sum(c for c in costs if c is not None),
    )


def _attempted(
    trials: Sequence[Trial], attempt: Callable[[Trial], Record], in_flight: int
) -> Iterable[Record]:
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
            if in_a_row < OUTAGES:
                running |= {pool.submit(attempt, trial) for trial in islice(waiting, len(done))}
    if outage is not None:
        raise Unavailable(f"{outage} — the finished trials are kept; run the study again to go on")


def _told(record: Record) -> str:
    trial = record.trial
    outcome = {True: "success", False: f"no success ({record.reason})", None: "not judged"}[
        record.success
    ]
    return (
        f"{trial.configuration}, {trial.planner}, trial {trial.number}: "
        f"{'syntax valid' if record.syntax else 'syntax not valid'}, {outcome}"
    )
