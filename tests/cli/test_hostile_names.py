"""A scene whose names hold what terminals, editors and browsers take for commands or line ends."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

from .conftest import Answer

UNSEEN = "\x85\x9b\u2028\u202e"
NAME = f"can{UNSEEN}2026 WARNING"
SCENE = """<mujoco><worldbody><site name="robot_base"/>
  <body name="table" pos=".45 0 .1"><geom type="box" size=".5 .6 .02" friction=".8"/></body>
  <body name="{name}" pos=".5 .12 .18"><freejoint/>
    <geom type="cylinder" size=".03 .06" {mass} friction=".8"/></body></worldbody></mujoco>"""


def test_a_name_is_shown_escaped_in_every_file(
    palpate: Callable[..., Answer], tmp_path: Path
) -> None:
    (tmp_path / "scene.xml").write_text(SCENE.format(name=NAME, mass=""), encoding="utf-8")
    (tmp_path / "world.xml").write_text(
        SCENE.format(name=NAME, mass='mass="0.3"'), encoding="utf-8"
    )
    scene = ("--scene", tmp_path / "scene.xml", "--world", tmp_path / "world.xml")
    run, log = tmp_path / "run", tmp_path / "log.txt"
    answer = palpate("run", *scene, "--out", run, "--log", log, "--fast", "--json")
    assert answer.status == 0, answer.err
    assert json.loads(answer.out)["parameters"][0]["object"] == NAME
    plan = json.loads((run / "plan.json").read_text("utf-8"))
    assert plan["parameters"][0]["object"] == NAME
    shown = [run / name for name in ("result.json", "plan.json", "request.json", "report.html")]
    for text in (answer.out, answer.err, *(path.read_text("utf-8") for path in [log, *shown])):
        assert not set(UNSEEN) & set(text)
    # Each record of the log begins with its time, each further line of it with a space.
    for line in log.read_text("utf-8").splitlines():
        assert re.match(r"\d{4}-\d\d-\d\d |    ", line)
