"""`palpate doctor --planner`: over HTTP, through the command line."""

from __future__ import annotations

import io
import re

import pytest
from loopback import MODEL, Fails, Loopback, Reply, Request, Says, Sends
from PIL import Image
from typer.testing import CliRunner

from palpate.cli.app import app
from palpate.planning.model import session as session_module

pytest.importorskip("pydantic_ai")

KEY = "sk-secret-0123456789abcdef"


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "GOOGLE_API_KEY", "ANTHROPIC_API_KEY", "OLLAMA_API_KEY"):
        monkeypatch.setenv(name, KEY)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(session_module, "BACKOFF", (0.01,))


def doctor(*arguments: str) -> tuple[int, dict[str, tuple[bool, str]]]:
    """Exit status, and by what it is about whether a line is well, and its checks."""
    done = CliRunner().invoke(app, ["doctor", *arguments])
    assert KEY not in done.output
    checks: dict[str, tuple[bool, str]] = {}
    for line in re.sub(r"\x1b\[[0-9;]*m", "", done.output).splitlines():
        if line[:1] in ("✓", "✗"):
            what, _, detail = line[2:].partition(" ")
            checks[what] = (line[0] == "✓", detail.strip())
    return done.exit_code, checks


def sees(request: Request) -> Reply:
    """A model that answers a line, and names the colour of a picture."""
    if "Remember the word" in request.user:
        return Says("Marmalade")
    if not request.images:
        return Says("ready")
    pixel = Image.open(io.BytesIO(request.images[0])).getpixel((9, 9))
    assert isinstance(pixel, tuple)
    return Says("Red." if pixel[0] > 2 * pixel[1] else "Grey.")


@pytest.mark.parametrize("wire", ["openai", "google", "anthropic", "ollama"])
def test_a_server_that_is_well_is_asked_for_its_models_a_word_and_a_colour(wire: str) -> None:
    with Loopback(answer=sees) as server:
        status, checks = doctor("--planner", f"{wire}:{MODEL}", "--base-url", server.url(wire))
    assert status == 0
    assert [well for well, _ in checks.values()] == [True] * 6
    assert list(checks) == ["address", "key", "models", "answer", "context", "pictures"]
    assert "'ready' in" in checks["answer"][1]


def test_each_fault_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    with Loopback(Says("Blue"), models=("llava", "gemma")) as server:
        status, checks = doctor("--planner", "ollama:nope", "--base-url", server.url("ollama"))
        assert status == 5
        assert checks["models"] == (
            False,
            "there is no 'nope'; there are: llava, gemma; ollama pull nope",
        )
        assert checks["pictures"][0] is checks["context"][0] is False
        assert "OLLAMA_CONTEXT_LENGTH" in checks["context"][1]
        status, checks = doctor("--planner", "ollama", "--base-url", server.url("ollama"))
        assert (status, checks["models"][1].split(";")[0]) == (0, "llava, gemma")
    status, checks = doctor("--planner", "ollama:x", "--base-url", "http://127.0.0.1:9/v1")
    assert (status, checks["models"][0], checks["answer"][0]) == (5, False, False)
    monkeypatch.delenv("OPENAI_API_KEY")
    status, checks = doctor("--planner", "openai")
    assert (status, checks["key"]) == (5, (False, "set OPENAI_API_KEY in the environment"))


@pytest.mark.parametrize("reply", [Fails(401), Fails(500), Sends(b"<html>", "text/html")])
def test_a_model_that_fails_is_reported_without_a_crash(reply: Reply) -> None:
    with Loopback(reply) as server:
        status, checks = doctor("--planner", f"openai:{MODEL}", "--base-url", server.url("openai"))
    assert (status, checks["models"][0], checks["answer"][0]) == (5, True, False)


def test_planners_without_a_server_need_none_and_unknown_ones_are_named() -> None:
    assert doctor("--planner", "symbolic") == (0, {"symbolic": (True, "needs no server")})
    assert doctor("--planner", "nobody")[0] == 2
