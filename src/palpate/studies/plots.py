"""Plotly figures of an accuracy study, as dictionaries for plotly.js.

The page's script sets the colours of paper, grid and text, for a light or a dark theme.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import cycle
from typing import Any

import numpy as np
from scipy.special import bdtrik, betaincinv, ndtri

from palpate.common.pose import Array
from palpate.runs.report.plots import FAINT, LEGEND, MARK, NORM, Figure
from palpate.studies.accuracy import ScoredEstimate
from palpate.studies.efficiency import RangedValue
from palpate.studies.summary import levels, shares

COLOURS = ("#0d9488", "#3b82f6", "#d97706", "#8b5cf6", "#e5484d", "#30a46c", "#db2777", "#8293a7")
"""Colours of quantities and noise models, used in turn."""
BAND = "rgba(139, 141, 152, 0.18)"  # Colour of the 95 % band of correctly stated errors
BARS = (8, 30)  # Smallest and largest count of bars in a histogram
POINTS = 400  # Largest count of points in a quantile plot
REACH = 1e-9  # Least distance of a drawn share from 0 and 1: about 6 standard deviations
GOOD = (0.8, 1.3)  # Target range of the ratio of stated standard deviation to actual error

MARGIN = {"l": 52, "r": 12, "t": 10, "b": 42}
# Layout of a large figure, with a legend above it.
LARGE: Figure = {"height": 420, "showlegend": True, "legend": LEGEND}


def errors(estimates: Sequence[ScoredEstimate], scale: float, unit: str) -> Figure:
    """Distribution of the errors, in `unit`s of 1/`scale`, with the mean stated distribution."""
    # Scale to the unit; choose a symmetric range that contains all errors and 3 stated deviations.
    scaled = scale * np.array([each.error for each in estimates])
    stds = scale * np.array([each.std for each in estimates])
    widest = max(float(np.abs(scaled).max()), 3.0 * float(np.median(stds)))
    count = int(np.clip(2.0 * np.sqrt(len(scaled)), *BARS))
    heights, edges = np.histogram(scaled, count, (-widest, widest), density=True)
    x = np.linspace(-widest, widest, 201)
    # Mean of the stated normal densities: the expected histogram of calibrated errors.
    pdf = np.exp(-0.5 * (x / stds[:, None]) ** 2) / (stds[:, None] * np.sqrt(2.0 * np.pi))
    middles = (edges[1:] + edges[:-1]) / 2.0
    bars = {
        "type": "bar",
        "name": "errors",
        "x": rounded_list(middles),
        "y": rounded_list(heights),
        "width": float(edges[1] - edges[0]),
        "marker": {"color": MARK, "opacity": 0.55},
        "hovertemplate": f"%{{x:.3g}} {escape(unit)}<extra></extra>",
    }
    curve = line_trace("as stated", x, pdf.mean(axis=0), NORM)
    # Mark the mean error and zero.
    bias = float(scaled.mean())
    return {
        "data": [bars, curve],
        "layout": {
            **panel_layout(f"error ({escape(unit)})" if unit not in ("", "1") else "error", ""),
            "bargap": 0.04,
            "shapes": [vertical_line(bias, MARK, "solid"), vertical_line(0.0, FAINT, "dot")],
        },
    }


def quantiles(estimates: Sequence[ScoredEstimate]) -> Figure:
    """Normal quantile plot of the errors.

    The errors are transformed by their stated distributions, and drawn against the expected order
    statistics. The band contains 95 of 100 points of calibrated estimates.
    """
    # Probability integral transform of the errors, sorted and thinned out.
    share = np.sort(np.clip(shares(estimates), REACH, 1.0 - REACH))
    n = len(share)
    kept = np.unique(np.linspace(0, n - 1, min(n, POINTS)).astype(int))
    rank = kept + 1.0
    # Expected normal order statistics: G. Blom, Statistical Estimates and Transformed Beta
    # Variables, 1958. The rank-th smallest of n uniform numbers is Beta(rank, n + 1 - rank), which
    # gives the band.
    expected = ndtri((rank - 0.375) / (n + 0.25))
    low, high = (ndtri(betaincinv(rank, n + 1.0 - rank, p)) for p in (0.025, 0.975))
    ends = expected[[0, -1]] if n > 1 else np.array([-1.0, 1.0])
    # Thinned-out points against the expected order statistics.
    points = {
        "type": "scatter",
        "mode": "markers",
        "name": "errors",
        "x": rounded_list(expected),
        "y": rounded_list(ndtri(share[kept])),
        "marker": {"color": MARK, "size": 4.5},
        "hovertemplate": "%{y:.2f}, expected %{x:.2f}<extra></extra>",
    }
    return {
        "data": [
            *band_traces(expected, low, high),
            line_trace("calibrated", ends, ends, FAINT, "dot"),
            points,
        ],
        "layout": panel_layout("z expected", "z found"),
    }


def coverage(groups: Mapping[str, Sequence[ScoredEstimate]]) -> Figure:
    """Empirical coverage of intervals against their nominal level, by quantity and pooled."""
    everything = [each for group in groups.values() for each in group]
    nominal = np.linspace(0.005, 0.995, 199)
    n = len(everything)
    # Band: the count of n calibrated intervals that contain the truth is binomial.
    low, high = (bdtrik(p, n, nominal) / n for p in (0.025, 0.975))
    lines = [*band_traces(100 * nominal, 100 * low, 100 * high)]
    ends = np.array([0.0, 100.0])
    lines.append(line_trace("calibrated", ends, ends, FAINT, "dot"))
    for (name, group), colour in zip(groups.items(), cycle(COLOURS), strict=False):
        lines.append(coverage_curve(f"{escape(name)} ({len(group)})", group, colour, 1.6))
    if len(groups) > 1:
        lines.append(coverage_curve(f"all ({n})", everything, NORM, 3.0))
    # Both axes are per cent, from 0 to 100.
    layout = panel_layout("interval of level", "holds the truth") | LARGE
    for name in ("xaxis", "yaxis"):
        layout[name] |= {"range": [0, 100], "dtick": 25, "ticksuffix": " %"}
    return {"data": lines, "layout": layout}


def ratios(rows: Sequence[tuple[str, RangedValue]]) -> Figure:
    """Ratio of stated standard deviation to actual error, a row for each parameter, with 95 % intervals.

    The target range is shaded. The axis is logarithmic.
    """
    # Plotly draws the first row at the bottom: reverse the order.
    rows = [(escape(name), stated) for name, stated in reversed(rows)]
    scale = {"type": "log", "range": [np.log10(0.2), np.log10(5.0)], "showgrid": True}
    scale |= {"tickvals": [0.25, 0.5, 1, 2, 4], "ticktext": ["¼", "½", "1", "2", "4"]}
    # Shade the target range behind the points.
    aim = {
        "type": "rect",
        "xref": "x",
        "yref": "paper",
        "x0": GOOD[0],
        "x1": GOOD[1],
        "y0": 0,
        "y1": 1,
    }
    aim |= {"fillcolor": BAND, "line": {"width": 0}, "layer": "below"}
    # Points with asymmetric intervals.
    dots = {
        "type": "scatter",
        "mode": "markers",
        "x": [figure.value for _, figure in rows],
        "y": [name for name, _ in rows],
        "xaxis": "x",
        "marker": {"color": MARK, "size": 7},
        "error_x": {
            "array": [figure.high - figure.value for _, figure in rows],
            "arrayminus": [figure.value - figure.low for _, figure in rows],
            "color": MARK,
            "thickness": 1.6,
            "width": 4,
        },
        "customdata": [[figure.low, figure.high] for _, figure in rows],
        "hovertemplate": "%{y}: %{x:.2f} (%{customdata[0]:.2f} … %{customdata[1]:.2f})"
        "<extra></extra>",
    }
    return {
        "data": [dots],
        "layout": {
            "height": 130 + 30 * len(rows),
            "margin": {"l": 10, "r": 12, "t": 10, "b": 46},
            "showlegend": False,
            "xaxis": scale | {"title": {"text": "stated over actual"}},
            "yaxis": {
                "automargin": True,
                "categoryorder": "array",
                "categoryarray": [name for name, _ in rows],
                "range": [-0.6, len(rows) - 0.4],
                "ticks": "",
            },
            "shapes": [aim, vertical_line(1.0, FAINT, "dot")],
        },
    }


def coverage_curve(name: str, group: Sequence[ScoredEstimate], colour: str, width: float) -> Figure:
    # Share of intervals that contain the truth, as a step function of their level.
    level = 100.0 * np.sort(levels(group))
    inside = 100.0 * np.arange(1, len(level) + 1) / len(level)
    kept = np.unique(np.linspace(0, len(level) - 1, min(len(level), POINTS)).astype(int))
    x = np.concatenate([[0.0], level[kept], [100.0]])
    y = np.concatenate([[0.0], inside[kept], [100.0]])
    line = line_trace(name, x, y, colour)
    line["line"] |= {"shape": "hv", "width": width}
    return line | {"showlegend": True, "hovertemplate": "%{x:.0f} %: %{y:.0f} %"}


def scatter(points: Mapping[str, Sequence[tuple[str, float, float]]]) -> Figure:
    """Root mean square error against mean stated standard deviation, SI units, a colour for each noise model.

    `points` are (name, stated, actual) by noise model.
    """
    # Square range with a margin, and the band of the target ratios.
    numbers = [number for row in points.values() for _, *both in row for number in both]
    ends = np.array([min(numbers), max(numbers)]) * np.array([0.4, 2.5])
    drawn = band_traces(ends, ends / GOOD[1], ends / GOOD[0])
    drawn.append(line_trace("as stated", ends, ends, FAINT, "dot"))
    for (noise, rows), colour in zip(points.items(), cycle(COLOURS), strict=False):
        drawn.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": escape(noise),
                "showlegend": True,
                "x": [stated for _, stated, _ in rows],
                "y": [actual for _, _, actual in rows],
                "text": [escape(name) for name, _, _ in rows],
                "marker": {"color": colour, "size": 9, "opacity": 0.85},
                "hovertemplate": "%{text}: stated %{x:.2g}, actual %{y:.2g}<extra></extra>",
            }
        )
    # Logarithmic axes with the same range.
    layout = panel_layout("stated standard deviation (SI unit)", "root mean square error") | LARGE
    for name in ("xaxis", "yaxis"):
        layout[name] |= {"type": "log", "exponentformat": "power", "dtick": 1}
        layout[name]["range"] = np.log10(ends).tolist()
    return {"data": drawn, "layout": layout}


def panel_layout(across: str, up: str) -> dict[str, Any]:
    """Layout of a small panel, with the titles of its axes."""
    return {
        "height": 230,
        "margin": dict(MARGIN),
        "showlegend": False,
        "hovermode": "closest",
        "xaxis": {"title": {"text": across}, "zeroline": False},
        "yaxis": {"title": {"text": up}, "zeroline": False, "showticklabels": bool(up)},
    }


def line_trace(name: str, x: Array, y: Array, colour: str, dash: str = "solid") -> Figure:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "showlegend": False,
        "x": rounded_list(x),
        "y": rounded_list(y),
        "line": {"color": colour, "width": 1.6, "dash": dash},
        "hoverinfo": "skip" if dash == "dot" else "all",
    }


def band_traces(x: Array, low: Array, high: Array) -> list[Figure]:
    edge: Figure = {"type": "scatter", "mode": "lines", "showlegend": False, "hoverinfo": "skip"}
    edge |= {"line": {"width": 0}, "x": rounded_list(x)}
    upper = {"y": rounded_list(high), "fill": "tonexty", "fillcolor": BAND}
    return [edge | {"y": rounded_list(low)}, edge | upper]


def vertical_line(at: float, colour: str, dash: str) -> Figure:
    """Vertical line through a panel."""
    line = {"color": colour, "width": 1.2, "dash": dash}
    place = {"xref": "x", "yref": "paper", "x0": at, "x1": at, "y0": 0, "y1": 1}
    return {"type": "line", **place, "line": line}


def rounded_list(values: Array) -> list[float]:
    # Five digits are more than a screen shows.
    return [float(f"{value:.5g}") for value in values.tolist()]
