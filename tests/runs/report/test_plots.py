from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go
from hypothesis import given
from hypothesis import strategies as st

from palpate.runs.report.plots import MAX_POINTS, decimate, timeline
from palpate.trace.recording import Context, Recording
from palpate.trace.samples import FORCES, Trace


def values(packed: dict[str, str]) -> np.ndarray[Any, Any]:
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<f4")


def named(figure: dict[str, Any], name: str) -> dict[str, Any]:
    return next(series for series in figure["data"] if series["name"] == name)


def test_plotly_accepts_the_figure(trace: Trace) -> None:
    windows = dict.fromkeys(trace.recordings, "bottle mass")
    figure = go.Figure(timeline(trace, windows, {"MovePose": "motion"}))
    assert {s.name for s in figure.data} >= {
        "F<sub>x</sub>",
        "F<sub>z</sub>",
        "|F|",
        "fingertips z",
        "contact",
        "leaf",
    }


def test_series_are_short_and_keep_their_peaks(trace: Trace) -> None:
    force = named(timeline(trace, {}, {}), "F<sub>z</sub>")
    fz = values(force["y"])
    assert len(fz) <= MAX_POINTS < len(trace.samples)
    assert fz.max() == np.float32(trace.samples.wrench[:, 2].max())
    assert fz.min() == np.float32(trace.samples.wrench[:, 2].min())


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=400), st.integers(4, 100))
def test_decimation_keeps_order_extremes_and_limit(signal: list[float], limit: int) -> None:
    y = np.array(signal)
    t, kept = decimate(np.arange(len(y), dtype=float), y, limit)
    assert len(kept) <= max(limit, 1)
    assert (np.diff(t) > 0).all()
    assert (kept.min(), kept.max()) == (y.min(), y.max())
    np.testing.assert_array_equal(kept, y[t.astype(int)])


def test_the_contact_is_marked_at_the_fingertips(trace: Trace) -> None:
    contact = named(timeline(trace, {}, {}), "contact")
    touch = trace.leaf_runs("MoveUntilContact")[0].end
    z = (
        np.interp(touch, trace.samples.t, trace.samples.pose_world_tcp[:, 2])
        - trace.hand.tip_offset
    )
    assert values(contact["x"])[0] == np.float32(touch)
    np.testing.assert_allclose(values(contact["y"])[0], z, rtol=1e-6)


def test_windows_are_shaded_and_named(trace: Trace) -> None:
    weigh, touch = trace.recordings
    layout = timeline(trace, {weigh: "bottle mass", touch: "a<b"}, {})["layout"]
    shades = [s for s in layout["shapes"] if s["type"] == "rect"]
    assert [(s["x0"], s["x1"]) for s in shades] == [
        (weigh.start, weigh.end),
        (touch.start, touch.end),
    ]
    assert [a["text"] for a in layout["annotations"]] == ["bottle mass", "a&lt;b"]


def test_names_of_close_windows_do_not_cover_one_another(trace: Trace) -> None:
    windows = {
        Recording(FORCES, t, t + 0.3, Context("still")): "crate sliding friction"
        for t in (10.0, 10.4, 10.8, 25.0)
    }
    shifts = [a["yshift"] for a in timeline(trace, windows, {})["layout"]["annotations"]]
    assert len(set(shifts[:3])) == 3
    assert shifts[3] == 0


def test_leaves_that_run_together_lie_under_one_another(trace: Trace) -> None:
    slide, feel, after = trace.leaves[2:5]
    together = replace(
        trace, leaves=(slide, replace(feel, start=slide.start, end=slide.end), after)
    )
    assert named(timeline(together, {}, {}), "leaf")["y"] == [0, 1, 0]
