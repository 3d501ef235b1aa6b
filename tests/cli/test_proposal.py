"""Requests that are understood in part: proposed, never measured without a confirmation."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.cli.app import app

DESK = """<mujoco model="desk"><worldbody><site name="robot_base"/>
  <body name="desk" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6"/></body>
  <body name="mug" pos="0.5 0.1 0.05"><freejoint/><geom type="box" size=".03 .02 .05" friction="0.6"/></body>
</worldbody></mujoco>"""
REQUEST = "Find the mass of the mug for my zippy contraption."


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("desk.xml").write_text(DESK, encoding="utf-8")
    return "desk.xml"


@pytest.mark.parametrize("command", ["plan", "run"])
def test_a_proposal_is_in_the_json_and_nothing_moves(scene: str, command: str) -> None:
    done = CliRunner().invoke(app, [command, scene, "-r", REQUEST, "--json"])
    content = json.loads(done.stdout)
    assert done.exit_code == 3
    assert content["proposal"] == [{"object": "mug", "quantity": "mass"}]
    assert content["not_used"] == ["for my zippy contraption"]


def test_the_command_that_accepts_a_proposal_is_printed(scene: str) -> None:
    done = CliRunner().invoke(app, ["plan", scene, "-r", REQUEST])
    assert done.exit_code == 3
    assert "I understand: mass of mug. Not used: 'for my zippy contraption'." in done.stdout
    assert "palpate run --scene desk.xml -m mug.mass" in done.stdout


def test_a_named_parameter_is_planned(scene: str) -> None:
    done = CliRunner().invoke(app, ["plan", scene, "-m", "mug.mass", "--json"])
    assert done.exit_code == 0
    assert json.loads(done.stdout)["parameters"] == [{"object": "mug", "quantity": "mass"}]
