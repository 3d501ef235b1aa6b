"""What stands in the sections of the page: windows, held-out predictions, checks, films."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from finished_run import MASS, SCENE

from palpate.planning.plan import Plan
from palpate.runs.held_out import Curve, HeldOut, HeldOutMotion
from palpate.runs.report.cards import parameter_groups
from palpate.runs.report.changes import diff_lines, evidence, windows
from palpate.runs.report.data import ReportData, twin_checks
from palpate.runs.report.sections import EDGE, HEIGHT, predictions
from palpate.runs.report.writing import FILMS, IMAGES, pictures_in
from palpate.scene.load import parse_scene
from palpate.trace.samples import Trace
from palpate.twin.validate import ReplayResidual, Validation


def test_a_window_is_named_once_by_its_evidence(data: ReportData, trace: Trace) -> None:
    weigh, touch = trace.recordings
    entries = windows(trace, data.run.estimates)
    assert entries == {weigh: "bottle mass", touch: "table height"}
    untold = windows(replace(trace, conversions=()), ())
    assert untold == {weigh: "still bottle", touch: "contact table"}


def test_a_window_states_its_situation_and_its_signal(trace: Trace) -> None:
    weigh, touch = (evidence(recording, trace) for recording in trace.recordings)
    assert weigh.what == "still, holding bottle, at bottle_pose + z_offset"
    assert weigh.reading.startswith("Fz = 2.4")
    assert weigh.reading.endswith(" N, 151 samples")
    assert touch.what == "contact, on table, at table_approach"
    assert touch.reading.startswith("fingertips z = 0.")
    assert " m, " in touch.reading


def held(weight: float) -> HeldOut:
    """A motion of four joints, of which the last three bear the more the later they stand."""
    t = (0.0, 0.1, 0.2)
    twin = tuple((0.0, 0.1 * k, 0.2 * k) for k in range(4))
    guess = tuple((0.0, 0.0, 0.0) for _ in range(4))
    curve = Curve(
        tuple(f"fr3_joint{k}" for k in range(1, 5)), t, twin, ((0.01,) * 3,) * 4, twin, guess
    )
    figures = {"chi2": 10.0, "dof": 9, "p": 0.35, "chi2_template": 800.0, "rms": 0.012}
    words = {"object": "bottle", "motion": "the way down", "start": 0.0, "end": 0.2}
    more = {"rms_template": 0.34, "weight_std": 0.002, "tests": ()}
    return HeldOut((HeldOutMotion(**words, **figures, **more, weight=weight, curve=curve),))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("weight", "way"), [(0.005, "5.0 ± 2.0 g more"), (-0.005, "5.0 ± 2.0 g less")]
)
def test_a_prediction_is_reported_in_figures(weight: float, way: str) -> None:
    (shown,) = predictions(held(weight))
    assert shown.title == "The way down"
    for words in (
        way,
        "predicted to 12 mN·m",
        "would have been 340 mN·m off",
        "χ² is 10 at 9 degrees",
    ):
        assert words in shown.text


def test_the_joints_that_bear_most_are_drawn_the_right_way_up() -> None:
    (shown,) = predictions(held(0.005))
    assert [panel.name for panel in shown.panels] == ["joint 2", "joint 3", "joint 4"]
    last = shown.panels[-1]
    assert (last.low, last.high, last.unit) == ("-0.01", "0.61", "N·m")
    heights = [float(point.split(",")[1]) for point in last.twin[0].split()]
    assert heights == sorted(heights, reverse=True), "y grows downwards in SVG"
    assert EDGE < heights[-1] < heights[0] < HEIGHT - EDGE
    assert all(point.low > point.y > point.high for point in last.points)
    assert set(last.template[0].split()) != set(last.twin[0].split())


def test_checks_tell_the_twin_from_the_scene_as_given() -> None:
    validation = Validation(
        True, 0.0004, ReplayResidual(0.02, None), ReplayResidual(1.5, 0.003, "one missing")
    )
    assert twin_checks(validation) == {
        "Comes to rest": "yes, after moving 0.40 mm",
        "Plan replayed in the twin": "off by 0.020 N",
        "Plan replayed in the scene as given": "off by 1.500 N, 3.00 mm, one missing",
    }
    assert twin_checks(replace(validation, settled=False))["Comes to rest"].startswith("no")


def test_requested_parameters_are_marked_in_the_scene() -> None:
    run: Any = SimpleNamespace(
        plan=Plan((MASS,), None, ""),
        scene=parse_scene(SCENE.replace('material="glass"', "")),
        estimates=(),
    )
    groups = parameter_groups(run).items()
    rows = {(name, row.quantity): (row.state, row.asked) for name, of in groups for row in of}
    assert rows["bottle", "mass"] == ("missing", True)
    assert rows["table", "height"] == ("missing", False)


def test_a_film_by_a_camera_comes_before_one_of_the_trace(tmp_path: Path) -> None:
    (tmp_path / IMAGES).mkdir()
    run: Any = SimpleNamespace(execution=SimpleNamespace(robot_seconds=10.0))
    for believed in (True, False):
        (tmp_path / IMAGES / FILMS[believed]).write_bytes(b"%d" % believed)
        film = pictures_in(tmp_path, run).film
        assert film is not None
        assert (film.believed, film.mp4) == (believed, b"%d" % believed)


def test_lines_that_others_replace_are_set_off_only_one_to_one() -> None:
    (shorter, longer) = diff_lines('-mass="11"\n+mass="111"\n')
    assert (shorter.text, longer.text) == ('mass="11"', 'mass="111"')
    assert (shorter.middle, longer.middle) == ("", "1")
    (old, new) = diff_lines("--- a\n+++ b\n-mass=1\n+mass=2\n")
    assert (old.kind, old.middle, new.middle) == ("del", "1", "2")
    lines = diff_lines("-one line\n+two\n+lines\n same\n")
    assert [line.kind for line in lines] == ["del", "add", "add", "same"]
    assert not any(line.middle for line in lines)
