"""A second model that may object once: over HTTP, on the same wire as the planner."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from loopback import Fails, Loopback, Request, Says
from PIL import Image
from plans import GOOD, REQUEST, SCENE, answer, weighing

from palpate.common.errors import InputError, Unavailable
from palpate.estimation.quantities.catalogue import PURPOSES, catalogue
from palpate.planning.model import session as session_module
from palpate.planning.model.planner import VlmPlanner
from palpate.planning.model.prompt import ORDER
from palpate.planning.model.rounds import LONGEST_OBJECTION, read_objection
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.planning.plan import Plan, dump_plan
from palpate.planning.registry import ReplayPlanner
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

pytest.importorskip("pydantic_ai")

KEY = "sk-secret-0123456789abcdef"
OPEN = SCENE.replace('mass="0.4"', "")
BRICK = answer(*weighing("brick"), parameters=("brick.mass",), explanation="The brick is weighed.")
OBJECTION = json.dumps({"objection": "R asks for the cup, and the plan weighs the brick."})


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
    monkeypatch.setattr(session_module, "BACKOFF", (0.01,))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return parse_scene(OPEN)


def asked(
    server: Loopback, scene: Scene, images: tuple[Path, ...] = (), rounds: int = 1
) -> tuple[VlmPlanner, Plan]:
    settings = ModelSettings(
        base_url=server.url("openai"),
        critic="openai:reader",
        rounds=rounds,
        budget=Budget(seconds=30, attempt_seconds=3),
    )
    planner = VlmPlanner("openai:writer", settings)
    return planner, planner.plan(REQUEST, scene, images)


def figures(planner: VlmPlanner) -> dict[str, object]:
    assert planner.conversation is not None
    return planner.conversation.summary()["model"]["critic"]


def by_model(critic: Says | Fails, *answers: str) -> Loopback:
    """The critic says one thing; the planner its answers in order."""
    left = list(answers)

    def reply(request: Request) -> Says | Fails:
        if request.body["model"] == "reader":
            return critic
        return Says(left.pop(0) if len(left) > 1 else left[0])

    return Loopback(answer=reply)


def test_an_objection_is_heeded_and_recorded_without_keys(scene: Scene, tmp_path: Path) -> None:
    picture = tmp_path / "i.png"
    Image.new("RGB", (64, 48)).save(picture)
    with by_model(Says(f"{OBJECTION} {KEY}"), BRICK, GOOD) as server:
        planner, plan = asked(server, scene, (picture,))
        writer, reader, again = server.requests
    assert [str(parameter) for parameter in plan.parameters] == ["cup.mass"]
    assert reader.images == writer.images
    assert REQUEST in reader.user
    assert "The brick is weighed." in reader.user
    assert reader.system != writer.system
    assert "weighs the brick" in again.user
    assert figures(planner) == {
        "asked": "openai:reader",
        "reported": "loopback-1-2026",
        "objection": "R asks for the cup, and the plan weighs the brick.",
        "heeded": True,
        "error": None,
    }
    assert planner.conversation is not None
    kept = planner.conversation.dump()
    assert KEY not in kept + dump_plan(plan, planner.conversation.summary())
    (tmp_path / "c.json").write_text(kept)
    assert ReplayPlanner(tmp_path / "c.json").plan(REQUEST, scene).tree == plan.tree


def test_the_planner_may_stay_with_its_plan(scene: Scene) -> None:
    with by_model(Says(OBJECTION), GOOD) as server:
        planner, plan = asked(server, scene, rounds=0)
    assert plan.tree is not None
    assert figures(planner)["heeded"] is False
    assert len(server.requests) == 3


@pytest.mark.parametrize("words", ['{"objection": null}', "Looks fine to me.", "[]", ""])
def test_a_plan_without_an_objection_is_final(words: str, scene: Scene) -> None:
    with by_model(Says(words), GOOD) as server:
        planner, _ = asked(server, scene)
    assert len(server.requests) == 2
    assert figures(planner)["objection"] is None


def test_a_critic_out_of_reach_leaves_the_plan_and_a_note(scene: Scene) -> None:
    with by_model(Fails(500), GOOD) as server:
        planner, plan = asked(server, scene)
    assert plan.tree is not None
    assert "the provider failed" in str(figures(planner)["error"])
    assert any("No critic read the plan" in note for note in plan.notes)


def test_an_unknown_critic_or_one_without_a_key_is_refused_before_anything_is_sent(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="unknown provider 'nobody'"):
        ModelSettings(critic="nobody:x").check_values()
    monkeypatch.delenv("ANTHROPIC_API_KEY")
    with Loopback(Says(GOOD)) as server:
        settings = ModelSettings(base_url=server.url("openai"), critic="anthropic")
        with pytest.raises(Unavailable, match="ANTHROPIC_API_KEY"):
            VlmPlanner("openai", settings).plan(REQUEST, scene)
        assert server.requests == []


def test_an_objection_is_of_bounded_length() -> None:
    assert len(read_objection(json.dumps({"objection": "x" * 10_000}))) == LONGEST_OBJECTION


def test_a_refusal_that_the_critic_demands_is_not_questioned(scene: Scene) -> None:
    refusal = {"outcome": "cannot", "parameters": [], "explanation": "It is glued.", "tree": None}
    with by_model(Says(OBJECTION), GOOD, json.dumps(refusal)) as server:
        planner, plan = asked(server, scene)
    assert plan.outcome == "cannot"
    assert len(server.requests) == 3
    assert planner.conversation is not None
    assert planner.conversation.summary()["model"]["questions"] == []


def test_the_critic_gets_quantities_and_purposes_and_is_not_asked_for_a_plan(scene: Scene) -> None:
    with by_model(Says('{"objection": null}'), GOOD) as server:
        asked(server, scene)
    writer, reader = server.requests
    assert ORDER in writer.user
    assert ORDER not in reader.user
    for quantity in catalogue().values():
        assert f"\n- {quantity.id}" in reader.system
    for purpose in PURPOSES:
        assert str(purpose) in reader.system
    assert "{{" not in reader.system
