"""What is printed is whole, however narrow the terminal is."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.cli.console import out
from palpate.cli.show_stored import show_estimates
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, not_identified

from .conftest import TABLE, Answer, cube

HEIGHT, COM, LOST = (
    Parameter("table_with_a_long_name", "height"),
    Parameter("hammer", "com"),
    Parameter("cup", "mass"),
)
ESTIMATES = (
    Estimate.normal(HEIGHT, "m", 0.765271, 0.0002245, "Touched."),
    Estimate.normal(COM, "m", (0.0627, -0.0005, 0.0), (0.001, 0.0012, 0.009), "Held.", unseen=(2,)),
    not_identified(LOST, "kg", "The run ended before the cup was lifted."),
)
TRUTH = {HEIGHT: (0.765,), COM: (0.062, 0.0, 0.002)}
FIGURES = (
    "0.76527 ± 0.00022 m",
    "0.76483 … 0.76571",
    "0.0627 ± 0.0010 m",
    "-0.0005 ± 0.0012 m",
    "0.000 ± 0.009 m",
    "prior-dominated",
    "not identified",
)


def shown(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: str) -> str:
    monkeypatch.setenv("COLUMNS", width)
    if width:
        monkeypatch.setattr(out, "width", int(width))
    show_estimates(ESTIMATES, TRUTH)
    return capsys.readouterr().out


@pytest.mark.parametrize("width", ["200", "80", "60", "40", ""])
def test_figures_are_whole_at_every_width(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: str
) -> None:
    text = shown(monkeypatch, capsys, width)
    for figure in FIGURES:
        assert figure in text, figure
    assert "…" not in text.replace(" … ", "")
    if width:
        table = text.partition("prior-dominated hammer.com z:")[0]
        assert max(map(len, table.splitlines())) <= int(width)


def test_components_have_names_and_verdicts_of_their_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = shown(monkeypatch, capsys, "").splitlines()
    (z,) = [row for row in rows if row.startswith("hammer.com z")]
    assert z.split()[-2:] == ["prior-dominated", "0.002"]
    assert any(re.match(r"hammer.com x .* identified", row) for row in rows)
    (reason,) = [
        r for r in rows if r.startswith("prior-dominated hammer.com z: the recordings hardly")
    ]
    assert reason.endswith("as a whole it is not identified")
    assert "not identified cup.mass: The run ended before the cup was lifted." in rows


def test_a_gap_has_units_and_a_next_step(
    palpate: Callable[..., Answer], scene: Callable[..., Path]
) -> None:
    path = scene(cube())
    text = palpate("gap", path).out
    assert "height 0 m" in text
    assert text.endswith(f"measure what is missing:\n  palpate run --scene {path}\n")
    planned = palpate("plan", "--scene", path, "-r", "how heavy is the cube?").out
    command = f"palpate run --scene {path} -r 'how heavy is the cube?'"
    assert planned.endswith(f"let the arm carry it out:\n  {command}\n")
    kept = palpate("plan", "--scene", path, "--out", "plan.json").out
    assert kept.endswith(f"  palpate execute plan.json --scene {path}\n")


def test_an_empty_scene_says_what_it_lacks(palpate: Callable[..., Answer], tmp_path: Path) -> None:
    empty = tmp_path / "empty.xml"
    empty.write_text("<mujoco><worldbody/></mujoco>")
    text = palpate("gap", empty).out
    assert "no object and no surface" in text
    assert "palpate run" not in text


def test_a_run_of_which_nothing_was_asked_says_so(
    palpate: Callable[..., Answer], tmp_path: Path
) -> None:
    plan = {
        "parameters": [],
        "explanation": "The dial is to be read by a person.",
        "tree": {"type": "Sequence", "children": [{"type": "MoveJoints", "joints": "home_config"}]},
    }
    (tmp_path / "scene.xml").write_text(TABLE.format(bodies=cube()), encoding="utf-8")
    (tmp_path / "plan.json").write_text(json.dumps(plan), encoding="utf-8")
    ended = palpate(
        *("run", "scene.xml", "-r", "move home", "--planner", "replay:plan.json", "--fast"),
        *("--out", "folder"),
    )
    assert ended.status == 0
    assert "nothing was to be estimated: The dial is to be read by a person." in ended.out
