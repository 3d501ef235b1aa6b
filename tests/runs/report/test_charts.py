"""Charts of what an estimate rests on, of recordings made by hand whose numbers are known."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from recordings import bench, noises

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FitView, constant, unit_slopes
from palpate.estimation.quantities.friction import estimate_friction
from palpate.estimation.quantities.height import estimate_height, estimate_tilt
from palpate.estimation.quantities.position import estimate_position
from palpate.estimation.quantities.size import estimate_size
from palpate.estimation.quantities.stiffness import estimate_stiffness
from palpate.runs.report.cards import estimate_card
from palpate.runs.report.charts import Chart, charts
from palpate.scene.load import parse_scene

__all__ = ["bench", "noises"]

CAN = """<mujoco><worldbody><site name="robot_base"/>
  <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".4 .5 .02"/></body>
  <body name="can" pos="0.5 0.1 0.06"><freejoint/><geom type="cylinder" size=".025 .06"/></body>
</worldbody></mujoco>"""


def named(chart: Chart, name: str) -> dict[str, Any]:
    (result,) = [item for item in chart.figure["data"] if item["name"].startswith(name)]
    return result


def values(packed: dict[str, str]) -> np.ndarray[Any, Any]:
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<f4")


def slope_of(chart: Chart) -> float:
    """Of its fit, between the ends."""
    fit = named(chart, "the fit")
    x, y = values(fit["x"]), values(fit["y"])
    return float((y[-1] - y[0]) / (x[-1] - max(x[0], 0.0)))


def shown(found: Estimate, truth: tuple[float, ...] | None = None) -> tuple[Chart, ...]:
    assert found.has_value
    drawn = charts(found, truth)
    for chart in drawn:
        assert go.Figure(chart.figure)
        low, high = chart.figure["layout"]["yaxis"]["range"]
        for item in chart.figure["data"]:
            y = values(item["y"])
            if item.get("mode") == "markers" and item.get("yaxis") == "y":
                assert ((y >= low) & (y <= high)).all(), "no point is off the axis"
    return drawn


def test_stiffness_is_the_slope_over_the_depth(bench, noises) -> None:
    b = bench(noises["lab"], 0)
    for y in (0.0, 0.1):
        b.go("mat_approach", (0.5, y, 0.32))
        b.descend(lambda z: max(0.0, 0.28 - z) * 1000.0, "mat")
    estimate = estimate_stiffness(b.trace(), Parameter("mat", "stiffness"), None)
    low, high = estimate.intervals[0] / 1000.0
    for chart in shown(estimate, (990.0,)):
        truth, band = named(chart, "the truth"), named(chart, "its 95 % interval")
        ends = [values(item["y"])[-1] / values(item["x"])[-1] for item in (truth, band)]
        assert ends == pytest.approx([0.99, high], rel=1e-3), "N/mm"
        assert high - low > 0.01
        assert len(values(named(chart, "measured")["x"])) > 50
        depth, force = (values(named(chart, "measured")[axis]) for axis in "xy")
        pressed = depth > 0.0
        slope = float(force[pressed] @ depth[pressed]) / float(depth[pressed] @ depth[pressed])
        assert slope == pytest.approx(slope_of(chart), rel=0.02), "N/mm"
        assert slope_of(chart) == pytest.approx(estimate.values[0] / 1000.0, rel=0.01), "N/mm"


def test_a_tilt_is_seen_from_the_side(bench, noises) -> None:
    b = bench(noises["lab"], 0)
    for x, y in ((0.45, -0.05), (0.55, -0.05), (0.45, 0.05)):
        top = 0.2653 + 0.03 * (x - 0.5) + 0.04 * y
        b.go("table_approach", (x, y, 0.32))
        b.descend(lambda z, top=top: max(0.0, top - z) * 4e4, "table")
    estimate = estimate_tilt(b.trace(), Parameter("table", "tilt"), None)
    (chart,) = shown(estimate)
    fit = named(chart, "the fit")
    x, y = values(fit["x"]), values(fit["y"])
    assert (y[-1] - y[0]) / (x[-1] - x[0]) == pytest.approx(0.05, abs=2e-3), "mm a mm, uphill"
    touches = named(chart, "a touch, ± 1 std")
    assert len(values(touches["x"])) == 3
    assert (values(touches["error_y"]["array"]) > 0.0).all()
    assert "rises most towards 53° from world x" in chart.note


@pytest.mark.parametrize(
    ("quantity", "estimate"), [("size", estimate_size), ("position", estimate_position)]
)
def test_a_grasp_is_shown_as_the_fingers_closed(bench, noises, quantity, estimate) -> None:
    b = bench(noises["lab"], 1)
    b.width = 0.08
    b.go("can_pose", (0.5, 0.1, 0.07))
    b.close("can", 0.0)
    b.width = 0.0502
    b.measure(0.3, "contact", "table", "gripper_pose")
    if quantity == "position":
        b.convert("Pose2Plan", "can", "position", b.trace().recordings[-1])
    body = parse_scene(CAN).bodies["can"]
    result = estimate(b.trace(), Parameter("can", quantity), body)
    (chart,) = shown(result)
    who = {"size": "between the fingers", "position": "the hand"}[quantity]
    whole, used = (item for item in chart.figure["data"] if item["name"].startswith(who))
    assert len(values(whole["x"])) > 50
    assert np.isnan(values(used["y"])).sum() > 50, "before it was recorded"
    assert named(chart, "its 95 % interval")


def test_drags_are_shown_with_their_breakaways(bench, noises) -> None:
    b = bench(noises["lab"], 0)
    b.go("can_pose + z_offset", (0.5, 0.1, 0.3))
    b.go("can_pose", (0.5, 0.1, 0.2))
    b.close("can", 0.3)
    b.go("can_pose + z_offset", (0.5, 0.1, 0.3))
    b.measure()
    b.go("can_pose", (0.5, 0.1, 0.2))
    for there in ((0.6, 0.1, 0.2), (0.5, 0.1, 0.2)):
        b.drag("place", there, 0.41, 0.34, (0.003, 0.012))
    b.open()
    b.go("can_pose + z_offset", (0.5, 0.1, 0.3))
    estimate = estimate_friction(b.trace(), Parameter("can", "friction"), None)
    forces, quotient = shown(estimate, (0.34,))
    fit = named(forces, "the fit")
    assert values(fit["y"]) / values(fit["x"]) == pytest.approx(float(estimate), rel=0.001)
    assert len(values(named(quotient, "breakaway")["x"])) == 2
    assert np.isnan(values(named(quotient, "smoothed, used")["y"])).any()


def test_a_height_is_carried_back_along_the_loading_curve(bench, noises) -> None:
    b = bench(noises["lab"], 0)
    for y in (0.0, 0.1):
        b.go("table_approach", (0.5, y, 0.32))
        b.descend(lambda z: max(0.0, 0.28 - z) * 4e4, "table")
    b.convert("Pose2Height", "table", "height", b.trace().recordings[-1])
    estimate = estimate_height(b.trace(), Parameter("table", "height"), None)
    side, *curves = shown(estimate, (0.28,))
    assert side.title == "The 2 touches, from the side."
    assert len(curves) == 2
    for chart in curves:
        fit = named(chart, "the fit")
        at_no_force = values(fit["y"])[values(fit["x"]) <= 0.0]
        assert at_no_force == pytest.approx(1e3 * float(estimate), abs=0.01), "mm"


def test_a_chart_that_fails_costs_nothing_else(bench, noises, monkeypatch, caplog) -> None:
    b = bench(noises["lab"], 0)
    for y in (0.0, 0.1):
        b.go("mat_approach", (0.5, y, 0.32))
        b.descend(lambda z: max(0.0, 0.28 - z) * 1000.0, "mat")
    estimate = estimate_stiffness(b.trace(), Parameter("mat", "stiffness"), None)
    broken = replace(estimate.views[0], predicted=np.zeros(1))
    assert len(charts(replace(estimate, views=(broken, estimate.views[1])))) == 1
    assert "no chart of mat.stiffness: " in caplog.text


def test_chart_and_card_show_one_value_also_at_a_bound() -> None:
    x = np.array([1.0, 2.0, 3.0])
    view = FitView(
        name="Mass by part.",
        note="",
        axes=("robot time (s)", "mass (kg)"),
        x=x,
        measured=np.array([-0.004, 0.001, -0.003]),
        predicted=constant(-0.002, x),
        std=0.004,
        slopes=unit_slopes(x),
    )
    light = Estimate.normal(Parameter("cup", "mass"), "kg", -0.002, 0.004, "", views=(view,))
    light, truth = light.bounded((0.0, np.inf)), (0.003,)
    (chart,) = charts(light, truth)
    card = estimate_card(light, truth, None, "estimate-1")
    (interval,) = card.intervals
    assert (interval.value, interval.std) == ("-0.002", "0.004")
    assert (interval.limit, interval.verdict) == ("at most 0.0066", "prior-dominated")
    assert card.estimate.doubt.startswith("at most 0.0066 kg (95 %): ")
    fit = named(chart, "the fit")
    assert fit["name"] == f"the fit, {interval.value} ± {interval.std} kg"
    assert values(fit["y"]) == pytest.approx(interval.number)
