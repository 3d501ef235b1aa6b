import json
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.planning.model.answer import MAX_ATTEMPTS, json_objects, read_answer
from palpate.planning.plan import MAX_BYTES
from palpate.planning.registry import read_proposal
from palpate.scene.detections import SceneObject

PLAN = {
    "parameters": [{"object": "cup", "quantity": "mass"}],
    "explanation": "Weigh it {gently}.",
    "tree": {
        "type": "Sequence",
        "children": [{"type": "OpenGripper"}, {"type": "MovePose", "pose": "cup_pose"}],
    },
}
TEXT = json.dumps(PLAN)


@pytest.mark.parametrize(
    "answer",
    [
        TEXT,
        f"Here is the plan:\n```json\n{TEXT}\n```\nIt weighs {{the}} cup.",
        f"<think>maybe {{\"tree\": 1, ...}}? or {{'a': 2}}</think>\n{TEXT}",
        f'For {{"object": "cup", "quantity": "mass"}} I propose\n{json.dumps(PLAN, indent=4)}',
        "\ufeff" + TEXT,
    ],
)
def test_the_plan_is_found_amid_prose_and_fences(answer: str) -> None:
    plan = read_answer(answer).plan
    assert plan.parameters == (Parameter("cup", "mass"),)
    assert plan.tree is not None
    assert [node.type for _, node in plan.tree.walk()] == ["Sequence", "OpenGripper", "MovePose"]


def test_the_last_of_several_plans_counts() -> None:
    draft = json.dumps(PLAN | {"explanation": "draft"})
    assert read_answer(f"First {draft}. Better: {TEXT}").plan.explanation == PLAN["explanation"]


DRAFT = json.dumps(PLAN | {"explanation": "draft"})
CUT = TEXT[:-25]
WRAPPERS = [
    ("<think>", "</think>"),
    ("", "</think>"),
    ("Hm.\n<think> I may use <think> here. ", "</think>\n"),
    ("<THINKING>", "</THINKING>"),
    ('<think time="3">', "</think>"),
    ("<reasoning_content>", "</reasoning_content>"),
    ("<seed:think>", "</seed:think>"),
    ("[THINK]", "[/THINK]"),
    ("◁think▷", "◁/think▷"),
    ("<|begin_of_thought|>", "<|end_of_thought|>"),
    (
        "<|channel|>analysis<|message|>",
        "<|end|><|start|>assistant<|channel|>final<|message|>",
    ),
    ("<unused94>thought\n", "<unused95>"),
]


@pytest.mark.parametrize(("opens", "closes"), WRAPPERS)
def test_a_draft_in_reasoning_is_never_the_plan(opens: str, closes: str) -> None:
    assert read_answer(f"{opens}{DRAFT}{closes}{TEXT}").plan.explanation == PLAN["explanation"]
    with pytest.raises(InputError, match="breaks off"):
        read_answer(f"{opens}{DRAFT}{closes}{CUT}")
    with pytest.raises(InputError, match=r"reasoning alone|no JSON object"):
        read_answer(f"{opens}{DRAFT}{closes}")
    assert list(json_objects(f"{opens}{DRAFT}{closes}{TEXT}")) == [PLAN]


@pytest.mark.parametrize("opens", [opens for opens, _ in WRAPPERS if opens])
def test_reasoning_without_an_end_holds_no_plan(opens: str) -> None:
    with pytest.raises(InputError):
        read_answer(f"{opens}{DRAFT}")


@pytest.mark.parametrize("end", range(2, len(TEXT) - 1, 7))
def test_a_draft_is_not_the_plan_where_the_final_one_is_cut_off(end: int) -> None:
    with pytest.raises(InputError, match="breaks off"):
        read_answer(f"First {DRAFT}. Better: {TEXT[:end]}")


def test_a_tag_in_the_text_of_a_plan_is_text() -> None:
    text = "It has a </think> on it."
    assert read_answer(json.dumps(PLAN | {"explanation": text})).plan.explanation == text


def test_brackets_in_prose_are_no_reasoning() -> None:
    answer = f"[thinking of the cup] {TEXT} That is all {{of it}}."
    assert read_answer(answer).plan.explanation == PLAN["explanation"]


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ("", "empty"),
        ("I cannot help with that.", "no JSON object"),
        ('{"object": "cup"}', "no field 'tree'"),
        (TEXT[:-20], "breaks off"),
        (TEXT.replace('"type": "OpenGripper"', '"type": "OpenGripper",,'), "not valid"),
        (TEXT.replace('"cup_pose"', "NaN"), "NaN"),
        ('{"a":' * 100_000, "nested deeper"),
        ('{"tree": ' + "[" * 100_000, "nested deeper"),
        ("x" * (MAX_BYTES + 1), "characters"),
        ('{"tree": null, "tree": null, "parameters": []}', "twice"),
        ('{"tree": ' + "9" * 10_000 + "}", "not usable"),
    ],
)
def test_an_answer_without_a_plan_is_refused_with_a_remedy(answer: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        read_answer(answer)


def test_a_truncated_answer_never_yields_a_part_of_its_tree() -> None:
    whole = json.dumps(PLAN)
    for end in range(1, len(whole)):
        with pytest.raises(InputError):
            read_answer(whole[:end])


def test_the_search_for_a_plan_is_bounded() -> None:
    with pytest.raises(InputError):
        read_answer('{"a": ' * (MAX_ATTEMPTS * 2) + TEXT)


@given(st.text(max_size=400))
def test_any_text_is_a_plan_or_an_input_error(text: str) -> None:
    with suppress(InputError):
        read_answer(text)


def test_detected_objects_are_read_with_the_plan() -> None:
    seen = [{"name": "cup", "shape": "cylinder", "bbox": [0.1, 0.2, 0.3, 0.4], "colour": "red"}]
    assert read_answer(json.dumps(PLAN | {"scene": seen})).scene == (
        SceneObject("cup", "cylinder", (0.1, 0.2, 0.3, 0.4)),
    )


@pytest.mark.parametrize(
    "seen",
    [
        "cup",
        [{"name": "cup"}],
        [{"name": "a/../b", "shape": "box", "bbox": [0, 0, 1, 1]}],
        [{"name": "cup", "shape": "cone", "bbox": [0, 0, 1, 1]}],
        [{"name": "cup", "shape": "box", "bbox": [0, 0, 1]}],
        [{"name": "cup", "shape": "box", "bbox": [0.5, 0, 0.4, 1]}],
        [{"name": "cup", "shape": "box", "bbox": [0, 0, 400, 300]}],
        [{"name": "cup", "shape": "box", "bbox": [0, 0, 1, 1]}] * 101,
    ],
)
def test_detected_objects_of_another_form_are_refused(seen: object) -> None:
    with pytest.raises(InputError, match="scene"):
        read_answer(json.dumps(PLAN | {"scene": seen}))


OWN = {"role": "assistant", "content": TEXT}
CALL = {"id": "1", "type": "function", "function": {"name": "plan", "arguments": TEXT}}


def completion(message: object, finish: str = "stop") -> dict[str, object]:
    """Chat completion of OpenAI's API."""
    choice = {"index": 0, "message": message, "logprobs": None, "finish_reason": finish}
    return {"id": "x", "object": "chat.completion", "choices": [choice], "usage": {}}


@pytest.mark.parametrize(
    "reply",
    [
        completion(OWN | {"refusal": None}),
        completion(OWN | {"reasoning_content": DRAFT}),
        completion(OWN | {"content": [{"type": "text", "text": f"Here:\n{TEXT}"}]}),
        completion({"role": "assistant", "content": None, "tool_calls": [CALL]}, "tool_calls"),
        {"model": "m", "message": OWN, "done": True},
        {"model": "m", "response": TEXT, "done": True},
        {"type": "message", "content": [{"type": "text", "text": TEXT}]},
        {
            "type": "message",
            "content": [
                {"type": "thinking", "thinking": DRAFT},
                {"type": "text", "text": TEXT},
                {"type": "text", "text": "That is all."},
            ],
        },
        {"content": [{"type": "tool_use", "id": "1", "name": "plan", "input": PLAN}]},
        {
            "object": "response",
            "output": [
                {"type": "reasoning", "summary": [{"type": "summary_text", "text": DRAFT}]},
                {"type": "message", "content": [{"type": "output_text", "text": TEXT}]},
            ],
        },
        {
            "candidates": [
                {"content": {"parts": [{"text": DRAFT, "thought": True}, {"text": TEXT}]}}
            ]
        },
        [{"candidates": [{"content": {"parts": [{"text": TEXT}]}}]}],
        {"messages": [{"role": "user", "content": "weigh"}, OWN]},
        [{"role": "system", "content": DRAFT}, {"role": "user", "content": DRAFT}, OWN],
    ],
)
def test_a_saved_reply_of_an_api_is_read(reply: object) -> None:
    assert read_answer(json.dumps(reply)).plan == read_answer(TEXT).plan
    assert read_proposal(json.dumps(reply, indent=2).encode()).plan == read_answer(TEXT).plan


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (completion(OWN | {"content": TEXT[:90]}, "length"), "breaks off"),
        (completion(OWN | {"content": f"{DRAFT} Better: {TEXT[:90]}"}, "length"), "breaks off"),
        (completion(OWN | {"content": "", "reasoning_content": DRAFT}), "reasoning alone"),
        (completion(OWN | {"content": None, "refusal": "I cannot."}), "no JSON object"),
        ([{"role": "user", "content": DRAFT}], "must be a JSON object, not a list"),
        ({"type": ["text"], "role": {}, "content": "x"}, "no JSON object"),
    ],
)
def test_a_saved_reply_without_a_plan_is_refused(reply: object, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_proposal(json.dumps(reply).encode())


def test_an_escape_of_markdown_is_read() -> None:
    escaped = TEXT.replace("cup_pose", r"cup\_pose")
    assert read_answer(escaped).plan == read_answer(TEXT).plan
    assert read_proposal(escaped.encode()).plan == read_answer(TEXT).plan
    reply = completion(OWN | {"content": escaped})
    assert read_proposal(json.dumps(reply).encode()).plan == read_answer(TEXT).plan
