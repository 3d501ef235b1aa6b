"""A quantity of one's own from end to end, in a palpate of its own process: an object whose file
leaves its rolling friction open is dragged, and the twin states it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

PACKAGE = Path(__file__).parents[1] / "estimation" / "quantities" / "rolling"
RUN = ("--scene", "desk.xml", "--noise", "none", "--out", "run", "--fast")
SCENE = """<mujoco model="desk"><worldbody>
  <site name="robot_base" pos="0 0 0.3"/>
  <geom name="table" type="box" pos="0.5 0 0.28" size="0.3 0.4 0.02"/>
  <body name="block" pos="0.5 0 0.33"><freejoint/>
    <geom type="box" size="0.03 0.03 0.03" mass="0.2" friction="0.4 0.005 ?"/></body>
</worldbody></mujoco>"""


def test_rolling_friction_gets_from_a_question_mark_to_the_twin(tmp_path: Path) -> None:
    info = tmp_path / "site" / "palpate_rolling-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: palpate-rolling\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[palpate.quantities]\nrolling = palpate_rolling\n")
    (tmp_path / "desk.xml").write_text(SCENE)
    earlier = os.environ.get("PYTHONPATH")
    paths = [str(info.parent), str(PACKAGE), *([earlier] if earlier else [])]
    done = subprocess.run(
        [sys.executable, "-m", "palpate.cli.main", "run", *RUN],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "MUJOCO_GL": "disabled"},
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "run" / "result.json").read_text("utf-8"))
    assert [(p["object"], p["quantity"], p["verdict"]) for p in result["parameters"]] == [
        ("block", "rolling_friction", "identified")
    ]
    assert result["parameters"][0]["value"] == pytest.approx(5e-4)
    twin = (tmp_path / "run" / "twin.xml").read_text("utf-8")
    assert 'friction="0.4 0.005 0.000500" condim="6"' in twin
