"""Charts of what an estimate rests on, of recordings made by hand whose numbers are known."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from recordings import bench, noises

from palpate.estimation.estimate import Estimate
from palpate.parameter import Parameter
from palpate.quantities.friction import estimate_friction
from palpate.quantities.height import estimate_tilt
from palpate.quantities.position import estimate_position
from palpate.quantities.size import estimate_size
from palpate.quantities.stiffness import estimate_stiffness
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart
from palpate.report.evidence.charts import CHARTS, charts
from palpate.scene.load import parse_scene

__all__ = ["bench", "noises"]

CAN = """<mujoco><worldbody><site name="robot_base"/>
  <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".4 .5 .02"/></body>
  <body name="can" pos="0.5 0.1 0.06"><freejoint/><geom type="cylinder" size=".025 .06"/></body>
</worldbody></mujoco>"""


def slope_of(chart: Chart) -> float:
    """Of its fit, in the units of its ticks."""
    (fit,) = [line for line in chart.lines if line.kind == "fit"]
    (x1, y1), *_, (x2, y2) = [tuple(map(float, point.split(","))) for point in fit.points.split()]
    across, up = _scale(chart.x_ticks), _scale(chart.y_ticks)
    return (up(y2) - up(y1)) / (across(x2) - across(x1))


def _scale(ticks: tuple) -> Callable[[float], float]:
    numbers = [float(tick.text.replace("−", "-")) for tick in ticks]
    places = [tick.at for tick in ticks]
    rate = (numbers[-1] - numbers[0]) / (places[-1] - places[0])
    return lambda at: numbers[0] + rate * (at - places[0])


def shown(found: Estimate, trace, truth: tuple[float, ...] | None = None) -> tuple[Chart, ...]:
    assert found.has_value
    drawn = charts(Measured(found, truth), trace)
    for chart in drawn:
        for dot in chart.dots:
            assert -5 <= dot.x <= 105
            assert -5 <= dot.y <= 105
    return drawn


def test_stiffness_is_the_slope_over_the_depth(bench, noises) -> None:
    b = bench(noises["lab"], 0)
    for y in (0.0, 0.1):
        b.go("mat_approach", (0.5, y, 0.32))
        b.descend(lambda z: max(0.0, 0.28 - z) * 1000.0, "mat")
    found = estimate_stiffness(b.trace(), Parameter("mat", "stiffness"), None)
    one, other = shown(found, b.trace(), (1000.0,))
    for chart in (one, other):
        assert slope_of(chart) == pytest.approx(found.values[0] / 1000.0, rel=0.01), "N/mm"
        assert {line.kind for line in chart.lines} == {"felt", "fit", "truth"}
        assert len(chart.dots) == 1


def test_a_tilt_is_seen_from_the_side(bench, noises) -> None:
    b = bench(noises["lab"], 0)
    for x, y in ((0.45, -0.05), (0.55, -0.05), (0.45, 0.05)):
        top = 0.2653 + 0.03 * (x - 0.5) + 0.04 * y
        b.go("table_approach", (x, y, 0.32))
        b.descend(lambda z, top=top: max(0.0, top - z) * 4e4, "table")
    found = estimate_tilt(b.trace(), Parameter("table", "tilt"), None)
    (chart,) = shown(found, b.trace())
    assert slope_of(chart) == pytest.approx(0.05, abs=2e-3), "mm a mm, along the way uphill"
    assert len(chart.dots) == 3
    assert "rises most towards 53° from world x" in chart.said


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
    found = estimate(b.trace(), Parameter("can", quantity), body)
    (chart,) = shown(found, b.trace())
    (line,) = [line for line in chart.lines if line.kind == "felt"]
    assert len(line.points.split()) > 50
    assert {band.kind for band in chart.bands} == {"interval", "loaded"}


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
    found = estimate_friction(b.trace(), Parameter("can", "friction"), None)
    forces, quotient = shown(found, b.trace(), (0.34,))
    assert slope_of(forces) == pytest.approx(float(found.values[0]), rel=0.02)
    assert [dot.kind for dot in quotient.dots] == ["down", "down"]


def test_a_chart_that_fails_costs_nothing_else(bench, noises, monkeypatch, caplog) -> None:
    def broken(*_: object) -> tuple[Chart, ...]:
        raise AttributeError("no such thing")

    b = bench(noises["lab"], 0)
    b.go("mat_approach", (0.5, 0.0, 0.32))
    b.descend(lambda z: max(0.0, 0.28 - z) * 1000.0, "mat")
    found = estimate_stiffness(b.trace(), Parameter("mat", "stiffness"), None)
    monkeypatch.setitem(CHARTS, "stiffness", broken)
    assert charts(Measured(found), b.trace()) == ()
    assert "no chart of mat.stiffness: AttributeError: no such thing" in caplog.text
