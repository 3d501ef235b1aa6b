"""A provider on the loopback interface: the real wire formats, scripted answers.

It speaks OpenAI chat completions, Gemini generateContent and Anthropic messages, so that the real
client code runs, images included. Every reply is scripted, good or bad; every request is kept for
the test to look at.
"""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

MODEL = "loopback-1"


@dataclass(frozen=True)
class Says:
    """A well-formed reply: the model says `text`."""

    text: str
    finish: str = "stop"
    refusal: str = ""


@dataclass(frozen=True)
class Fails:
    """A reply with an HTTP error status, worded as the provider would."""

    status: int
    headers: Mapping[str, str] = field(default_factory=dict)
    message: str = "scripted failure"


@dataclass(frozen=True)
class Sends:
    """Raw bytes under a content type of their own, sent with or without a length."""

    body: bytes
    content_type: str = "application/json"
    chunked: bool = False
    headers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Stalls:
    """Takes the request and says nothing until the server closes."""


Reply = Says | Fails | Sends | Stalls


@dataclass(frozen=True)
class Request:
    """What a client sent."""

    path: str
    headers: dict[str, str]
    body: dict[str, Any]

    @property
    def system(self) -> str:
        """The system prompt, whatever the wire format."""
        if "messages" in self.body and "system" not in self.body:
            return "\n".join(
                _text(m["content"])
                for m in self.body["messages"]
                if m["role"] in ("system", "developer")
            )
        if "system" in self.body:
            return _text(self.body["system"])
        return "".join(
            p.get("text", "") for p in self.body.get("systemInstruction", {}).get("parts", [])
        )

    @property
    def user(self) -> str:
        """The text of the last user message."""
        if "messages" in self.body:
            return _text([m for m in self.body["messages"] if m["role"] == "user"][-1]["content"])
        return "".join(p.get("text", "") for p in self.body["contents"][-1]["parts"])

    @property
    def images(self) -> list[bytes]:
        """All pictures of the request, decoded."""
        return [base64.b64decode(data) for data in _pictures(self.body)]


def _text(content: Any) -> str:
    if isinstance(content, str):
        return content
    return "".join(part.get("text", "") for part in content if part.get("type") == "text")


def _pictures(body: Mapping[str, Any]) -> Iterable[str]:
    for message in body.get("messages", []):
        for part in message["content"] if isinstance(message["content"], list) else []:
            if part.get("type") == "image_url":
                yield part["image_url"]["url"].split(",", 1)[1]
            if part.get("type") == "image":
                yield part["source"]["data"]
    for content in body.get("contents", []):
        for part in content["parts"]:
            if "inlineData" in part:
                yield part["inlineData"]["data"].replace("-", "+").replace("_", "/")


class Loopback:
    """A server in a thread of its own. `replies` come in order, the last one for ever; or `answer`
    makes them."""

    def __init__(
        self,
        *replies: Reply,
        answer: Callable[[Request], Reply] | None = None,
        models: tuple[str, ...] = (MODEL,),
    ) -> None:
        self.models = models
        self._replies = list(replies)
        self._answer = answer
        self._lock = threading.Lock()
        self.requests: list[Request] = []
        self.in_flight = 0
        self.most_in_flight = 0
        self.closing = threading.Event()
        self._server = _Server(("127.0.0.1", 0), _handler(self))
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        )

    def __enter__(self) -> Loopback:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.closing.set()
        self._server.shutdown()
        self._server.server_close()

    @property
    def root(self) -> str:
        return f"http://127.0.0.1:{self._server.server_port}"

    def url(self, provider: str) -> str:
        """The base URL that `provider`'s SDK expects."""
        return self.root if provider in ("anthropic", "google") else f"{self.root}/v1"

    def reply(self, request: Request) -> Reply:
        with self._lock:
            self.requests.append(request)
            if self._answer is None:
                return self._replies.pop(0) if len(self._replies) > 1 else self._replies[0]
        return self._answer(request)

    def count(self, change: int) -> None:
        with self._lock:
            self.in_flight += change
            self.most_in_flight = max(self.most_in_flight, self.in_flight)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Clients hang up in the middle of a reply on purpose."""


def _handler(server: Loopback) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["content-length"]))
            request = Request(
                self.path, {k.lower(): v for k, v in self.headers.items()}, json.loads(body)
            )
            server.count(1)
            try:
                self._send(server.reply(request))
            except (BrokenPipeError, ConnectionResetError):
                self.close_connection = True
            finally:
                server.count(-1)

        def do_GET(self) -> None:
            """The list of models, for those with a key."""
            held = {"authorization", "x-api-key", "x-goog-api-key"} & {
                name.lower() for name in self.headers
            }
            known = self.path.partition("?")[0] in ("/v1/models", "/v1beta/models")
            if not (held and known):
                self._write(401 if known else 404, b"{}", {})
                return
            names = [{"id": name, "name": f"models/{name}"} for name in server.models]
            key = "models" if "v1beta" in self.path else "data"
            self._write(200, json.dumps({key: names}).encode(), {})

        def _send(self, reply: Reply) -> None:
            match reply:
                case Stalls():
                    server.closing.wait()
                    self.close_connection = True
                case Fails(status, headers, message):
                    self._write(
                        status, json.dumps(error_body(self.path, status, message)).encode(), headers
                    )
                case Sends(body, content_type, chunked, headers):
                    self._write(200, body, {"content-type": content_type, **headers}, chunked)
                case Says():
                    self._write(200, json.dumps(wire(self.path, reply)).encode(), {})

        def _write(
            self, status: int, body: bytes, headers: Mapping[str, str], chunked: bool = False
        ) -> None:
            self.send_response(status)
            for name, value in {"content-type": "application/json", **headers}.items():
                self.send_header(name, value)
            if chunked:
                self.send_header("transfer-encoding", "chunked")
                self.end_headers()
                for start in range(0, len(body), 65536):
                    part = body[start : start + 65536]
                    self.wfile.write(f"{len(part):x}\r\n".encode() + part + b"\r\n")
                self.wfile.write(b"0\r\n\r\n")
                return
            self.send_header("content-length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    return Handler


def wire(path: str, says: Says) -> dict[str, Any]:
    """`says` in the wire format that belongs to the request's path."""
    if path.endswith("/chat/completions"):
        message = {
            "role": "assistant",
            "content": None if says.refusal else says.text,
            "refusal": says.refusal or None,
        }
        return {
            "id": "chatcmpl-1",
            "object": "chat.completion",
            "created": 1_700_000_000,
            "model": f"{MODEL}-2026",
            "choices": [
                {"index": 0, "message": message, "finish_reason": says.finish, "logprobs": None}
            ],
            "usage": {
                "prompt_tokens": 3000,
                "completion_tokens": 500,
                "total_tokens": 3500,
                "prompt_tokens_details": {"cached_tokens": 2500},
            },
        }
    if path.split("?")[0].endswith("/messages"):
        stop = {"stop": "end_turn", "length": "max_tokens"}.get(says.finish, says.finish)
        return {
            "id": "msg_1",
            "type": "message",
            "role": "assistant",
            "model": f"{MODEL}-2026",
            "content": [{"type": "text", "text": says.refusal or says.text}],
            "stop_reason": "refusal" if says.refusal else stop,
            "stop_sequence": None,
            "usage": {
                "input_tokens": 500,
                "cache_read_input_tokens": 2500,
                "cache_creation_input_tokens": 0,
                "output_tokens": 500,
            },
        }
    if ":generateContent" in path:
        finish = {"stop": "STOP", "length": "MAX_TOKENS"}.get(says.finish, says.finish)
        parts = [{"text": says.refusal or says.text}]
        return {
            "candidates": [
                {
                    "content": {"role": "model", "parts": parts},
                    "finishReason": "SAFETY" if says.refusal else finish,
                    "index": 0,
                }
            ],
            "modelVersion": f"{MODEL}-2026",
            "responseId": "r1",
            "usageMetadata": {
                "promptTokenCount": 3000,
                "cachedContentTokenCount": 2500,
                "candidatesTokenCount": 500,
                "totalTokenCount": 3500,
            },
        }
    raise AssertionError(f"no such endpoint: {path}")


def error_body(path: str, status: int, message: str) -> dict[str, Any]:
    """An error as the provider words it."""
    if path.endswith("/chat/completions"):
        return {"error": {"message": message, "type": "error", "param": None, "code": None}}
    if path.split("?")[0].endswith("/messages"):
        kinds = {401: "authentication_error", 429: "rate_limit_error", 500: "api_error"}
        return {
            "type": "error",
            "error": {"type": kinds.get(status, "api_error"), "message": message},
        }
    states = {401: "UNAUTHENTICATED", 429: "RESOURCE_EXHAUSTED", 500: "INTERNAL"}
    return {"error": {"code": status, "message": message, "status": states.get(status, "UNKNOWN")}}
