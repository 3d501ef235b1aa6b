"""Feedback repairs: a model that does to the letter what the findings say ends at a valid plan, and
never comes back to one that it has had."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from loopback import Loopback, Request, Says
from plans import answer, move, sequence

from palpate.planning.check.check import check
from palpate.planning.model.planner import VlmPlanner
from palpate.planning.model.settings import ModelSettings
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

pytest.importorskip("pydantic_ai")

TRAY = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="tray" pos="0.50 0 0.10"><geom type="box" size=".08 .08 .02"/></body>
  <body name="jar" pos="0.50 0 0.18"><freejoint/><geom type="cylinder" size=".03 .06"/></body>
</worldbody></mujoco>"""
"""An x_offset of the jar is 10 mm: three of them are 30.0 mm, six lead off the tray."""

PROPOSED = re.compile(
    r"^- (\S+), [\w-]+: .*?(?:write MovePose '([^']+)'|'([^']+)' is within reach)", re.MULTILINE
)


@pytest.fixture(autouse=True)
def _key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-x")


@pytest.fixture(scope="module")
def tray() -> Scene:
    return parse_scene(TRAY, poses="offsets: {jar: {x_offset: 0.00999, y_offset: 0.00999}}")


def sliding(factor: float) -> str:
    """The jar weighed and slid by some x_offsets."""
    slide = {
        "type": "Parallel",
        "children": [move(f"jar_pose + {factor:g}*x_offset"), {"type": "MeasureForces"}],
    }
    return answer(
        move("jar_pose + z_offset"),
        move("jar_pose"),
        {"type": "CloseGripper"},
        move("jar_pose + z_offset"),
        sequence({"type": "MeasureForces"}, {"type": "Force2Mass"}),
        move("jar_pose"),
        slide,
        move("jar_pose"),
        {"type": "OpenGripper"},
        move("jar_pose + z_offset"),
        parameters=("jar.mass", "jar.friction"),
    )


def obedient(first: str) -> Loopback:
    """A model that answers `first`, and puts the poses of the findings where they say."""
    document: dict[str, Any] = json.loads(first)

    def reply(request: Request) -> Says:
        for path, slide, nearer in PROPOSED.findall(request.user):
            _first_motion(document, path)["pose"] = slide or nearer
        return Says(json.dumps(document))

    return Loopback(answer=reply)


def _first_motion(document: dict[str, Any], path: str) -> dict[str, Any]:
    """The MovePose at a path such as `tree.children[8]`, or the first below it."""
    node = document["tree"]
    for index in re.findall(r"\[(\d+)\]", path):
        node = node["children"][int(index)]
    while node["type"] != "MovePose":
        node = next(child for child in node["children"] if child["type"] != "MeasureForces")
    return node


@pytest.mark.parametrize("factor", [6, 4, 3, 2, 1, -3, 30])
def test_a_slide_is_right_after_one_round_wherever_it_began(factor: float, tray: Scene) -> None:
    first = sliding(factor)
    with obedient(first) as server:
        asked = VlmPlanner("openai", ModelSettings(base_url=server.url("openai"), rounds=2))
        plan = asked.plan("How slippery and heavy is the jar?", tray)
    assert check(plan, tray) == ()
    assert len(server.requests) <= 2


def test_two_faults_are_told_at_once_and_mended_at_once(tray: Scene) -> None:
    document = json.loads(sliding(1))
    document["tree"]["children"][2]["pose"] = "jar_pose + 12*z_offset"
    with obedient(json.dumps(document)) as server:
        asked = VlmPlanner("openai", ModelSettings(base_url=server.url("openai"), rounds=1))
        assert check(asked.plan("How slippery and heavy is the jar?", tray), tray) == ()
    assert len(server.requests) == 2
