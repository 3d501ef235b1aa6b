"""Models as planners, through the command line and over real HTTP to a server on the loopback
interface."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from loopback import Fails, Loopback, Request, Says
from PIL import Image
from plans import SCENE, weighing
from plans import answer as weighed

from palpate.planning.model import session as session_module
from palpate.planning.model.prompt import system_prompt
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.primitives.registry import vocabulary
from palpate.runs.settings import Settings, request_json, settings_from
from palpate.studies.scenarios.catalogue import scenario

from .conftest import Answer, cube

pytest.importorskip("pydantic_ai")

Palpate = Callable[..., Answer]
BOTTLE = scenario("bottle_and_table")
PAPER = (BOTTLE.folder / "plans" / "paper.json").read_text(encoding="utf-8")
SEEN = scenario("from_picture")
SAID = (SEEN.folder / "plans" / "answer.md").read_text(encoding="utf-8")
KEY = "sk-secret-0123456789abcdef"


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setattr(session_module, "BACKOFF", (0.01,))


def half(text: str) -> str:
    """The plan without its last three leaves and the table's height: the bottle stays in the
    hand."""
    document = json.loads(text)
    document["tree"]["children"] = document["tree"]["children"][:-3]
    document["parameters"] = [p for p in document["parameters"] if p["quantity"] != "height"]
    return json.dumps(document)


def model_settings(server: Loopback) -> tuple[str, ...]:
    return "--planner", "openai:gpt-x", "--base-url", server.url("openai")


def bottle(*more: object) -> tuple[object, ...]:
    return ("-r", BOTTLE.request, "--scene", BOTTLE.folder / "scene.xml", *more)


@pytest.mark.long
def test_bottle_and_table_end_to_end_over_http(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("MUJOCO_GL")
    with Loopback(
        Says("Sure, I will."), Says(half(PAPER)), Says(f"```json\n{PAPER}\n```")
    ) as server:
        world = BOTTLE.folder / "world.xml"
        answer = palpate(
            "run",
            *bottle(*model_settings(server), "--world", world, "--out", "out", "--fast", "--json"),
        )
        requests = list(server.requests)
    assert answer.status == 0, answer.err
    result = json.loads(answer.out)
    assert {(p["object"], p["quantity"]) for p in result["parameters"]} == {
        ("bottle", "mass"),
        ("table", "height"),
    }
    assert result["plan"]["planner"] == "openai:gpt-x"
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {
        "twin.xml",
        "report.html",
        "conversation.json",
    }
    assert [len(request.images) > 0 for request in requests] == [True] * 3
    assert all(request.system == system_prompt(vocabulary()) for request in requests)
    assert "this yields table.height" in requests[2].user
    figures = json.loads((tmp_path / "out" / "plan.json").read_text())["model"]
    assert (figures["valid_first"], figures["valid_after_feedback"], figures["rounds"]) == (
        False,
        True,
        3,
    )
    assert figures["reported"] == "loopback-1-2026"
    everything = b"".join(p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file())
    assert KEY.encode() not in everything


@pytest.mark.long
def test_a_conversation_is_replayed_without_network(palpate: Palpate, tmp_path: Path) -> None:
    with Loopback(Says(half(PAPER)), Says(PAPER)) as server:
        palpate(
            "run", *bottle(*model_settings(server), "--out", "first", "--noise", "none", "--fast")
        )
    answer = palpate(
        "run",
        *bottle(
            "--planner",
            f"replay:{tmp_path}/first/conversation.json",
            "--out",
            "second",
            "--noise",
            "none",
            "--fast",
        ),
    )
    assert answer.status == 0, answer.err
    first, second = (
        json.loads((tmp_path / name / "plan.json").read_text()) for name in ("first", "second")
    )
    assert (first["tree"], first["model"]) == (second["tree"], second["model"])
    request = json.loads((tmp_path / "first" / "request.json").read_text())
    assert request["planner"] == "openai:gpt-x"
    assert request["asking"]["base_url"].startswith("http://127.0.0.1")
    assert request["asking"]["budget"]["dollars"] == 2


def test_a_model_without_a_valid_plan_is_status_3_and_its_words_are_kept(
    palpate: Palpate, tmp_path: Path
) -> None:
    with Loopback(Says("I'd rather not.")) as server:
        answer = palpate(
            "run", *bottle(*model_settings(server), "--out", "out", "--feedback", "1", "--json")
        )
    assert answer.status == 3
    assert "rather not" in json.loads(answer.out)["plan"]["explanation"]
    talk = json.loads((tmp_path / "out" / "conversation.json").read_text())
    assert len(talk["rounds"]) == 2
    figures = json.loads((tmp_path / "out" / "plan.json").read_text())["model"]
    assert (figures["valid_after_feedback"], figures["input_tokens"]) == (False, 6000)


def test_a_provider_that_refuses_is_status_5_and_leaves_nothing(
    palpate: Palpate, tmp_path: Path
) -> None:
    with Loopback(Fails(401)) as server:
        answer = palpate("run", *bottle(*model_settings(server), "--out", "out"))
    assert answer.status == 5
    assert "the key was refused" in answer.err
    assert not (tmp_path / "out").exists()


def test_a_budget_ends_the_dialogue(palpate: Palpate) -> None:
    with Loopback(Says("hm")) as server:
        answer = palpate("plan", *bottle(*model_settings(server), "--budget-tokens", "5000"))
        assert len(server.requests) == 2
    assert answer.status == 3
    assert "budget of 5000 tokens" in " ".join(answer.out.split())


@pytest.mark.long
def test_a_plan_by_a_model_is_written_with_its_figures(palpate: Palpate, tmp_path: Path) -> None:
    with Loopback(Says(PAPER)) as server:
        answer = palpate(
            "plan",
            *bottle(*model_settings(server), "--out", "plan.json", "--json", "--without", "role"),
        )
        assert "# Role" not in server.requests[0].system
    assert answer.status == 0
    assert json.loads(answer.out)["model"]["valid_first"] is True
    assert json.loads((tmp_path / "plan.json").read_text())["model"]["rounds"] == 1


@pytest.mark.long
def test_a_lean_prompt_and_a_critic_are_asked_for_on_the_command_line(
    palpate: Palpate, tmp_path: Path
) -> None:
    objection = json.dumps({"objection": "The table stands on a carpet."})
    with Loopback(Says(PAPER), Says(objection), Says(PAPER)) as server:
        answer = palpate(
            "plan",
            *bottle(*model_settings(server), "--prompt", "lean", "--critic", "openai:reader"),
            "--out",
            "plan.json",
        )
        writer, reader, again = server.requests
    assert answer.status == 0, answer.err
    assert writer.system == again.system == system_prompt(vocabulary(), (), "lean")
    assert reader.body["model"] == "reader"
    assert "on a carpet" in again.user
    critic = json.loads((tmp_path / "plan.json").read_text())["model"]["critic"]
    assert (critic["objection"], critic["heeded"]) == ("The table stands on a carpet.", False)
    assert (
        system_prompt(vocabulary(), (), "lean")
        in palpate("prompt", *bottle("--prompt", "lean")).out
    )
    assert palpate("plan", *bottle("--prompt", "fat")).status == 2
    assert palpate("plan", *bottle("--critic", "nobody:x")).status == 2


def test_settings_of_a_model_are_saved_and_read_back() -> None:
    asked = ModelSettings(prompt="lean", critic="openai:x", comments=False, budget=Budget(900.0))
    kept = json.loads(json.dumps(request_json(Settings(request="r", model_settings=asked))))
    assert settings_from(kept).model_settings == asked


@pytest.mark.long
def test_a_sentence_a_picture_and_a_camera_give_complete_mjcf(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("MUJOCO_GL")
    blind = re.sub(r'  "scene": \[.*?\],\n', "", SAID, flags=re.DOTALL)
    with Loopback(Says(blind), Says(SAID)) as server:
        answer = palpate(
            "run",
            "-r",
            SEEN.request,
            "--poses",
            SEEN.folder / "poses.yaml",
            "--world",
            SEEN.folder / "world.xml",
            *model_settings(server),
            "--out",
            "out",
            "--noise",
            "lab",
            "--fast",
            "--json",
        )
        requests = list(server.requests)
    assert answer.status == 0, answer.err
    assert "list the objects that the image shows" in requests[1].user
    assert len(requests[0].images) == 1
    by_name = {
        (p["object"], p["quantity"]): p["value"] for p in json.loads(answer.out)["parameters"]
    }
    assert by_name["table", "height"] == pytest.approx(0.031, abs=5e-4)
    assert by_name["bottle", "mass"] == pytest.approx(0.317, abs=0.006)
    twin = palpate("gap", tmp_path / "out" / "twin.xml", "--json")
    assert json.loads(twin.out)["missing"] == [
        {"object": "bottle", "quantity": "friction"},
        {"object": "carton", "quantity": "mass"},
        {"object": "carton", "quantity": "friction"},
    ]
    assert palpate("check", "out", "--poses", SEEN.folder / "poses.yaml").status == 0


def test_a_planner_without_vision_asks_for_a_scene(palpate: Palpate) -> None:
    for planner in ("symbolic", "exhaustive"):
        answer = palpate("run", "-r", "the mass of the bottle", "--planner", planner)
        assert answer.status == 2
        assert "--scene" in answer.err
        assert "PROVIDER:MODEL" in answer.err
    answer = palpate("run", "-r", "the mass of the bottle", "--planner", "openai:gpt-x")
    assert answer.status == 2
    assert "--image" in answer.err


def test_prompt_prints_what_is_sent(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / "poses.yaml").write_text("places: {tray: {pos: [0.4, -0.2, 0.9]}}")
    Image.new("RGB", (40, 30)).save(tmp_path / "view.png")
    options = bottle("--poses", "poses.yaml", "--image", "view.png")
    with Loopback(Says("I'd rather not.")) as server:
        palpate("plan", *options, *model_settings(server), "--feedback", "0")
        sent: Request = server.requests[0]
    printed = json.loads(palpate("prompt", *options, "--json").out)
    assert printed == {"system": sent.system, "user": sent.user, "images": ["view.png"]}
    assert (
        palpate("prompt", *options).out
        == f"{sent.system.rstrip()}\n\n{sent.user}\nAttach:\nview.png\n"
    )
    assert json.loads(palpate("prompt", *options, "--without", "all", "--json").out)["system"] == ""
    refused = palpate("prompt", *options, "--without", "soul")
    assert (refused.status, "bt_rules" in refused.err) == (2, True)


def test_prompt_without_a_scene_names_the_poses_there_are(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / "poses.yaml").write_text("objects: {cup: {pos: [0.4, -0.2, 0.9]}}")
    out = palpate("prompt", "-r", "weigh the cup", "--poses", "poses.yaml").out
    assert "cup_pose: 0.400 -0.200 0.900" in out
    assert "X_temporary" in out


@pytest.mark.long
def test_the_answer_of_any_chat_is_checked_and_executed(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / "answer.txt").write_text(
        f"Of course! Here is the plan:\n```json\n{PAPER}\n```\nGood luck."
    )
    scene = BOTTLE.folder / "scene.xml"
    assert palpate("check", "answer.txt", "--scene", scene).status == 0
    answer = palpate(
        "execute", "answer.txt", "--scene", scene, "--noise", "none", "--out", "out", "--json"
    )
    assert (answer.status, json.loads(answer.out)["status"]) == (0, "complete")
    (tmp_path / "answer.txt").write_text(f"Here:\n```json\n{PAPER[:-40]}\n```")
    cut = palpate("check", "answer.txt", "--scene", scene)
    assert cut.status == 2
    assert "the JSON" in cut.err


@pytest.mark.usefixtures("driver")
@pytest.mark.parametrize(
    ("said", "status", "words"),
    [
        ("n\n", 4, "not confirmed"),
        pytest.param("", 4, "not confirmed", marks=pytest.mark.long),
        pytest.param("y\n", 5, "hung up", marks=pytest.mark.long),
    ],
)
def test_a_real_robot_moves_only_when_confirmed(
    palpate: Palpate,
    scene: Callable[..., Path],
    said: str,
    status: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    import io

    monkeypatch.setattr(sys, "stdin", io.StringIO(said))
    answer = palpate(
        "run",
        "--scene",
        scene(cube()),
        "--robot",
        "bench://arm",
        "--out",
        "out",
        "--json",
    )
    assert (answer.status, words in answer.err) == (status, True), answer.err
    assert answer.err.index("Force2Mass") < answer.err.index("Let bench://arm move?")
    assert not (tmp_path / "out").exists()
    assert json.loads(answer.out)["error"]["exit_status"] == status


def test_the_option_yes_skips_the_question(palpate: Palpate, scene: Callable[..., Path]) -> None:
    answer = palpate("run", "--scene", scene(cube()), "--robot", "bench://arm", "--yes")
    assert answer.status == 5
    assert "move?" not in answer.err


@pytest.mark.long
def test_the_papers_tables_are_made_and_gone_on_with(palpate: Palpate, tmp_path: Path) -> None:
    with Loopback(Says(PAPER)) as server:
        options = ("bottle_and_table", *model_settings(server), "--noise", "none")
        first = palpate(
            "study",
            "ablation",
            *options,
            "--trials",
            1,
            "--configuration",
            "full",
            "--configuration",
            "no role",
            "--out",
            "a.jsonl",
            "--json",
        )
        again = palpate(
            "study",
            "ablation",
            *options,
            "--trials",
            2,
            "--configuration",
            "full",
            "--configuration",
            "no role",
            "--out",
            "a.jsonl",
            "--workers",
            2,
        )
        assert len(server.requests) == 4
        shown = palpate("study", "repeatability", *options, "--trials", 2, "--out", "r.jsonl")
    rows = json.loads(first.out)["rows"]
    assert [(r["configuration"], r["syntax"]["hits"], r["success"]["hits"]) for r in rows] == [
        ("full", 1, 1),
        ("no role", 1, 1),
    ]
    assert rows[0]["intervals"]["syntax"][0] == pytest.approx(0.2065, abs=1e-3)
    assert "2 of 4 trials are done already" in again.err
    assert "2/2 [0.34, 1.00]" in shown.out
    assert len((tmp_path / "r.jsonl").read_text().splitlines()) == 2


@pytest.mark.long
def test_a_value_that_is_not_believed_is_measured_again(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / "desk.xml").write_text(SCENE)
    again = json.loads(weighed(*weighing("brick"), parameters=("brick.mass",)))
    again["parameters"][0]["again"] = True
    asked = ("-r", "I do not believe the brick's 400 g.", "--scene", tmp_path / "desk.xml")
    with Loopback(Says(json.dumps(again))) as server:
        options = ("--out", "run", "--noise", "none", "--fast")
        answer = palpate("run", *asked, *model_settings(server), *options)
        assert len(server.requests) == 1
    assert answer.status == 0, answer.err
    assert "brick.mass" in answer.out
    assert "measured again" in " ".join(answer.out.split())


def test_a_complete_scene_shows_the_explanation(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / "desk.xml").write_text(SCENE)
    values = {"outcome": "nothing_missing", "parameters": [], "explanation": "D says 0.4 kg."}
    asked = ("-r", "What does the brick weigh?", "--scene", tmp_path / "desk.xml")
    with Loopback(Says(json.dumps(values | {"tree": None}))) as server:
        answer = palpate("run", *asked, *model_settings(server))
    assert answer.status == 0, answer.err
    assert "nothing is missing D says 0.4 kg." in answer.out


def test_the_prompt_says_what_is_to_be_remeasured(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / "desk.xml").write_text(SCENE)
    asked = ("prompt", "-r", "What does the brick weigh?", "--scene", tmp_path / "desk.xml")
    assert "# Measuring again" in palpate(*asked, "--remeasure").out
    assert "# Measuring again" not in palpate(*asked).out
