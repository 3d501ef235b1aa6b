"""Intent-driven against exhaustive: actions and robot time of both planners on the same scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from palpate.scenarios.catalogue import scenario, scenarios
from palpate.studies.accuracy import SeedRun, run_seed


@dataclass(frozen=True, slots=True)
class PublishedEffort:
    """Actions and robot time (s) of both planners, as published."""

    exhaustive_actions: int
    exhaustive_seconds: float
    intent_actions: int
    intent_seconds: float
    time_saved: float


PAPER = PublishedEffort(29, 62.0, 12, 33.0, 0.47)
"""Section VI-B of the paper."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Runs of a scenario under the exhaustive and the intent-driven planner."""

    scenario: str
    exhaustive: SeedRun
    intent: SeedRun

    @property
    def time_saved(self) -> float | None:
        """Fraction of robot time that intent saves; None unless both planners' runs were
        completed."""
        if self.exhaustive.status != "complete" or self.intent.status != "complete":
            return None
        return 1.0 - self.intent.robot_seconds / self.exhaustive.robot_seconds


def comparable() -> list[str]:
    """Scenarios that the symbolic planner completes."""
    found: list[str] = []
    for name, each in scenarios().items():
        if each.planner == "symbolic" and each.status == "complete":
            found.append(name)
    return found


def efficiency(names: Iterable[str], noise: str = "lab", seed: int = 0) -> list[Comparison]:
    """Both planners on each scenario."""
    return [_compare(name, noise, seed) for name in names]


def plot(rows: Iterable[Comparison]) -> str:
    """The comparisons as a page of HTML, beside the paper's."""
    from palpate.report.efficiency import Effort, efficiency_page

    efforts: list[Effort] = []
    for row in rows:
        actions = (row.exhaustive.actions, row.intent.actions)
        seconds = (row.exhaustive.robot_seconds, row.intent.robot_seconds)
        efforts.append(Effort(row.scenario, actions, seconds))
    published = Effort(
        "the paper's pair",
        (PAPER.exhaustive_actions, PAPER.intent_actions),
        (PAPER.exhaustive_seconds, PAPER.intent_seconds),
    )
    return efficiency_page(efforts, published)


def _compare(name: str, noise: str, seed: int) -> Comparison:
    intent = scenario(name).settings(noise=noise)
    exhaustive = replace(intent, planner="exhaustive")
    return Comparison(name, run_seed(exhaustive, seed), run_seed(intent, seed))
