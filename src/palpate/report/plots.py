"""Plotly figures of a trace, as the plain dictionaries that plotly.js draws.

Names come from the user's files: they are escaped here, because plotly renders a subset of HTML in
every label. Colours of paper, grid and text are left to the page, which knows whether it is light
or dark.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.motion import tip_height
from palpate.geometry.pose import Array
from palpate.trace.recording import LeafRun, Recording
from palpate.trace.samples import Samples, Trace

Figure = dict[str, Any]

MAX_POINTS = 1500
"""Per series: about the pixels of a wide screen."""

X, Y, Z, NORM, FAINT, MARK = "#e5484d", "#30a46c", "#3b82f6", "#8b8d98", "#a1a5b0", "#0d9488"
"""Axes in the colours every robot viewer gives them; MARK is the page's accent, for what was
measured."""

GROUPS = {"motion": "#8293a7", "gripper": "#d9a13b", "sensing": "#0d9488", "conversion": "#8b5cf6"}
FAILED, STOPPED = "#e5484d", "#b0b4bd"

_FORCE, _HEIGHT, _LEAVES = (0.56, 1.0), (0.17, 0.49), (0.0, 0.09)
"""Share of the figure's height that each row takes."""

NARROWEST = 0.05
"""s: a leaf that took no time is still seen."""


def timeline(trace: Trace, windows: Mapping[Recording, str], groups: Mapping[str, str]) -> Figure:
    """Force, height and leaves over robot time, on one shared axis.

    `windows` names the recordings to shade; `groups` says which group each primitive belongs to.
    """
    start, end = _span(trace)
    return {
        "data": [
            *_forces(trace.samples),
            *_heights(trace),
            *_contacts(trace),
            _leaf_bars(trace.leaves, groups),
        ],
        "layout": {
            "height": 680,
            "margin": {"l": 58, "r": 14, "t": 84, "b": 44},
            "hovermode": "x unified",
            "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
            "uniformtext": {"mode": "hide", "minsize": 9},
            "bargap": 0.1,
            "dragmode": "zoom",
            "xaxis": {
                "range": [start, end],
                "anchor": "y3",
                "title": {"text": "robot time (s)"},
                "ticks": "outside",
                "showspikes": True,
                "spikemode": "across",
                "spikethickness": 1,
                "spikedash": "dot",
                "hoverformat": ".2f",
            },
            "yaxis": {"domain": _FORCE, "title": {"text": "force (N)"}, "hoverformat": ".3f"},
            "yaxis2": {"domain": _HEIGHT, "title": {"text": "height (m)"}, "hoverformat": ".4f"},
            "yaxis3": {
                "domain": _LEAVES,
                "visible": False,
                "fixedrange": True,
                "autorange": "reversed",
            },
            "shapes": [*_boundaries(trace.leaves), *_shades(windows)],
            "annotations": _names(windows, end - start),
        },
    }


def figure_page(figure: Figure, name: str) -> str:
    """A self-contained HTML page of one figure; `name` is its element's id."""
    from plotly.io import to_html

    config = {"displaylogo": False, "responsive": True}
    return to_html(figure, config=config, div_id=name)


def decimate(t: Array, y: Array, limit: int = MAX_POINTS) -> tuple[Array, Array]:
    """At most `limit` points with every peak kept: the least and the largest of each of `limit` / 2
    blocks."""
    if len(t) <= limit:
        return t, y
    edges = np.linspace(0, len(t), limit // 2 + 1).astype(int)
    kept: list[int] = []
    for start, stop in pairwise(edges):
        block = y[start:stop]
        kept += [start + int(block.argmin()), start + int(block.argmax())]
    rows = np.unique(np.array(kept, dtype=int))
    return t[rows], y[rows]


def _span(trace: Trace) -> tuple[float, float]:
    """Beginning and end of what was recorded, robot time (s)."""
    times: list[float] = []
    if len(trace.samples):
        times += trace.samples.t[[0, -1]].tolist()
    for leaf in trace.leaves:
        times += [leaf.start, leaf.end]
    if not times:
        return 0.0, 1.0
    return min(times), max(times)


def _line(name: str, t: Array, y: Array, colour: str, axis: str = "y", **more: Any) -> Figure:
    x, y = decimate(t, y)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": packed(x),
        "y": packed(y),
        "yaxis": axis,
        "line": {"color": colour, "width": 1.4},
        **more,
    }


def packed(values: NDArray[Any]) -> dict[str, str]:
    """Plotly's typed array: binary float32."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}


def _forces(samples: Samples) -> list[Figure]:
    force = samples.wrench[:, :3]
    return [
        _line("F<sub>x</sub>", samples.t, force[:, 0], X),
        _line("F<sub>y</sub>", samples.t, force[:, 1], Y),
        _line("F<sub>z</sub>", samples.t, force[:, 2], Z),
        _line("|F|", samples.t, np.linalg.norm(force, axis=1), NORM, opacity=0.75),
    ]


def _heights(trace: Trace) -> list[Figure]:
    s, hidden = trace.samples, {"visible": "legendonly"}
    dotted = {"line": {"color": FAINT, "width": 1.2, "dash": "dot"}}
    return [
        _line("TCP z", s.t, s.pose_world_tcp[:, 2], Z, "y2", opacity=0.6),
        _line("fingertips z", s.t, tip_height(s, trace.hand), MARK, "y2"),
        _line("commanded z", s.t, s.target_world_tcp[:, 2], FAINT, "y2", **dotted),
        _line("TCP x", s.t, s.pose_world_tcp[:, 0], X, "y2", **hidden),
        _line("TCP y", s.t, s.pose_world_tcp[:, 1], Y, "y2", **hidden),
        _line("finger opening", s.t, s.width, NORM, "y2", **hidden),
    ]


def _contacts(trace: Trace) -> list[Figure]:
    """Contacts of guarded motions."""
    touches = trace.leaf_runs("MoveUntilContact")
    if not touches or not len(trace.samples):
        return []
    times = np.array([leaf.end for leaf in touches])
    heights = np.interp(times, trace.samples.t, tip_height(trace.samples, trace.hand))
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "name": "contact",
            "x": packed(times),
            "y": packed(heights),
            "yaxis": "y2",
            "marker": {"symbol": "circle-open", "size": 13, "color": MARK, "line": {"width": 2.5}},
        }
    ]


def _leaf_bars(leaves: Sequence[LeafRun], groups: Mapping[str, str]) -> Figure:
    """A bar per leaf, from its first tick to its last."""
    starts: list[float] = []
    durations: list[float] = []
    names: list[str] = []
    colours: list[str] = []
    hover: list[tuple[str, str, float]] = []
    for leaf in leaves:
        duration = leaf.end - leaf.start
        starts.append(leaf.start)
        durations.append(max(duration, NARROWEST))
        names.append(escape(leaf.primitive))
        colours.append(_leaf_colour(leaf, groups))
        hover.append((escape(leaf.label), leaf.status.lower(), round(duration, 2)))
    return {
        "type": "bar",
        "orientation": "h",
        "name": "leaf",
        "yaxis": "y3",
        "showlegend": False,
        "base": starts,
        "x": durations,
        "y": _lanes(leaves),
        "text": names,
        "textposition": "inside",
        "insidetextanchor": "middle",
        "textangle": 0,
        "insidetextfont": {"color": "#fff"},
        "marker": {"color": colours, "line": {"width": 1, "color": "rgba(255,255,255,0.7)"}},
        "customdata": hover,
        "hovertemplate": "%{customdata[0]}: %{customdata[1]}, %{customdata[2]} s<extra></extra>",
    }


def _leaf_colour(leaf: LeafRun, groups: Mapping[str, str]) -> str:
    if leaf.status == "FAILURE":
        return FAILED
    if leaf.status == "INVALID":
        return STOPPED
    return GROUPS.get(groups.get(leaf.primitive, ""), NORM)


def _lanes(leaves: Sequence[LeafRun]) -> list[int]:
    """The first lane that is free, so that leaves of a Parallel lie under one another."""
    busy_until: list[float] = []
    lanes: list[int] = []
    for leaf in leaves:
        lane = _first_free(busy_until, leaf.start + 1e-6)
        busy_until[lane : lane + 1] = [leaf.end]
        lanes.append(lane)
    return lanes


def _first_free(busy_until: Sequence[float], time: float) -> int:
    """The first place that is free at `time`, or the one after the last."""
    for place, end in enumerate(busy_until):
        if end <= time:
            return place
    return len(busy_until)


def _boundaries(leaves: Sequence[LeafRun]) -> list[Figure]:
    """A dotted line where each leaf starts, through the rows above the leaves."""
    style = {"color": FAINT, "width": 0.6, "dash": "dot"}
    starts = sorted({leaf.start for leaf in leaves})
    return [_shape("line", t, t, _LEAVES[1], line=style) for t in starts]


def _shades(windows: Iterable[Recording]) -> list[Figure]:
    """A shaded box for each recording."""
    style = {"fillcolor": MARK, "opacity": 0.16, "line": {"color": MARK, "width": 1}}
    return [_shape("rect", r.start, r.end, _HEIGHT[0], **style) for r in windows]


def _shape(kind: str, start: float, end: float, bottom: float, **style: Any) -> Figure:
    """Behind the curves from `start` to `end` (s), from `bottom` (of the figure's height) up."""
    place = {"x0": start, "x1": end, "y0": bottom, "y1": 1}
    return {"type": kind, "xref": "x", "yref": "paper", "layer": "below", **place, **style}


def _names(windows: Mapping[Recording, str], span: float) -> list[Figure]:
    """A name above each window; where two would collide, the later goes a line lower."""
    taken_until = [-np.inf] * 3
    out: list[Figure] = []
    for recording, name in sorted(windows.items(), key=lambda item: item[0].start):
        line = min(_first_free(taken_until, recording.start), len(taken_until) - 1)
        taken_until[line] = recording.start + span * 0.008 * (len(name) + 2)
        out.append(
            {
                "xref": "x",
                "yref": "paper",
                "x": recording.start,
                "y": 1,
                "yshift": -15 * line,
                "text": escape(name),
                "showarrow": False,
                "xanchor": "left",
                "yanchor": "top",
                "font": {"size": 11, "color": MARK},
            }
        )
    return out
