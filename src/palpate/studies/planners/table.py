"""Trials as rows of a table: how often answers had the form, passed the check, and did what they
should."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean

from palpate.studies.planners.trials import Record, Trial
from palpate.studies.rate import Rate


@dataclass(frozen=True, slots=True)
class Row:
    """Row of the table: trials of one prompt configuration with one planner.

    Attributes:
        scenario: the only one of all trials; empty where they are of several.
        asked: who plans, and how, in words.
        success: None where nothing was judged.
        tokens: of one trial, on average.
        cost: US dollars of all trials together; None where an answer has no known price.
    """

    configuration: str
    planner: str
    syntax: Rate
    valid: Rate
    success: Rate | None
    tokens: float
    cost: float | None
    asked: str = ""
    scenario: str = ""


def table(records: Iterable[Record]) -> list[Row]:
    """Make a row for each combination of configuration, prompt and planner, in order of first
    appearance."""
    return _rows(records, lambda t: (t.configuration, t.asked))


def by_scenario(records: Iterable[Record]) -> list[Row]:
    """The same, scenario by scenario."""
    return _rows(records, lambda t: (t.scenario, t.configuration, t.asked))


def _rows(records: Iterable[Record], key: Callable[[Trial], tuple[str, ...]]) -> list[Row]:
    groups: dict[tuple[str, ...], list[Record]] = {}
    for record in records:
        groups.setdefault(key(record.trial), []).append(record)
    return [_row(group) for group in groups.values()]


def _row(records: Sequence[Record]) -> Row:
    judged = [record.success for record in records if record.success is not None]
    scenarios = {record.trial.scenario for record in records}
    trial = records[0].trial
    return Row(
        trial.configuration,
        trial.planner,
        Rate.of(record.syntax for record in records),
        Rate.of(record.valid for record in records),
        Rate.of(judged) if judged else None,
        fmean(record.tokens for record in records),
        _cost(records),
        trial.asked,
        trial.scenario if len(scenarios) == 1 else "",
    )


def _cost(records: Iterable[Record]) -> float | None:
    total = 0.0
    for record in records:
        if record.cost is None:
            return None
        total += record.cost
    return total
