"""The plan as a file: what is read, what is refused, and that nothing unexpected escapes."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.planning.plan import Node, Plan, dump_plan, parse_plan, plan_from, plan_json

TREE = {
    "type": "Sequence",
    "name": "weigh",
    "children": [
        {"type": "MoveJoints", "joints": [0, 0.5, 0, -1, 0, 1, 0]},
        {
            "type": "Parallel",
            "children": [
                {"type": "MovePose", "pose": "bottle_pose - 0.5*x_offset"},
                {"type": "MeasureForces"},
            ],
        },
    ],
}
DOCUMENT: dict[str, Any] = {
    "parameters": [{"object": "bottle", "quantity": "mass"}],
    "explanation": "why",
    "tree": TREE,
}

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(
                ["type", "children", "tree", "parameters", "object", "quantity", "pose", "name"]
            )
            | st.text(),
            inner,
            max_size=5,
        )
    ),
    max_leaves=25,
)


def test_a_plan_is_read_with_its_paths():
    plan = parse_plan(json.dumps(DOCUMENT))
    assert plan.parameters == (Parameter("bottle", "mass"),)
    assert plan.tree is not None
    assert [path for path, _ in plan.tree.walk()] == [
        "tree",
        "tree.children[0]",
        "tree.children[1]",
        "tree.children[1].children[0]",
        "tree.children[1].children[1]",
    ]
    assert plan.tree.children[0].args == (("joints", (0, 0.5, 0, -1, 0, 1, 0)),)
    assert plan.tree.name == "weigh"
    assert plan.actions == 3


def test_a_written_plan_is_read_back_unchanged_and_the_same_every_time():
    plan = parse_plan(json.dumps(DOCUMENT | {"planner": "symbolic", "notes": ["n1"]}))
    assert parse_plan(dump_plan(plan)) == plan
    assert dump_plan(plan) == dump_plan(parse_plan(dump_plan(plan)))
    assert plan_from(plan_json(plan)) == plan


def test_plan_json_keeps_figures_of_the_run_next_to_the_plan():
    plan = parse_plan(json.dumps(DOCUMENT))
    text = dump_plan(plan, {"model": {"rounds": 2}, "findings": [], "tree": "not overwritten"})
    assert json.loads(text)["model"] == {"rounds": 2}
    assert parse_plan(text) == plan


def test_a_null_tree_is_an_answer():
    plan = parse_plan('{"parameters": [], "tree": null, "explanation": "no thermometer"}')
    assert plan == Plan((), None, "no thermometer")
    assert plan.actions == 0


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", "not JSON"),
        ("Sure! Here is the plan", "not JSON"),
        ("[]", "JSON object"),
        ("null", "JSON object"),
        ('{"tree": null}', "'parameters'"),
        ('{"parameters": []}', "'tree'"),
        ('{"parameters": {}, "tree": null}', "parameters must be a list"),
        ('{"parameters": [], "tree": []}', "tree must be a JSON object"),
        ('{"parameters": [], "tree": {"children": []}}', "'type'"),
        ('{"parameters": [], "tree": {"type": 3}}', "tree.type must be text"),
        (
            '{"parameters": [], "tree": {"type": "Sequence", "children": {}}}',
            "tree.children must be a list",
        ),
        ('{"parameters": [], "tree": {"type": "MovePose", "pose": {"x": 1}}}', "tree.pose"),
        ('{"parameters": [{"object": "bottle"}], "tree": null}', "parameters[0]"),
        ('{"parameters": [{"object": "b", "quantity": "mass", "why": ""}], "tree": null}', "'why'"),
        ('{"parameters": [], "tree": null, "tree": null}', "twice"),
        ('{"parameters": [], "tree": {"type": "MoveJoints", "joints": [NaN]}}', "NaN"),
        ('{"parameters": [], "tree": {"type": "MoveJoints", "joints": [-Infinity]}}', "Infinity"),
        ('{"parameters": [], "tree": {"type": "MoveJoints", "joints": [1e999]}}', "finite"),
        (
            '{"parameters": [], "tree": {"type": "MoveJoints", "joints": [' + "9" * 5000 + "]}}",
            "JSON",
        ),
        ('{"parameters": [], "tree": {"type": "\\ud800"}}', "surrogate"),
    ],
)
def test_a_document_that_is_no_plan_is_refused_in_one_message(text: str, names: str):
    with pytest.raises(InputError) as refusal:
        parse_plan(text)
    assert names in str(refusal.value)
    assert len(str(refusal.value)) < 400


@pytest.mark.parametrize("opening", ['{"type": "Sequence", "children": [', "[", '{"a":'])
def test_ten_thousand_deep_nesting_is_refused(opening: str):
    with pytest.raises(InputError, match="nested"):
        parse_plan('{"parameters": [], "tree": ' + opening * 10_000)


def test_brackets_inside_strings_are_not_nesting():
    plan = parse_plan(json.dumps(DOCUMENT | {"explanation": "[" * 500 + '\\"{'}))
    assert plan.explanation.startswith("[[[")


def test_a_deep_document_that_is_already_parsed_is_refused_too():
    tree: dict[str, Any] = {"type": "Sequence"}
    for _ in range(5000):
        tree = {"type": "Sequence", "children": [tree]}
    with pytest.raises(InputError, match="deep"):
        plan_from({"parameters": [], "tree": tree})


def test_size_and_number_of_nodes_are_bounded():
    with pytest.raises(InputError, match="larger"):
        parse_plan(" " * 1_000_001)
    many = {"type": "Sequence", "children": [{"type": "OpenGripper"}] * 6000}
    with pytest.raises(InputError, match="nodes"):
        parse_plan(json.dumps({"parameters": [], "tree": many}))


@given(st.text() | json_values.map(json.dumps))
@settings(max_examples=200, deadline=None)
def test_any_text_is_a_plan_or_an_input_error(text: str):
    try:
        plan = parse_plan(text)
    except InputError:
        return
    assert parse_plan(dump_plan(plan)) == plan


arguments = st.dictionaries(
    st.text().filter(lambda k: k not in ("type", "name", "children")),
    st.text() | st.integers() | st.booleans(),
).map(lambda d: tuple(d.items()))
nodes = st.recursive(
    st.builds(Node, st.text(), arguments),
    lambda inner: st.builds(
        Node, st.text(), children=st.lists(inner, min_size=1, max_size=3).map(tuple), name=st.text()
    ),
    max_leaves=10,
)


@given(
    st.builds(
        Plan,
        st.lists(st.builds(Parameter, st.text(), st.text())).map(tuple),
        st.none() | nodes,
        st.text(),
    )
)
@settings(max_examples=100, deadline=None)
def test_every_plan_survives_the_file(plan: Plan):
    assert parse_plan(dump_plan(plan)) == plan


@pytest.mark.parametrize("outcome", ["nothing_missing", "cannot", "ambiguous"])
def test_a_plan_without_a_tree_states_its_outcome(outcome: str):
    text = f'{{"parameters": [], "tree": null, "explanation": "so", "outcome": "{outcome}"}}'
    plan = parse_plan(text)
    assert (plan.outcome, plan.satisfied) == (outcome, outcome == "nothing_missing")
    assert parse_plan(dump_plan(plan)) == plan


@pytest.mark.parametrize(
    ("outcome", "said"), [("measure", "'tree' is null"), ("maybe", "must be one of measure")]
)
def test_an_outcome_goes_with_the_tree(outcome: str, said: str):
    text = f'{{"parameters": [], "tree": null, "explanation": "so", "outcome": "{outcome}"}}'
    with pytest.raises(InputError, match=said):
        parse_plan(text)
