"""Feedback repairs: a model that does to the letter what the findings say ends at a valid plan, and
never comes back to one that it has had."""

from __future__ import annotations

import json

import pytest
from breaches import FAULTS, Fault
from obedient import Model, served
from plans import answer, move, sequence

from palpate.planning.check.check import CATALOGUE, check
from palpate.planning.model.conversation import Answer, Conversation
from palpate.planning.model.planner import VlmPlanner
from palpate.planning.model.rounds import converse
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

pytest.importorskip("pydantic_ai")

TRAY = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="tray" pos="0.50 0 0.10"><geom type="box" size=".08 .08 .02"/></body>
  <body name="jar" pos="0.50 0 0.18"><freejoint/><geom type="cylinder" size=".03 .06"/></body>
</worldbody></mujoco>"""
"""An x_offset of the jar is 10 mm: three of them are 30.0 mm, six lead off the tray."""


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


@pytest.mark.parametrize("factor", [6, 4, 3, 2, 1, -3, 30])
def test_a_slide_is_right_after_one_round_wherever_it_began(factor: float, tray: Scene) -> None:
    with served(Model(sliding(factor))) as server:
        asked = VlmPlanner("openai", ModelSettings(base_url=server.url("openai"), rounds=2))
        plan = asked.plan("How slippery and heavy is the jar?", tray)
    assert check(plan, tray) == ()
    assert len(server.requests) <= 2


def test_two_faults_are_reported_together_and_mended_together(tray: Scene) -> None:
    document = json.loads(sliding(1))
    document["tree"]["children"][2]["pose"] = "jar_pose + 12*z_offset"
    with served(Model(json.dumps(document))) as server:
        asked = VlmPlanner("openai", ModelSettings(base_url=server.url("openai"), rounds=1))
        assert check(asked.plan("How slippery and heavy is the jar?", tray), tray) == ()
    assert len(server.requests) == 2


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_the_findings_mend_every_broken_rule_in_two_rounds(fault: Fault) -> None:
    scene, model, planner = fault.scene(), Model(fault.answer()), VlmPlanner("openai")
    answer_text: list[list[str]] = []

    def judged(text: str) -> tuple[Plan | None, list[str]]:
        plan, findings = planner.judge(text, scene, fault.request)
        answer_text.append(findings)
        return plan, findings

    kept = Conversation("obedient:model", "")
    plan = converse(kept, "R", lambda message: Answer(model.said(message)), judged, rounds=2)
    assert any(f", {fault.rule}: " in finding for finding in answer_text[0]), answer_text[0]
    assert len(set(model.answers)) == len(model.answers), "it comes back to what it had"
    assert (plan.tree is None) == (fault.steps is None and fault.root is None)
    assert plan.tree is None or plan.parameters


def test_every_rule_has_a_plan_that_breaks_it() -> None:
    assert {fault.rule for fault in FAULTS} == CATALOGUE.keys()
