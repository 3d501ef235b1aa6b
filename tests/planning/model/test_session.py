import gzip
import io
import json
import logging
import socket
import time
from pathlib import Path

import pytest
from loopback import MODEL, Fails, Loopback, Reply, Says, Sends, Stalls, wire
from PIL import Image

from palpate.cli.console import exit_status
from palpate.common.errors import InputError, Unavailable
from palpate.planning.model import session as session_module
from palpate.planning.model.conversation import Conversation
from palpate.planning.model.normal import flat_schema
from palpate.planning.model.provider import Endpoint, find_provider
from palpate.planning.model.session import LONGEST_SIDE, ModelSession, Picture, picture
from palpate.planning.model.settings import Budget
from palpate.primitives.registry import vocabulary

pytest.importorskip("pydantic_ai")

KEYS = {
    "OPENAI_API_KEY": "sk-secret-openai-0123456789",
    "GOOGLE_API_KEY": "AIzaSecretGoogle01234567890123",
    "ANTHROPIC_API_KEY": "sk-ant-secret-0123456789",
}
WIRES = ["openai", "google", "anthropic"]
PICTURE = Picture(b"\xff\xd8\xff\xe0 not really a picture \xff\xd9", 4, 3)
AMPLE = Budget(seconds=60.0, attempt_seconds=2.0)
"""Enough on a busy machine; only what stalls takes its time."""
SDK_PATIENCE = 300.0
"""s: half of what the providers' own clients wait for one answer."""


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in KEYS.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(session_module, "BACKOFF", (0.02, 0.02, 0.02, 0.02))


def opened(
    server: Loopback, planner: str, budget: Budget = AMPLE, **changes: object
) -> ModelSession:
    endpoint = Endpoint.of(planner, server.url(planner.partition(":")[0]))
    fields = {"system": "the system prompt", "pictures": [PICTURE], "schema": None} | changes
    return ModelSession(endpoint, budget=budget, **fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "planner", [*WIRES, "ollama:qwen3-vl", "vllm:Qwen/Qwen3-VL-8B", "compatible:any"]
)
def test_prompt_and_picture_reach_the_provider_and_its_answer_comes_back(planner: str) -> None:
    with Loopback(Says("the answer")) as server:
        answer = opened(server, planner).ask("the message")
        request = server.requests[0]
    assert (request.system, request.user, request.images) == (
        "the system prompt",
        "the message",
        [PICTURE.data],
    )
    assert (answer.text, answer.model, answer.finish, answer.requests) == (
        "the answer",
        f"{MODEL}-2026",
        "stop",
        1,
    )
    assert (answer.input_tokens, answer.cached_tokens, answer.output_tokens) == (3000, 2500, 500)


@pytest.mark.parametrize("planner", WIRES)
def test_the_dialogue_goes_on_with_all_that_was_said(planner: str) -> None:
    with Loopback(Says("first answer"), Says("second answer")) as server:
        session = opened(server, planner)
        session.ask("first message")
        assert session.ask("second message").text == "second answer"
        sent = json.dumps(server.requests[1].body)
    assert [text in sent for text in ("first message", "first answer", "second message")] == [
        True
    ] * 3
    assert server.requests[1].system == "the system prompt"
    assert server.requests[1].images == [PICTURE.data]


@pytest.mark.parametrize("planner", WIRES)
def test_a_session_without_a_system_prompt_sends_none(planner: str) -> None:
    with Loopback(Says("x")) as server:
        opened(server, planner, system="").ask("m")
        assert server.requests[0].system == ""


@pytest.mark.parametrize("planner", WIRES)
def test_structured_output_is_asked_for_with_the_flat_schema(planner: str) -> None:
    with Loopback(Says("{}")) as server:
        opened(server, planner, schema=flat_schema(vocabulary(), with_scene=False)).ask("m")
        body = server.requests[0].body
    asked = {
        "openai": lambda: body["response_format"]["json_schema"]["schema"],
        "google": lambda: body["generationConfig"]["responseJsonSchema"],
        "anthropic": lambda: body["output_config"]["format"]["schema"],
    }[planner]()
    assert "nodes" in asked["properties"]


@pytest.mark.parametrize("planner", WIRES)
def test_a_known_model_has_a_price(planner: str) -> None:
    provider, model = find_provider(planner)

    def priced(request: object) -> Reply:
        path = request.path  # type: ignore[attr-defined]
        return Sends(json.dumps(wire(path, Says("x"))).replace(f"{MODEL}-2026", model).encode())

    with Loopback(answer=priced) as server:
        cost = opened(server, planner).ask("m").cost
    assert provider.model == model
    assert cost is not None
    assert 0.0001 < cost < 0.1


@pytest.mark.parametrize("planner", WIRES)
@pytest.mark.parametrize(
    ("replies", "requests"),
    [
        ([Fails(500), Fails(500), Says("at last")], 3),
        ([Fails(503), Says("at last")], 2),
        ([Fails(529), Says("at last")], 2),
        pytest.param([Stalls(), Says("at last")], 2, marks=pytest.mark.long),
    ],
)
def test_a_transient_failure_is_retried(planner: str, replies: list[Reply], requests: int) -> None:
    with Loopback(*replies) as server:
        answer = opened(server, planner).ask("m")
    assert (answer.text, answer.requests, len(server.requests)) == ("at last", requests, requests)


@pytest.mark.parametrize("planner", WIRES)
def test_retry_after_is_honoured_within_the_budget(planner: str) -> None:
    with Loopback(Fails(429, {"retry-after": "1"}), Says("at last")) as server:
        started = time.monotonic()
        assert opened(server, planner).ask("m").text == "at last"
    assert time.monotonic() - started >= 1.0


@pytest.mark.parametrize("planner", WIRES)
@pytest.mark.parametrize(
    ("reply", "told", "requests"),
    [
        (Fails(401), "key was refused.*401.*check [A-Z]+_API_KEY", 1),
        (Fails(403), "key was refused.*403", 1),
        (Fails(404), "there is no model", 1),
        (Fails(429, {"retry-after": "3600"}), "asks to wait 3600 s", 1),
        (Fails(500), "failed.*500.*5 times", 5),
        (Fails(400, message="bad request"), "bad request", 1),
        (Sends(b"<html>Sign in</html>", "text/html"), "not in the form of", 1),
        (Sends(b'{"choices": [', "application/json"), "not in the form of", 1),
        (Sends(b"x" * 10_000_000, "text/plain"), "larger than any plan", 1),
        (Sends(b'{"x": "' + b"x" * 10_000_000 + b'"}', chunked=True), "larger than any plan", 1),
        (
            Sends(gzip.compress(bytes(200_000_000)), headers={"content-encoding": "gzip"}),
            "larger than any plan",
            1,
        ),
    ],
)
def test_a_permanent_failure_is_one_clear_error(
    planner: str, reply: Reply, told: str, requests: int
) -> None:
    with Loopback(reply) as server, pytest.raises(Unavailable, match=told) as caught:
        opened(server, planner).ask("m")
    assert exit_status(caught.value) == 5
    assert len(server.requests) == requests
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("planner", WIRES)
def test_a_connection_that_stalls_for_ever_ends_within_the_budget(planner: str) -> None:
    with Loopback(Stalls()) as server:
        started = time.monotonic()
        with pytest.raises(Unavailable, match="no answer came in time"):
            opened(server, planner, Budget(seconds=1.0, attempt_seconds=0.4)).ask("m")
    assert time.monotonic() - started < SDK_PATIENCE


def test_a_server_that_is_not_there_is_one_clear_error() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        nowhere = Endpoint.of("openai:m", f"http://127.0.0.1:{unused.getsockname()[1]}/v1")
        session = ModelSession(nowhere, "S", [], None, AMPLE)
        with pytest.raises(Unavailable, match="cannot be reached"):
            session.ask("m")


def test_a_redirect_is_not_followed() -> None:
    with (
        Loopback(Says("stolen")) as other,
        Loopback(Fails(307, {"location": f"{other.root}/v1/chat/completions"})) as server,
    ):
        with pytest.raises(Unavailable):
            opened(server, "openai").ask("m")
        assert other.requests == []


@pytest.mark.parametrize("planner", WIRES)
def test_a_refusal_is_the_answer(planner: str) -> None:
    with Loopback(Says("", refusal="I will not do that.")) as server:
        answer = opened(server, planner).ask("m")
    assert (answer.text, answer.finish) == ("I will not do that.", "content_filter")


@pytest.mark.parametrize("planner", WIRES)
def test_a_truncated_answer_says_so(planner: str) -> None:
    with Loopback(Says('{"tree":', finish="length")) as server:
        assert opened(server, planner).ask("m").finish == "length"


@pytest.mark.parametrize("planner", WIRES)
def test_the_token_budget_bounds_the_answer(planner: str) -> None:
    with Loopback(Says("x")) as server:
        opened(server, planner, Budget(tokens=700)).ask("m")
        sent = json.dumps(server.requests[0].body)
    assert "700" in sent


def test_tokens_and_dollars_end_the_dialogue() -> None:
    class Spent(Conversation):
        tokens = 1000
        cost = 0.5

    assert Budget(tokens=1001, dollars=0.6).exhaustion_reason(Spent("p", "S")) is None
    assert "1000 tokens" in (Budget(tokens=1000).exhaustion_reason(Spent("p", "S")) or "")
    assert "$0.5" in (Budget(dollars=0.5).exhaustion_reason(Spent("p", "S")) or "")


@pytest.mark.parametrize("planner", WIRES)
def test_keys_are_in_no_answer_error_or_log(planner: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    key = KEYS[f"{planner.upper()}_API_KEY"]
    with Loopback(
        Says(f"your key is {key}"), Fails(400, message=f"Incorrect API key provided: {key}")
    ) as server:
        session = opened(server, planner)
        assert key not in session.ask("m").text
        with pytest.raises(Unavailable) as caught:
            session.ask("again")
    assert any(key in value for value in server.requests[0].headers.values())
    links: BaseException | None = caught.value
    assert key not in str(links)
    assert links.__cause__ is None
    assert links.__suppress_context__
    assert key not in caplog.text
    assert all(key not in json.dumps(request.body) for request in server.requests)


def saved(path: Path, size: tuple[int, int], mode: str = "RGB") -> Path:
    Image.new(mode, size).save(path)
    return path


def test_a_large_picture_is_downscaled_to_the_stated_size(tmp_path: Path) -> None:
    sent = picture(saved(tmp_path / "a.png", (4000, 1000)))
    assert (sent.width, sent.height) == (LONGEST_SIDE, LONGEST_SIDE // 4)
    assert Image.open(io.BytesIO(sent.data)).size == (sent.width, sent.height)


def test_a_small_picture_is_not_enlarged_and_loses_its_alpha(tmp_path: Path) -> None:
    sent = picture(saved(tmp_path / "a.png", (64, 48), "RGBA"))
    assert (sent.width, sent.height, sent.media_type) == (64, 48, "image/jpeg")


@pytest.mark.parametrize(
    "content", [b"", b"no picture", b"GIF89a" + bytes(100), b"\x89PNG\r\n\x1a\n" + bytes(50)]
)
def test_a_file_that_is_no_picture_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png"):
        picture(tmp_path / "a.png")


def test_a_missing_picture_and_a_decompression_bomb_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        picture(tmp_path / "none.png")
    with pytest.raises(InputError, match="bomb"):
        picture(saved(tmp_path / "bomb.png", (12_000, 12_000), "1"))


def _completion(**changes: object) -> dict[str, object]:
    reply: dict[str, object] = dict(wire("/v1/chat/completions", Says("the answer")))
    return reply | changes


def test_a_reply_without_the_fields_that_carry_nothing_is_read() -> None:
    bare = {"choices": [{"message": {"role": "assistant", "content": "the answer"}}]}
    with Loopback(Sends(json.dumps(bare).encode())) as server:
        answer = opened(server, "compatible:any").ask("m")
    assert answer.text == "the answer"


@pytest.mark.parametrize("content_type", ["text/event-stream", "application/json"])
def test_a_stream_that_was_not_asked_for_is_joined(content_type: str) -> None:
    events = [
        {"choices": [{"index": 0, "delta": {"content": part}}]} for part in ("the ", "answer")
    ]
    body = "".join(f"data: {json.dumps(event)}\n\n" for event in events) + "data: [DONE]\n\n"
    with Loopback(Sends(body.encode(), content_type)) as server:
        assert opened(server, "compatible:any").ask("m").text == "the answer"


def test_an_error_with_status_200_is_reported_in_the_words_of_the_server() -> None:
    body = json.dumps({"error": {"message": "context size exceeded", "type": "server_error"}})
    with (
        Loopback(Sends(body.encode())) as server,
        pytest.raises(Unavailable, match="the server reports an error: context size exceeded"),
    ):
        opened(server, "compatible:any").ask("m")


@pytest.mark.parametrize(
    "message",
    [
        {"role": "assistant", "content": None, "reasoning_content": "the answer"},
        {
            "role": "assistant",
            "content": None,
            "tool_calls": [
                {
                    "id": "1",
                    "type": "function",
                    "function": {"name": "plan", "arguments": "the answer"},
                }
            ],
        },
    ],
)
def test_an_answer_outside_of_the_content_is_read(message: dict[str, object]) -> None:
    choice = {"index": 0, "message": message, "finish_reason": "stop"}
    with Loopback(Sends(json.dumps(_completion(choices=[choice])).encode())) as server:
        assert "the answer" in opened(server, "compatible:any").ask("m").text
