"""Efficiency study: actions and robot time of the exhaustive and the intent-driven planner on the same
scene."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape

from palpate.report.plots import MARK, NORM, Figure, figure_page
from palpate.robots.simulated.noise import DEFAULT_LEVEL
from palpate.scenarios.catalogue import scenario, scenarios
from palpate.studies.accuracy import SeedRun, run_seed

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


def efficiency(names: Iterable[str], noise: str = DEFAULT_LEVEL, seed: int = 0) -> list[Comparison]:
    """Run both planners on each scenario."""
    found: list[Comparison] = []
    for name in names:
        intent = scenario(name).settings(noise=noise)
        exhaustive = replace(intent, planner="exhaustive")
        found.append(Comparison(name, run_seed(exhaustive, seed), run_seed(intent, seed)))
    return found


def plot(rows: Sequence[Comparison]) -> str:
    """Self-contained HTML page of `efficiency_figure`."""
    return figure_page(efficiency_figure(rows), "efficiency")


def efficiency_figure(rows: Sequence[Comparison]) -> Figure:
    """Actions on the left, robot time on the right, a pair of bars per scenario; the published pair is
    paler."""
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
            "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
            "xaxis": {"domain": [0.0, 0.47], "automargin": True},
            "yaxis": {"title": {"text": "actions"}, **vertical},
            "xaxis2": {"domain": [0.53, 1.0], "automargin": True, "anchor": "y2"},
            "yaxis2": {"title": {"text": "robot time (s)"}, "anchor": "x2", **vertical},
        },
    }
