"""What models answer on a bad day: each is read as the plan that was meant, or answered with a finding
that says what is wrong; nothing crashes, hangs or keeps a key."""

from __future__ import annotations

import logging
import time

import pytest
from hallucinated import FOUND, KEY, MEANT
from loopback import Loopback, Says
from plans import GOOD, REQUEST, SCENE

from palpate.planning.model.planner import VlmPlanner
from palpate.planning.model.rounds import feedback
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import parse_plan
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

pytest.importorskip("pydantic_ai")

PATIENCE = 30.0
"""s, ten times what the slowest takes on a busy computer."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return parse_scene(SCENE)


@pytest.fixture(autouse=True)
def _key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)


@pytest.mark.parametrize("kind", MEANT)
def test_a_plan_is_recognised_in_any_surrounding_text(kind: str, scene: Scene) -> None:
    plan, findings = VlmPlanner("openai").judge(MEANT[kind], scene, REQUEST)
    assert findings == []
    assert plan is not None
    assert plan.parameters == parse_plan(GOOD).parameters


@pytest.mark.parametrize("kind", FOUND)
def test_an_unreadable_answer_is_a_finding_that_names_the_fault(kind: str, scene: Scene) -> None:
    answer, message = FOUND[kind]
    started = time.monotonic()
    _, findings = VlmPlanner("openai").judge(answer, scene, REQUEST)
    assert time.monotonic() - started < PATIENCE
    assert any(message in finding for finding in findings), findings
    assert all(len(finding) > 15 for finding in findings)
    assert KEY not in feedback(findings)


def test_more_than_a_hundred_answers_are_tried() -> None:
    assert len(FOUND) + len(MEANT) > 150


@pytest.mark.parametrize(
    "kind", ["a key for a type", "a refusal", "huge joints", "a function of one primitive"]
)
def test_an_unreadable_answer_costs_one_round_of_feedback_and_no_key_is_kept(
    kind: str, scene: Scene, caplog: pytest.LogCaptureFixture
) -> None:
    answer, message = FOUND[kind]
    with Loopback(Says(answer), Says(GOOD)) as server, caplog.at_level(logging.DEBUG):
        planner = VlmPlanner("openai", ModelSettings(base_url=server.url("openai"), rounds=1))
        assert planner.plan(REQUEST, scene).tree is not None
    assert message in server.requests[1].user
    assert planner.conversation is not None
    assert KEY not in planner.conversation.dump() + caplog.text
