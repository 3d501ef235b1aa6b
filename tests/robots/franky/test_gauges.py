"""The page's calibration with gauges, on a served arm."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.cli.app import app
from palpate.robots.robot_config import read_config
from tests.fci.served import ROOT, served

pytestmark = pytest.mark.long

pytest.importorskip("franky", reason="franky-control has no wheel for this machine")

PAGE = (ROOT / "docs" / "franka.md").read_text(encoding="utf-8")


def test_the_page_s_gauges_tell_where_the_fingertips_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (scene,) = [
        xml for xml in re.findall(r"<mujoco>.*?</mujoco>", PAGE, re.DOTALL) if "gauge1" in xml
    ]
    (line,) = re.findall(r"palpate (calibrate --gauge .*--robot) URL", PAGE)
    Path("gauges.xml").write_text(scene, encoding="utf-8")
    Path("robot.yaml").write_text("palpate_robot: 1\narm: fr3\n", encoding="utf-8")
    with served(Path("gauges.xml").absolute(), fastest=1.0) as bench:
        words = [*line.split(), f"franky://{bench.address}", "--yes"]
        done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.stdout + done.stderr
    assert read_config(Path("robot.yaml")).tip_offset is not None
