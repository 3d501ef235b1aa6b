"""Plotly figures of a trace, as the plain dictionaries that plotly.js draws.

Names come from the user's files: they are escaped here, because plotly renders a subset of HTML in
every label. The page's script sets the colours of paper, grid and text, for a light or a dark theme.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.motion import tip_height
from palpate.trace.recording import LeafRun, Recording
from palpate.trace.samples import Trace

Figure = dict[str, Any]

MAX_POINTS = 1500  # Largest count of points in a series: about the pixels of a wide screen

X, Y, Z, NORM, FAINT, MARK = "#e5484d", "#30a46c", "#3b82f6", "#8b8d98", "#a1a5b0", "#0d9488"
"""Axes in the colours of robot viewers (x red, y green, z blue); MARK is the page's accent, for
measurements."""

GROUPS = {"motion": "#8293a7", "gripper": "#d9a13b", "sensing": "#0d9488", "conversion": "#8b5cf6"}
FAILED, STOPPED = "#e5484d", "#b0b4bd"

# Bottom and top of each row, as shares of the figure's height.
FORCE_ROW, HEIGHT_ROW, LEAF_ROW = (0.56, 1.0), (0.17, 0.49), (0.0, 0.09)

NARROWEST = 0.05  # s: least width of a leaf's bar, so that one without duration is visible

# A legend in one line above the figure.
LEGEND: Figure = {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"}


def timeline(trace: Trace, windows: Mapping[Recording, str], groups: Mapping[str, str]) -> Figure:
    """Plot force, height and leaves over a common axis of robot time.

    `windows` names the recordings to shade; `groups` maps each primitive to its group.
    """
    # Range of robot time that contains all leaves and samples.
    times = [leaf.start for leaf in trace.leaves] + [leaf.end for leaf in trace.leaves]
    if len(trace.samples):
        times += trace.samples.t[[0, -1]].tolist()
    start, end = (min(times), max(times)) if times else (0.0, 1.0)
    # The force by component, and its magnitude.
    t, force = trace.samples.t, trace.samples.wrench[:, :3]
    signals = (*force.T, np.linalg.norm(force, axis=1))
    names = ("F<sub>x</sub>", "F<sub>y</sub>", "F<sub>z</sub>", "|F|")
    forces = [
        time_series(name, t, signal, colour)
        for name, signal, colour in zip(names, signals, (X, Y, Z, NORM), strict=True)
    ]
    forces[-1]["opacity"] = 0.75
    return {
        # Four groups of traces, on three vertical axes.
        "data": [
            *forces,
            *height_traces(trace),
            *contact_traces(trace),
            leaf_bars(trace.leaves, groups),
        ],
        "layout": {
            "height": 680,
            "margin": {"l": 58, "r": 14, "t": 84, "b": 44},
            "hovermode": "x unified",
            "legend": LEGEND,
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
            "yaxis": {"domain": FORCE_ROW, "title": {"text": "force (N)"}, "hoverformat": ".3f"},
            "yaxis2": {"domain": HEIGHT_ROW, "title": {"text": "height (m)"}, "hoverformat": ".4f"},
            "yaxis3": {
                "domain": LEAF_ROW,
                "visible": False,
                "fixedrange": True,
                "autorange": "reversed",
            },
            "shapes": background_shapes(trace.leaves, windows),
            "annotations": window_names(windows, end - start),
        },
    }


def figure_page(figure: Figure, name: str) -> str:
    """A self-contained HTML page of one figure; `name` is its element's id."""
    from plotly.io import to_html

    config = {"displaylogo": False, "responsive": True}
    return to_html(figure, config=config, div_id=name)


def decimate(t: Array, y: Array, limit: int = MAX_POINTS) -> tuple[Array, Array]:
    """Reduce a signal to `limit` points without losing peaks: minimum and maximum of each of `limit` / 2 blocks."""
    if len(t) <= limit:
        return t, y
    # Subsampling alone would lose contacts that last a few milliseconds.
    edges = np.linspace(0, len(t), limit // 2 + 1).astype(int)
    kept: list[int] = []
    for start, stop in pairwise(edges):
        block = y[start:stop]
        kept += [start + int(block.argmin()), start + int(block.argmax())]
    rows = np.unique(np.array(kept, dtype=int))
    return t[rows], y[rows]


def time_series(name: str, t: Array, y: Array, colour: str, axis: str = "y", **more: Any) -> Figure:
    line = {"color": colour, "width": 1.4}
    return scatter(name, *decimate(t, y), **({"yaxis": axis, "line": line} | more))


def scatter(name: str, x: Array, y: Array, **more: Any) -> Figure:
    """A trace of plotly: by default a line."""
    packed = {"x": pack_array(x), "y": pack_array(y)}
    return {"type": "scatter", "mode": "lines", "name": name, **packed, **more}


def pack_array(values: NDArray[Any]) -> dict[str, str]:
    """Plotly's typed array, as binary float32."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}


def height_traces(trace: Trace) -> list[Figure]:
    s, hidden = trace.samples, {"visible": "legendonly"}
    dotted = {"line": {"color": FAINT, "width": 1.2, "dash": "dot"}}
    return [
        time_series("TCP z", s.t, s.pose_world_tcp[:, 2], Z, "y2", opacity=0.6),
        time_series("fingertips z", s.t, tip_height(s, trace.hand), MARK, "y2"),
        time_series("commanded z", s.t, s.target_world_tcp[:, 2], FAINT, "y2", **dotted),
        time_series("TCP x", s.t, s.pose_world_tcp[:, 0], X, "y2", **hidden),
        time_series("TCP y", s.t, s.pose_world_tcp[:, 1], Y, "y2", **hidden),
        time_series("finger opening", s.t, s.width, NORM, "y2", **hidden),
    ]


def contact_traces(trace: Trace) -> list[Figure]:
    """Marks of the contacts of guarded motions."""
    touches = trace.leaf_runs("MoveUntilContact")
    if not touches or not len(trace.samples):
        return []
    # A contact ends its motion: draw it at the height of the fingertips then.
    times = np.array([leaf.end for leaf in touches])
    heights = np.interp(times, trace.samples.t, tip_height(trace.samples, trace.hand))
    mark = {"symbol": "circle-open", "size": 13, "color": MARK, "line": {"width": 2.5}}
    return [scatter("contact", times, heights, mode="markers", yaxis="y2", marker=mark)]


def leaf_bars(leaves: Sequence[LeafRun], groups: Mapping[str, str]) -> Figure:
    """Make a bar for each leaf, from its first tick to its last."""
    # Colour by group and status, lane by overlap.
    colours: list[str] = []
    lanes: list[int] = []
    busy_until: list[float] = []
    for leaf in leaves:
        colour = GROUPS.get(groups.get(leaf.primitive, ""), NORM)
        colours.append({"FAILURE": FAILED, "INVALID": STOPPED}.get(leaf.status, colour))
        # Leaves of a Parallel overlap in time: each takes the first lane that is free.
        lane = first_free_lane(busy_until, leaf.start + 1e-6)
        busy_until[lane : lane + 1] = [leaf.end]
        lanes.append(lane)
    return {
        "type": "bar",
        "orientation": "h",
        "name": "leaf",
        "yaxis": "y3",
        "showlegend": False,
        "base": [leaf.start for leaf in leaves],
        "x": [max(leaf.end - leaf.start, NARROWEST) for leaf in leaves],
        "y": lanes,
        "text": [escape(leaf.primitive) for leaf in leaves],
        "textposition": "inside",
        "insidetextanchor": "middle",
        "textangle": 0,
        "insidetextfont": {"color": "#fff"},
        "marker": {"color": colours, "line": {"width": 1, "color": "rgba(255,255,255,0.7)"}},
        "customdata": [
            (escape(leaf.label), leaf.status.lower(), round(leaf.end - leaf.start, 2))
            for leaf in leaves
        ],
        "hovertemplate": "%{customdata[0]}: %{customdata[1]}, %{customdata[2]} s<extra></extra>",
    }


def first_free_lane(busy_until: Sequence[float], time: float) -> int:
    """The first lane that is free at `time`, or a new one after the last."""
    return next((lane for lane, end in enumerate(busy_until) if end <= time), len(busy_until))


def background_shapes(leaves: Sequence[LeafRun], windows: Iterable[Recording]) -> list[Figure]:
    """Make a dotted line at the start of each leaf, and a shaded box for each recording."""
    dotted = {"line": {"color": FAINT, "width": 0.6, "dash": "dot"}}
    shaded = {"fillcolor": MARK, "opacity": 0.16, "line": {"color": MARK, "width": 1}}
    starts = sorted({leaf.start for leaf in leaves})
    lines = [_shape("line", t, t, LEAF_ROW[1], **dotted) for t in starts]
    return lines + [_shape("rect", r.start, r.end, HEIGHT_ROW[0], **shaded) for r in windows]


def _shape(kind: str, start: float, end: float, bottom: float, **style: Any) -> Figure:
    """Make a shape behind the curves, from `start` to `end` (s) and from `bottom` (share of the
    figure's height) to the top.
    """
    place = {"x0": start, "x1": end, "y0": bottom, "y1": 1}
    return {"type": kind, "xref": "x", "yref": "paper", "layer": "below", **place, **style}


def window_names(windows: Mapping[Recording, str], span: float) -> list[Figure]:
    """Place a name above each window, on the first of three lines where it overlaps no other."""
    taken_until = [-np.inf] * 3
    # Greedy placement in order of time; a name that fits nowhere shares the last line.
    out: list[Figure] = []
    for recording, name in sorted(windows.items(), key=lambda item: item[0].start):
        line = min(first_free_lane(taken_until, recording.start), len(taken_until) - 1)
        # A character takes about 0.8 % of the figure's width.
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
