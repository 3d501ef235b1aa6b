import json
from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.planning.model.conversation import Answer, Conversation, Round, read_conversation
from palpate.planning.model.rounds import MAX_FINDINGS, converse, feedback, replay_conversation
from palpate.planning.plan import Node, Plan
from palpate.planning.registry import ReplayPlanner

GOOD = Plan((), None, "nothing to do")


def judge(text: str) -> tuple[Plan | None, Sequence[str]]:
    return (GOOD, []) if text == "good" else (None, [f"'{text}' is not good"])


def scripted(*texts: str, heard: list[str] | None = None) -> Callable[[str], Answer]:
    answers = iter(texts)

    def ask(message: str) -> Answer:
        if heard is not None:
            heard.append(message)
        return Answer(next(answers), "m-1", 100, 80, 10, 0.01, 1.0)

    return ask


def test_findings_go_back_until_the_plan_is_good() -> None:
    talk, heard = Conversation("p:m", "S"), list[str]()
    assert converse(talk, "please", scripted("bad", "worse", "good", heard=heard), judge) is GOOD
    assert heard[0] == "please"
    assert "'bad' is not good" in heard[1]
    assert "'worse' is not good" in heard[2]


def test_first_attempt_and_after_feedback_are_counted_apart() -> None:
    talk = Conversation("p:m", "S")
    converse(talk, "please", scripted("bad", "good"), judge)
    figures = talk.summary()["model"]
    assert (figures["valid_first"], figures["valid_after_feedback"], figures["rounds"]) == (
        False,
        True,
        2,
    )
    assert (figures["input_tokens"], figures["cached_tokens"], figures["output_tokens"]) == (
        200,
        160,
        20,
    )
    assert (figures["cost_usd"], figures["seconds"], figures["reported"]) == (0.02, 2.0, "m-1")


def test_three_rounds_of_feedback_and_no_more() -> None:
    talk = Conversation("p:m", "S")
    with pytest.raises(PlanRejected, match=r"4 answer.*'d' is not good"):
        converse(talk, "please", scripted("a", "b", "c", "d", "good"), judge)
    assert len(talk.rounds) == 4
    assert talk.summary()["model"]["valid_after_feedback"] is False


def test_a_used_up_budget_ends_the_dialogue() -> None:
    with pytest.raises(PlanRejected, match="no money"):
        converse(
            Conversation("p:m", "S"),
            "please",
            scripted("a", "good"),
            judge,
            may_go_on=lambda _: "no money",
        )


def test_the_cost_is_unknown_when_one_price_is() -> None:
    talk = Conversation("p:m", "S")
    converse(talk, "please", lambda _: Answer("good", cost=None), judge)
    assert talk.cost is None


def test_feedback_is_bounded() -> None:
    text = feedback(["x" * 10_000] * (MAX_FINDINGS + 5))
    assert "and 5 more" in text
    assert len(text) < 20_000


def test_a_conversation_is_read_back_as_it_was(tmp_path) -> None:
    talk = Conversation("p:m", "S — ü", ({"width": 1, "height": 2, "sha256": "ab"},))
    converse(talk, "please", scripted("bad", "good"), judge)
    assert Conversation.load(talk.dump()) == talk
    file = tmp_path / "conversation.json"
    file.write_text(talk.dump(), encoding="utf-8")
    assert replay_conversation(read_conversation(file), Conversation("again", ""), judge) is GOOD


def test_a_replay_is_checked_again(tmp_path) -> None:
    talk = Conversation("p:m", "S")
    converse(talk, "please", scripted("good"), judge)
    (tmp_path / "c.json").write_text(talk.dump())
    with pytest.raises(PlanRejected, match="stale"):
        replay_conversation(
            read_conversation(tmp_path / "c.json"),
            Conversation("again", ""),
            lambda _: (None, ["stale"]),
        )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[]",
        '{"planner": "p", "system": "S", "rounds": [{"message": 1}]}',
        json.dumps({"planner": "p", "system": "s", "rounds": 3}),
    ],
)
def test_a_document_that_is_no_conversation_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="not a recorded conversation"):
        Conversation.load(text)


def test_an_empty_record_has_no_plan(tmp_path) -> None:
    (tmp_path / "c.json").write_text(Conversation("p:m", "S").dump())
    with pytest.raises(InputError, match="no answer"):
        ReplayPlanner(tmp_path / "c.json").plan(None, None)


def test_a_record_that_ends_with_an_objection_is_refused() -> None:
    kept = Conversation("p:m", "S", rounds=[Round("please", Answer("good"), objection="no")])
    with pytest.raises(InputError, match="ends before"):
        replay_conversation(kept, Conversation("again", ""), judge)


OTHER = replace(GOOD, explanation="another")


def test_an_objection_goes_back_once_and_the_answer_to_it_is_the_plan() -> None:
    talk, heard = Conversation("p:m", "S"), list[str]()
    plans = {"first": GOOD, "second": OTHER}
    plan = converse(
        talk,
        "please",
        scripted("first", "second", heard=heard),
        lambda text: (plans[text], []),
        rounds=0,
        critic=lambda plan: "the wrong cup",
    )
    assert plan is OTHER
    assert "the wrong cup" in heard[1]
    assert [round.objection for round in talk.rounds] == ["the wrong cup", ""]
    again = Conversation("p:m", "S")
    kept = Conversation.load(talk.dump())
    assert replay_conversation(kept, again, lambda text: (plans[text], [])) is OTHER


def test_a_plan_stands_where_an_objection_leads_to_no_other_that_passes() -> None:
    talk = Conversation("p:m", "S")
    plan = converse(
        talk, "please", scripted("good", "bad", "bad"), judge, rounds=1, critic=lambda plan: "no"
    )
    assert plan is GOOD
    assert len(talk.rounds) == 3


def test_the_figures_have_each_rounds_parameters_and_changes() -> None:
    trees = [Node("Sequence", (), (Node("OpenGripper"), Node(name))) for name in ("A", "B")]
    plans = [
        Plan((Parameter("cup", "mass"),), trees[0], "e"),
        Plan((Parameter("cup", "com"),), trees[1], "e"),
    ]
    talk = Conversation("p:m", "S")
    converse(
        talk,
        "please",
        scripted("0", "1"),
        lambda text: (plans[int(text)], ["no"] if text == "0" else []),
    )
    figures = talk.summary()["model"]
    assert figures["parameters"] == [["cup.mass"], ["cup.com"]]
    assert figures["changed"] == [[], ["- cup.mass", "+ cup.com", "- A", "+ B"]]
