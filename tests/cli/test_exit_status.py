"""Exit status of a run, and the lines that explain it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from palpate.cli.app import app

BENCH = """<mujoco><worldbody><site name="robot_base"/>
  <body name="desk" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6"/></body>
  <body name="mug" pos="0.5 0.1 0.05"><freejoint/><geom type="box" size=".03 .02 .05" friction="0.6"/></body>
  <body name="crate" pos="0.5 -0.2 0.1"><freejoint/><geom type="box" size=".1 .1 .1" friction="0.6"/></body>
</worldbody></mujoco>"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("bench.xml").write_text(BENCH, encoding="utf-8")
    return "bench.xml"


def run(scene: str, *arguments: str) -> tuple[Result, dict[str, Any]]:
    fixed = ("--fast", "--json", "--noise", "none", "--out", "made")
    done = CliRunner().invoke(app, ["run", "--scene", scene, *arguments, *fixed])
    return done, json.loads(done.stdout)


@pytest.mark.parametrize(
    "asked",
    [("-m", "mug.mass,crate.mass"), ()],
)
def test_a_request_of_which_a_part_cannot_be_measured_ends_with_1(
    scene: str, asked: tuple[str, ...]
) -> None:
    done, result = run(scene, *asked)
    assert (done.exit_code, result["status"]) == (1, "failed")
    (line,) = result["shortfalls"]
    assert line.startswith("crate.mass: The mass of 'crate' cannot be measured: ")
    verdicts = {each["object"]: (each["verdict"], each["value"]) for each in result["parameters"]}
    assert verdicts["mug"][0] == "identified"
    assert verdicts["crate"] == ("not identified", None)
    assert line in done.stderr.replace("\n", " ")


def test_a_request_of_which_all_is_measured_ends_with_0(scene: str) -> None:
    done, result = run(scene, "-r", "is the mug heavier than 10 kg?")
    assert (done.exit_code, result["status"], result["shortfalls"]) == (0, "complete", [])
    assert result["answer"].startswith("no: 10 against mug 0.")


def test_a_request_of_which_nothing_can_be_measured_has_no_plan(scene: str) -> None:
    done, result = run(scene, "-m", "crate.mass")
    assert (done.exit_code, result["status"]) == (3, "rejected")


def test_a_refused_request_leaves_no_folder_unless_one_is_named(scene: str) -> None:
    asked = ["run", "--scene", scene, "-m", "crate.mass", "--fast", "--json"]
    done = CliRunner().invoke(app, asked)
    assert (done.exit_code, json.loads(done.stdout)["files"]) == (3, {})
    assert not Path("runs").exists()
    run(scene, "-m", "crate.mass")
    assert Path("made/report.html").exists()
