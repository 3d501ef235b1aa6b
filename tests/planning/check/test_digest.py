"""Findings with one cause are one line, here and over HTTP."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from loopback import Loopback, Says
from plans import GOOD, REQUEST, SCENE, answer, weighing

from palpate.planning.check.finding import Finding, digest
from palpate.planning.model.planner import VlmPlanner
from palpate.planning.model.settings import ModelSettings
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import scenario


def findings(text: str, scene: Scene) -> list[str]:
    _, result = VlmPlanner("openai").judge(text, scene, REQUEST)
    return result


def in_every_node(change: Callable[[dict[str, Any]], object]) -> str:
    document = json.loads(GOOD)

    def go(node: dict[str, Any]) -> None:
        change(node)
        for child in node.get("children", []):
            go(child)

    go(document["tree"])
    return json.dumps(document)


def test_a_blocked_grasp_is_one_finding_with_all_its_places() -> None:
    asked = scenario("occlusion").settings()
    text = answer(*weighing("light_blue_box"), parameters=("light_blue_box.mass",))
    (result,) = findings(text, load_scene(asked.scene))
    assert "carry it to 'red_box_temporary' first" in result
    assert "(the same at tree.children[7], tree.children[8])" in result


def test_a_strange_argument_of_every_node_is_one_short_finding() -> None:
    text = in_every_node(lambda node: node.update(comment="a step"))
    (result,) = findings(text, parse_scene(SCENE))
    assert "'comment' is not an argument of 14 nodes that have it" in result
    assert len(result) < 250


def test_a_harmless_id_of_every_node_is_no_finding() -> None:
    count = iter(range(100))
    text = in_every_node(lambda node: node.update(id=next(count)))
    assert findings(text, parse_scene(SCENE)) == []


def test_a_misspelt_argument_keeps_its_remedy() -> None:
    (result,) = findings(GOOD.replace('"pose"', '"posture"'), parse_scene(SCENE))
    assert "did you mean 'pose'?" in result
    assert "(the same at tree.children[3], " in result
    assert "tree.children[9]), " in result


def test_other_faults_stay_apart() -> None:
    both = [
        Finding("tree", "gripper-at-end", "the gripper is closed at the end; OpenGripper"),
        Finding("tree", "not-restored", "'cup' is left elsewhere; MovePose it back"),
    ]
    assert len(digest(both)) == 2


def test_the_message_to_the_model_has_each_cause_once(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pydantic_ai")
    monkeypatch.setenv("OPENAI_API_KEY", "sk-0123456789abcdefghij")
    text = in_every_node(lambda node: node.update(comment="a step"))
    with Loopback(Says(text), Says(GOOD)) as server:
        asked = VlmPlanner("openai", ModelSettings(base_url=server.url("openai")))
        asked.plan(REQUEST, parse_scene(SCENE))
    assert server.requests[1].user.count("\n- ") == 1
