"""Efficiency of planners, and figures with confidence intervals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from math import sqrt

import numpy as np

from palpate.common.pose import Array
from palpate.robots.noise_levels import DEFAULT_LEVEL
from palpate.runs.report.plots import LEGEND, MARK, NORM, Figure, figure_page
from palpate.studies.accuracy import SeedRun, run_seed
from palpate.studies.scenarios.catalogue import scenario, scenarios


@dataclass(frozen=True, slots=True)
class Rate:
    """Rate: `hits` of `trials`, with the 95 % Wilson score interval."""

    hits: int
    trials: int

    @classmethod
    def of(cls, outcomes: Iterable[bool]) -> Rate:
        """Count the true outcomes."""
        listed = list(outcomes)
        return cls(sum(listed), len(listed))

    @property
    def interval(self) -> tuple[float, float]:
        """Ends (low, high) of the interval of the rate."""
        from scipy.stats import binomtest

        if self.trials == 0:  # nothing is known of the rate
            return 0.0, 1.0
        interval = binomtest(self.hits, self.trials).proportion_ci(method="wilson")
        return float(interval.low), float(interval.high)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits}/{self.trials} [{low:.2f}, {high:.2f}]"


@dataclass(frozen=True, slots=True)
class RangedValue:
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def share(cls, outcomes: Iterable[bool]) -> RangedValue:
        """Share of true outcomes, with the Wilson interval."""
        rate = Rate.of(outcomes)
        return cls(rate.hits / max(rate.trials, 1), *rate.interval)

    @classmethod
    def rms(cls, numbers: Array) -> RangedValue:
        """Root mean square of (n,) independent normal numbers about zero.

        n RMS²/σ² is χ² with n degrees of freedom (Kay, Fundamentals of Statistical Signal
        Processing I, 1993, app. 3).
        """
        from scipy.special import chdtri

        # The interval of σ: RMS √(n / χ²) at the quantiles 0.975 and 0.025.
        n, value = len(numbers), float(np.sqrt(np.mean(numbers**2)))
        # chdtri(n, p) is the χ² value whose probability of exceedance is p.
        low, high = n / chdtri(n, 0.025), n / chdtri(n, 0.975)
        return cls(value, value * sqrt(low), value * sqrt(high))

    @property
    def inverse(self) -> RangedValue:
        """1 / value with its interval; zero for zero."""
        if self.value == 0.0:
            return RangedValue(0.0, 0.0, 0.0)
        return RangedValue(1.0 / self.value, 1.0 / self.high, 1.0 / self.low)


@dataclass(frozen=True, slots=True)
class TableCell:
    """Table cell: text, small print below it, and a mark: `good`, `warn`, `bad` or none."""

    text: str
    below: str = ""
    mark: str = ""


Line = tuple[str, Iterable[TableCell]]  # Table row: its name and its cells


# Efficiency study: actions and robot time of the exhaustive and the intent-driven planner on the
# same scene.

GRID = "#e5e7eb"
PUBLISHED_OPACITY = 0.45


@dataclass(frozen=True, slots=True)
class PublishedEffort:
    """Actions and robot time (s) of both planners, as published."""

    exhaustive_actions: int
    exhaustive_seconds: float
    intent_actions: int
    intent_seconds: float
    time_saved: float


PAPER = PublishedEffort(29, 62.0, 12, 33.0, 0.47)  # Section VI-B of the paper


@dataclass(frozen=True, slots=True)
class PlannerComparison:
    """Runs of a scenario under the exhaustive and the intent-driven planner."""

    scenario: str
    exhaustive: SeedRun
    intent: SeedRun

    @property
    def time_saved(self) -> float | None:
        """Fraction of robot time that intent saves; None unless both runs were completed."""
        if self.exhaustive.status != "complete" or self.intent.status != "complete":
            return None
        return 1.0 - self.intent.robot_seconds / self.exhaustive.robot_seconds


def comparable() -> list[str]:
    """Names of the scenarios that the symbolic planner completes."""
    return [
        name
        for name, each in scenarios().items()
        if each.planner == "symbolic" and each.status == "complete"
    ]


def efficiency(
    names: Iterable[str], noise: str = DEFAULT_LEVEL, seed: int = 0
) -> list[PlannerComparison]:
    """Run both planners on each scenario."""
    rows: list[PlannerComparison] = []
    for name in names:
        # The same scenario and seed, by both planners.
        intent = scenario(name).settings(noise=noise)
        exhaustive = replace(intent, planner="exhaustive")
        rows.append(PlannerComparison(name, run_seed(exhaustive, seed), run_seed(intent, seed)))
    return rows


def plot(rows: Sequence[PlannerComparison]) -> str:
    """Self-contained HTML page of `efficiency_figure`."""
    return figure_page(efficiency_figure(rows), "efficiency")


def efficiency_figure(rows: Sequence[PlannerComparison]) -> Figure:
    """Bar chart with actions on the left and robot time on the right.

    Each scenario has a pair of bars. The published pair is paler.
    """
    # Append the published pair to the measured ones.
    names = [*(escape(row.scenario) for row in rows), "the paper's pair"]
    exhaustive, intent = [row.exhaustive for row in rows], [row.intent for row in rows]
    actions = (
        [*(run.actions for run in exhaustive), PAPER.exhaustive_actions],
        [*(run.actions for run in intent), PAPER.intent_actions],
    )
    seconds = (
        [*(run.robot_seconds for run in exhaustive), PAPER.exhaustive_seconds],
        [*(run.robot_seconds for run in intent), PAPER.intent_seconds],
    )
    bars: list[Figure] = []
    for planner, (title, colour) in enumerate((("exhaustive", NORM), ("intent-driven", MARK))):
        # Plotly's second pair of axes has the suffix 2; one legend entry a planner serves both.
        for axis, values in (("", actions[planner]), ("2", seconds[planner])):
            opacity = [1.0] * len(rows) + [PUBLISHED_OPACITY]
            bar: Figure = {
                "type": "bar",
                "name": title,
                "legendgroup": str(planner),
                "showlegend": not axis,
                "xaxis": f"x{axis}",
                "yaxis": f"y{axis}",
                "x": names,
                "y": values,
                "texttemplate": "%{y:.3~r}",
                "textposition": "outside",
                "cliponaxis": False,
                "marker": {"color": colour, "opacity": opacity},
            }
            bars.append(bar)
    vertical = {"gridcolor": GRID, "rangemode": "tozero"}
    return {
        "data": bars,
        "layout": {
            "title": {"text": "Intent-driven against exhaustive"},
            "height": 520,
            "margin": {"t": 110},
            "barmode": "group",
            "bargap": 0.3,
            "plot_bgcolor": "#fff",
            "font": {"family": "system-ui, sans-serif"},
            "legend": LEGEND,
            "xaxis": {"domain": [0.0, 0.47], "automargin": True},
            "yaxis": {"title": {"text": "actions"}, **vertical},
            "xaxis2": {"domain": [0.53, 1.0], "automargin": True, "anchor": "y2"},
            "yaxis2": {"title": {"text": "robot time (s)"}, "anchor": "x2", **vertical},
        },
    }
