"""Savings of intent, as a page of bars: actions and robot time of the exhaustive and the
intent-driven planner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from palpate.report.plots import MARK, NORM, Figure

GRID = "#e5e7eb"


@dataclass(frozen=True, slots=True)
class Effort:
    """Actions and robot time (s) of a scenario under both planners: exhaustive, intent-driven."""

    scenario: str
    actions: tuple[int, int]
    robot_seconds: tuple[float, float]


def efficiency_page(rows: Sequence[Effort], paper: Effort) -> str:
    """A self-contained HTML page: the measured `rows`, and beside them, paler, what the paper
    reports."""
    from plotly.io import to_html

    return to_html(
        efficiency_figure(rows, paper),
        config={"displaylogo": False, "responsive": True},
        div_id="efficiency",
    )


def efficiency_figure(rows: Sequence[Effort], paper: Effort) -> Figure:
    """Actions on the left, robot seconds on the right, a pair of bars per scenario."""
    shown = [*rows, paper]
    opacity = [1.0] * len(rows) + [0.45]
    bars: list[Figure] = []
    for planner in range(2):
        actions = [effort.actions[planner] for effort in shown]
        seconds = [effort.robot_seconds[planner] for effort in shown]
        bars.append(_bars(shown, planner, actions, "", opacity))
        bars.append(_bars(shown, planner, seconds, "2", opacity))
    return {
        "data": bars,
        "layout": {
            "title": {"text": "Intent-driven against exhaustive"},
            "barmode": "group",
            "bargap": 0.3,
            "plot_bgcolor": "#fff",
            "font": {"family": "system-ui, sans-serif"},
            "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
            "xaxis": {"domain": [0.0, 0.47], "automargin": True},
            "yaxis": {"title": {"text": "actions"}, "gridcolor": GRID, "rangemode": "tozero"},
            "xaxis2": {"domain": [0.53, 1.0], "automargin": True, "anchor": "y2"},
            "yaxis2": {
                "title": {"text": "robot time (s)"},
                "gridcolor": GRID,
                "rangemode": "tozero",
                "anchor": "x2",
            },
        },
    }


def _bars(
    shown: Sequence[Effort],
    planner: int,
    values: Sequence[float],
    axis: str,
    opacity: Sequence[float],
) -> Figure:
    return {
        "type": "bar",
        "name": ("exhaustive", "intent-driven")[planner],
        "legendgroup": str(planner),
        "showlegend": not axis,
        "xaxis": f"x{axis}",
        "yaxis": f"y{axis}",
        "x": [escape(e.scenario) for e in shown],
        "y": list(values),
        "texttemplate": "%{y:.3~r}",
        "textposition": "outside",
        "cliponaxis": False,
        "marker": {"color": (NORM, MARK)[planner], "opacity": list(opacity)},
    }
