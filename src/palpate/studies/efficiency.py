"""Intent-driven against exhaustive: actions and robot time of both planners on the same scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from palpate.scenarios.catalogue import names, scenario
from palpate.studies.accuracy import SeedRun, run_seed

PAPER = (29, 62.0, 12, 33.0)
"""Exhaustive actions and seconds, intent-driven actions and seconds: section VI-B of the paper."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One scenario under both planners."""

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
    found = [scenario(name) for name in names()]
    return [s.name for s in found if s.status == "complete" and s.planner == "symbolic"]


def efficiency(scenarios: Iterable[str], noise: str = "lab", seed: int = 0) -> list[Comparison]:
    """Both planners on each scenario."""
    return [_compare(name, noise, seed) for name in scenarios]


def _compare(name: str, noise: str, seed: int) -> Comparison:
    settings = scenario(name).settings(noise=noise)
    return Comparison(
        name, run_seed(replace(settings, planner="exhaustive"), seed), run_seed(settings, seed)
    )
