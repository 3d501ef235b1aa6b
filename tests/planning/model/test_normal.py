"""Deformed plans whose meaning is clear: each, and any of them together, is the same plan."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from loopback import Loopback, Says
from plans import GOOD, HOME, OPEN, REQUEST, SCENE, answer, move, sequence, weighing

from palpate.common.errors import InputError
from palpate.planning.model.answer import read_answer
from palpate.planning.model.planner import VlmPlanner
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import MAX_NESTING, parse_plan
from palpate.scene.load import parse_scene

PROBE = sequence({"type": "MoveUntilContact", "axis": "-z"}, {"type": "MeasureGripperPose"})
TALL = answer(*weighing(), move("shelf_approach"), PROBE, parameters=("cup.mass", "shelf.height"))
LATE = json.dumps({"parameters": [], "explanation": 'It\'s "right".', "tree": sequence(HOME, OPEN)})
SOURCES = (GOOD, TALL, LATE)

Deform = Callable[[Any, int], Any]
"""Change of a document; the number chooses where."""


def each_node(change: Callable[[dict[str, Any]], dict[str, Any]]) -> Deform:
    """A change of every node, or of every other one."""

    def deformed(document: Any, seed: int) -> Any:
        count = iter(range(1_000_000))

        def go(node: Any) -> Any:
            if not isinstance(node, dict) or "type" not in node:
                return node
            node = dict(node)
            if isinstance(node.get("children"), list):
                node["children"] = [go(child) for child in node["children"]]
            return change(node) if (next(count) + seed) % 2 or seed > 50 else node

        return {**document, "tree": go(document["tree"])}

    return deformed


def boxed(name: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    def change(node: dict[str, Any]) -> dict[str, Any]:
        own = {key: node[key] for key in node if key in ("type", "children")}
        return {**own, name: {key: node[key] for key in node if key not in own}}

    return change


def snake(node: dict[str, Any]) -> dict[str, Any]:
    return {**node, "type": re.sub(r"(?<=[a-z])(?=[A-Z])", "_", node["type"]).lower()}


def capital(node: dict[str, Any]) -> dict[str, Any]:
    return {key: value.upper() if key == "axis" else value for key, value in node.items()}


def renamed(old: str, new: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda node: {new if key == old else key: value for key, value in node.items()}


def in_parameters(change: Callable[[dict[str, Any]], Any]) -> Deform:
    return lambda document, _: {
        **document,
        "parameters": [change(item) for item in document["parameters"]],
    }


UNITS = {"mass": "kg", "height": "m"}
NODES: dict[str, Deform] = {
    "args": each_node(boxed("args")),
    "arguments": each_node(boxed("arguments")),
    "snake case": each_node(snake),
    "axis in capitals": each_node(capital),
    "ids": each_node(lambda node: {"id": 3, **node}),
    "null children": each_node(lambda node: {"children": None, **node}),
}
"""Changes that leave a node's `type` where it is."""
LAST: dict[str, Deform] = {
    "as it is": lambda document, _: document,
    "action": each_node(renamed("type", "action")),
    "nodes": each_node(renamed("children", "nodes")),
    "root in the tree": lambda document, _: {**document, "tree": {"root": document["tree"]}},
    "a root node": lambda document, _: {
        **document,
        "tree": {"type": "Root", "children": [document["tree"]]},
    },
    "root for tree": lambda d, _: {("root" if k == "tree" else k): v for k, v in d.items()},
    "text": lambda document, _: {**document, "tree": json.dumps(document["tree"])},
    "a list": lambda document, _: {**document, "tree": document["tree"]["children"]},
    "flat without ids": lambda d, _: {
        ("nodes" if k == "tree" else k): [v] if k == "tree" else v for k, v in d.items()
    },
}
"""Changes after which no other is made."""
PARAMETERS: dict[str, Deform] = {
    "as it is": lambda document, _: document,
    "text": in_parameters(lambda one: f"{one['object']}.{one['quantity']}"),
    "units": in_parameters(
        lambda one: {**one, "quantity": f"{one['quantity']} {UNITS[one['quantity']]}"}
    ),
    "units in brackets": in_parameters(
        lambda one: f"{one['object']}.{one['quantity']} [{UNITS[one['quantity']]}]"
    ),
    "an object": lambda document, _: {
        **document,
        "parameters": {one["object"]: one["quantity"] for one in document["parameters"]},
    },
}
WRITTEN: dict[str, Callable[[Any], str]] = {
    "json": json.dumps,
    "indented": lambda document: json.dumps(document, indent=1),
    "python": str,
    "a fence": lambda document: f"Here:\n```json\n{json.dumps(document)}\n```\nIt's done.",
    "python in a fence": lambda document: f"Let's see:\n```python\n{document}\n```\nIt's done.",
    "a wrapper": lambda document: json.dumps({"plan": document}),
}


@given(
    st.sampled_from(SOURCES),
    st.lists(st.sampled_from(sorted(NODES)), unique=True, max_size=4),
    st.sampled_from(sorted(LAST)),
    st.sampled_from(sorted(PARAMETERS)),
    st.sampled_from(sorted(WRITTEN)),
    st.integers(0, 100),
)
@settings(max_examples=400, deadline=None)
def test_deformed_answers_whose_meaning_is_clear_are_the_same_plan(
    source: str, nodes: list[str], last: str, parameters: str, written: str, seed: int
) -> None:
    document = json.loads(source)
    if {"args", "arguments"} <= set(nodes):
        nodes.remove("args")
    for name in nodes:
        document = NODES[name](document, seed)
    document = LAST[last](PARAMETERS[parameters](document, seed), seed)
    assert read_answer(WRITTEN[written](document)).plan == parse_plan(source)


@pytest.mark.parametrize("kind", ["action", "nodes", "text", "root in the tree", "a root node"])
def test_a_clear_deformation_costs_no_round(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pydantic_ai")
    monkeypatch.setenv("OPENAI_API_KEY", "sk-0123456789abcdefghij")
    deformed = json.dumps(LAST[kind](json.loads(GOOD), 99))
    with Loopback(Says(deformed)) as server:
        asked = VlmPlanner("openai", ModelSettings(base_url=server.url("openai")))
        plan = asked.plan(REQUEST, parse_scene(SCENE))
    assert plan.tree == parse_plan(GOOD).tree
    assert len(server.requests) == 1


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"tree": '{"type": "Sequence", "type": "Parallel"}'}, "twice"),
        ({"tree": '{"a":' * MAX_NESTING + "1" + "}" * MAX_NESTING}, "nested deeper"),
        ({"tree": json.dumps(json.dumps(json.loads(GOOD)["tree"]))}, "must be a JSON object"),
        ({"tree": "__import__('os').getcwd()"}, "must be a JSON object"),
        ({"parameters": {"cup": {"mass": "kg"}}}, "must be text"),
        ({"parameters": ["cup.mass lb"]}, "is not a quantity"),
    ],
)
def test_an_ambiguous_form_stays_a_finding(changed: dict[str, Any], told: str) -> None:
    text = json.dumps(json.loads(GOOD) | changed)
    _, findings = VlmPlanner("openai").judge(text, parse_scene(SCENE), REQUEST)
    assert any(told in finding for finding in findings), findings


def test_fields_that_are_named_twice_are_refused_in_any_form() -> None:
    with pytest.raises(InputError, match="twice"):
        read_answer(GOOD.replace('"tree"', '"x": 1, "x": 2, "Tree"'))
