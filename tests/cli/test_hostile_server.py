"""A server that says the key back, and writes what a terminal would take for commands."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from loopback import Fails, Loopback, Reply, Sends

from palpate.planning.model import session as session_module
from palpate.studies.scenarios.catalogue import scenario

from .conftest import Answer

pytest.importorskip("pydantic_ai")

Palpate = Callable[..., Answer]
BOTTLE = scenario("bottle_and_table")
KEY = "q7Xw-an-unusual-key-0123456789"
COMMAND = "\x1b]0;owned\x07\x9b31m\u202ereversed"


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setattr(session_module, "BACKOFF", (0.01,))


def forms() -> list[str]:
    escaped = "".join(f"\\u{ord(c):04x}" for c in KEY)
    return [KEY, base64.b64encode(KEY.encode()).decode(), escaped, KEY[:14], KEY[14:], KEY[::-1]]


def says(text: str) -> Reply:
    """The text, and the key in every field that there is besides."""
    message: dict[str, Any] = {"role": "assistant", "content": text, "refusal": None}
    choice = {"index": 0, "message": message, "finish_reason": "stop", "logprobs": None}
    body = {
        "id": KEY,
        "object": "chat.completion",
        "created": 1_700_000_000,
        "model": KEY,
        "system_fingerprint": KEY,
        "service_tier": "default",
        "choices": [choice],
        "usage": {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2},
    }
    return Sends(json.dumps(body).encode(), headers={"x-request-id": KEY})


def asked(palpate: Palpate, server: Loopback, *more: object) -> Answer:
    model = ("--planner", "openai:gpt-x", "--base-url", server.url("openai"))
    return palpate(
        "run", "-r", BOTTLE.request, "--scene", BOTTLE.folder / "scene.xml", *model, *more
    )


def kept(folder: Path) -> str:
    files = [file for file in folder.rglob("*") if file.is_file()]
    return "\n".join(file.read_bytes().decode("utf-8", "replace") for file in files)


def test_the_key_is_in_no_file_and_on_no_screen(palpate: Palpate, tmp_path: Path) -> None:
    explanation = " | ".join([*forms(), COMMAND])
    refusal = {"parameters": [], "tree": None, "explanation": explanation}
    wrong = {
        "parameters": [{"object": KEY, "quantity": forms()[1]}],
        "tree": {"type": KEY, "name": KEY, "pose": KEY},
        "explanation": explanation,
    }
    # The key escaped inside the JSON stands in full only where the JSON is read.
    hidden = json.dumps(refusal).replace(KEY, forms()[2])
    with Loopback(says(f"no JSON, but {KEY}"), says(json.dumps(wrong)), says(hidden)) as server:
        answer = asked(palpate, server, "--out", tmp_path / "run")
    assert answer.status == 3, answer.err
    written = kept(tmp_path / "run")
    for form in forms():
        assert form not in written
        assert form not in answer.out + answer.err
    conversation = json.loads((tmp_path / "run" / "conversation.json").read_text(encoding="utf-8"))
    # The last answer is asked about once, and given again.
    assert [round["answer"]["model"] for round in conversation["rounds"]] == ["[key]"] * 4


def test_an_error_message_with_the_key_is_redacted(palpate: Palpate, tmp_path: Path) -> None:
    # The message is cut after 200 characters, in the middle of the key.
    long = "x" * 170 + KEY
    with Loopback(Fails(400, {"x-request-id": KEY}, message=long)) as server:
        answer = asked(palpate, server, "--out", tmp_path / "run", "--json")
    assert answer.status == 5
    for i in range(len(KEY) - 9):
        assert KEY[i : i + 9] not in answer.out + answer.err


@pytest.mark.parametrize("as_json", [False, True])
def test_an_explanation_cannot_command_the_terminal(
    palpate: Palpate, tmp_path: Path, as_json: bool
) -> None:
    refusal = {"parameters": [], "tree": None, "explanation": COMMAND, "notes": [COMMAND]}
    more = ("--json",) if as_json else ()
    with Loopback(says(json.dumps(refusal))) as server:
        answer = asked(palpate, server, "--out", tmp_path / "run", *more)
    assert answer.status == 3
    for character in "\x1b\x07\x9b\u202e":
        assert character not in answer.out + answer.err
    if as_json:
        assert json.loads(answer.out)["plan"]["explanation"] == COMMAND
    else:
        assert r"\x1b]0;owned" in answer.out
        assert r"\x9b31m\u202ereversed" in answer.out
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "\x1b" not in page
    assert "\u202e" not in page


def test_names_of_a_scene_and_of_files_cannot_either(palpate: Palpate, tmp_path: Path) -> None:
    evil = "cup\u202e\x9b31m"
    scene = (
        f'<mujoco><worldbody><body name="{evil}"><freejoint/><geom type="box" size=".03 .03 .05"/>'
        "</body></worldbody></mujoco>"
    )
    path = tmp_path / f"a\x1b]0;owned\x07{evil}.xml"
    path.write_text(scene, encoding="utf-8")
    for answer in (
        palpate("gap", path),
        palpate("gap", path, "--json"),
        palpate("gap", tmp_path / f"no{evil}"),
        palpate("gap", path, f"--no{evil}"),
        palpate("prompt", "--scene", path, "-r", "weigh it"),
        palpate("plan", "--scene", path, "-r", f"the mass of {evil}"),
    ):
        for character in "\x1b\x07\x9b\u202e":
            assert character not in answer.out + answer.err
