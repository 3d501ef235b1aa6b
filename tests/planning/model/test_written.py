"""What models write for JSON: each is a repair or one clear finding, and takes a bounded time."""

from __future__ import annotations

import json
import time
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import GOOD, REQUEST, SCENE

from palpate.planning.model.planner import VlmPlanner
from palpate.planning.model.rounds import MAX_FINDING, feedback
from palpate.planning.plan import MAX_BYTES, parse_plan
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

PLAN = json.loads(GOOD)
PRETTY = json.dumps(PLAN, indent=2)
PATIENCE = 20.0
"""s, ten times what the slowest takes on a busy computer."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return parse_scene(SCENE)


def changed(**fields: object) -> str:
    return json.dumps(PLAN | fields)


def with_nodes() -> str:
    """The plan in the flat form, its numbers written as text."""
    nodes: list[dict[str, object]] = []

    def add(node: dict) -> str:
        own = {key: value for key, value in node.items() if key != "children"}
        nodes.append({"id": str(len(nodes)), **own})
        expected = nodes[-1]
        expected["children"] = [add(child) for child in node.get("children", [])]
        return str(expected["id"])

    add(PLAN["tree"])
    return json.dumps({**{k: v for k, v in PLAN.items() if k != "tree"}, "nodes": nodes})


REPAIRED: dict[str, str] = {
    "fenced": f"```json\n{PRETTY}\n```",
    "fenced without a language, and prose": f"Sure!\n```\n{GOOD}\n```\nLet me know {{if}} it works.",
    "line comments": PRETTY.replace('"tree":', '// the tree\n  "tree":').replace(
        '"OpenGripper"', '"OpenGripper" // open it'
    ),
    "block comments": PRETTY.replace('"tree":', '/* "tree": null, */ "tree":'),
    "a comment after the brace": PRETTY.replace("{", "{ // plan", 1),
    "a quote in prose": f'It is 5" wide: {PRETTY.replace("]", ", ]")}',
    "trailing commas": PRETTY.replace("}\n", "},\n").replace("},\n}", "}\n}").rstrip(","),
    "python's words": GOOD.replace('"explanation"', '"notes": [], "x": None, "explanation"'),
    "blanks of other kinds": PRETTY.replace("  ", "\u00a0 "),
    "byte order mark": "\ufeff" + GOOD,
    "fields in other cases": GOOD.replace('"tree"', '"Tree"')
    .replace('"children"', '"Children"')
    .replace('"type"', '"Type"')
    .replace('"parameters"', '"PARAMETERS"')
    .replace('"quantity"', '"Quantity"'),
    "outcome in another case": changed(outcome="Measure"),
    "parameters as text": changed(parameters=["cup.mass"]),
    "a list for the root": changed(tree=PLAN["tree"]["children"]),
    "null children": GOOD.replace(
        '{"type": "OpenGripper"}', '{"type": "OpenGripper", "children": null}'
    ),
    "unknown fields beside": changed(confidence=0.9, reasoning={"step": 1}),
    "numbers as text in the flat form": with_nodes(),
    "unicode in words": changed(explanation="Die Tasse wiegt … 咖啡 ☕ ‰"),
    "a primitive in another case": GOOD.replace("MeasureForces", "measure_forces"),
    "arguments in an object": GOOD.replace('"pose": "cup_pose"', '"args": {"pose": "cup_pose"}', 1),
    "a draft before": f"{changed(tree=None)}\nBetter:\n{GOOD}",
}


@pytest.mark.parametrize("kind", REPAIRED)
def test_an_unambiguous_deviation_is_repaired(kind: str, scene: Scene) -> None:
    plan, findings = VlmPlanner("openai").judge(REPAIRED[kind], scene, REQUEST)
    assert findings == []
    assert plan is not None
    assert plan.tree == parse_plan(GOOD).tree


FOUND: dict[str, tuple[str, str]] = {
    "cut short": (GOOD[: len(GOOD) // 2], "breaks off"),
    "cut short in a fence": (f"```json\n{PRETTY[:-200]}\n```", "is not valid"),
    "typographic quotes": (GOOD.replace('"', "“"), "double quotes"),
    "a number as text where none is": (
        GOOD.replace('"pose": "cup_pose"', '"pose": "cup_pose", "speed": "fast"', 1),
        "MovePose: 'speed'",
    ),
    "a field too much": (
        GOOD.replace('"axis"', '"x"').replace('"OpenGripper"', '"OpenGripper", "width": 80', 1),
        "'width'",
    ),
    "a word for a tree": (changed(tree="Sequence"), "must be a JSON object"),
    "an unknown outcome": (changed(outcome="success"), "must be one of"),
    "words for parameters": (changed(parameters="the cup's mass"), "must be a list"),
    "half a surrogate pair": (changed(explanation="\ud83d"), "surrogate"),
    "deep": (
        '{"tree": ' + '{"type": "Sequence", "children": [' * 40 + "]}" * 40 + "}",
        "nested deeper",
    ),
    "very deep": ('{"tree": ' + "[" * 100_000, "nested deeper"),
    "a tree of lists": ('{"parameters": [], "tree": ' + "[" * 60 + "]" * 60 + "}", "nested"),
    "too long": ("x" * (MAX_BYTES + 1), "characters"),
    "two trees in one": (GOOD.replace('"tree"', '"tree": null, "tree"'), "twice"),
}


@pytest.mark.parametrize("kind", FOUND)
def test_an_ambiguous_deviation_is_a_finding(kind: str, scene: Scene) -> None:
    text, message = FOUND[kind]
    _, findings = VlmPlanner("openai").judge(text, scene, REQUEST)
    assert any(message in finding for finding in findings), findings
    assert len(feedback(findings)) < 25 * MAX_FINDING


@pytest.mark.parametrize(
    "text",
    [
        "/*" * 400_000,
        '{"tree": /*' * 60_000,
        "{" * 900_000,
        '{"' * 400_000,
        '{"a": "' * 100_000,
        '{"tree": [' + "1," * 400_000,
        ", " * 450_000 + "}",
        "{" + " " * 900_000,
        '"\\' * 400_000,
        '{"' + '\\"' * 49_000,
        '{"tree": "' + '\\"' * 400_000,
        "{'" + "\\'" * 49_000,
        "{'tree':" * 12_000,
    ],
    ids=lambda text: text[:12],
)
def test_a_hostile_answer_is_read_in_a_bounded_time(text: str, scene: Scene) -> None:
    started = time.monotonic()
    plan, findings = VlmPlanner("openai").judge(text, scene, REQUEST)
    assert time.monotonic() - started < PATIENCE
    assert plan is None
    assert findings


def swapped(text: str, places: list[int], words: str) -> str:
    for place in places:
        at = place % len(text)
        text = text[:at] + words + text[at + len(words) :]
    return text


def cut(text: str, places: list[int], words: str) -> str:
    return text[: places[0] % len(text)] + words


def doubled(text: str, places: list[int], words: str) -> str:
    at = places[0] % len(text)
    return text[:at] + words + text[at:]


@given(
    st.sampled_from([swapped, cut, doubled]),
    st.sampled_from([GOOD, PRETTY, with_nodes()]),
    st.lists(st.integers(0, 100_000), min_size=1, max_size=4),
    st.sampled_from(
        ["{", "}", "[", "]", '"', ",", ":", "//", "/*", "\\", "null", "'", "1e999", "…"]
    )
    | st.text(max_size=6),
)
@settings(max_examples=150, deadline=None)
def test_a_damaged_answer_is_a_plan_or_a_finding(
    scene: Scene, how: Callable[..., str], text: str, places: list[int], words: str
) -> None:
    plan, findings = VlmPlanner("openai").judge(how(text, places, words), scene, REQUEST)
    assert plan is not None or len(findings) == 1
    assert all(len(finding) > 15 for finding in findings)
