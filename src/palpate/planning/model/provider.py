"""Providers of models, and access through their SDKs."""

from __future__ import annotations

import json
import os
import re
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import urlsplit

from palpate.common.errors import InputError, Unavailable, unknown_name
from palpate.common.redaction import redact

if TYPE_CHECKING:
    import httpx2
    from pydantic_ai.exceptions import ModelAPIError
    from pydantic_ai.models import Model


@dataclass(frozen=True, slots=True)
class Provider:
    """Provider of models.

    Attributes:
        name: prefix in `--planner NAME:MODEL`.
        extra: pip extra with its SDK.
        key_variables: environment variables for its key; the first one set applies.
        url_variable: environment variable for its address.
        model: default model; empty if it depends on the server.
        url: default address; None for the SDK's own, empty if one must be given.
        key_required: it needs a key.
    """

    name: str
    extra: str
    key_variables: tuple[str, ...]
    url_variable: str
    model: str = ""
    url: str | None = None
    key_required: bool = True

    def key(self) -> str | None:
        """Return the key in the environment, if any."""
        return next((value for v in self.key_variables if (value := os.environ.get(v))), None)

    def require_key(self) -> None:
        """Require a key in the environment, if the provider needs one. Raises Unavailable: there is none."""
        if self.key_required and not self.key():
            raise Unavailable(
                f"the planner '{self.name}' needs a key: set {self.key_variables[0]} in the environment, "
                "or use planner=symbolic, which needs none"
            )

    def address(self, base_url: str | None) -> str | None:
        """Return the address: `base_url`, else the environment's, else the default.

        Raises InputError: it is not an http or https address, or there is none.
        """
        # Order of precedence: argument, environment, default.
        url = base_url or os.environ.get(self.url_variable) or self.url
        # An empty default means that the user must give an address.
        if url == "":
            raise InputError(
                f"the planner '{self.name}' needs an address: give base_url=URL, or set {self.url_variable}"
            )
        # A key is only sent to a complete http or https address.
        if url is not None and (
            urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname
        ):
            raise InputError(
                "the base URL must start with http:// or https:// and name a host, "
                "e.g. http://localhost:8080/v1"
            )
        return url


def _local(name: str, variables: str, url: str) -> Provider:
    """Local server with the OpenAI chat completions API and without a key."""
    # Local servers read an optional key from the environment.
    keys, url_variable = (f"{variables}_API_KEY",), f"{variables}_BASE_URL"
    return Provider(name, "openai", keys, url_variable, url=url, key_required=False)


PROVIDERS = {
    p.name: p
    for p in (
        Provider("openai", "openai", ("OPENAI_API_KEY",), "OPENAI_BASE_URL", "gpt-6.1-terra"),
        Provider(
            "google",
            "google",
            ("GOOGLE_API_KEY", "GEMINI_API_KEY"),
            "GOOGLE_GEMINI_BASE_URL",
            "gemini-3.8-flash",
        ),
        Provider(
            "anthropic",
            "anthropic",
            ("ANTHROPIC_API_KEY",),
            "ANTHROPIC_BASE_URL",
            "claude-sonnet-5-5",
        ),
        _local("ollama", "OLLAMA", "http://localhost:11434/v1"),
        _local("vllm", "VLLM", "http://localhost:8000/v1"),
        _local("compatible", "OPENAI_COMPATIBLE", ""),
    )
}
"""Providers by name. `compatible` is any other server with the OpenAI chat completions API, such as
llama.cpp's.
"""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Model of a provider with its address; None for the SDK's own."""

    provider: Provider
    model: str
    address: str | None

    @classmethod
    def of(cls, planner: str, base_url: str | None = None) -> Endpoint:
        """Make the endpoint of `PROVIDER:MODEL` or `PROVIDER`.

        Raises:
            InputError: unknown provider, no model without a default, or no address.
            Unavailable: the provider needs a key and the environment has none.
        """
        provider, model = find_provider(planner)
        provider.require_key()
        return cls(provider, model, provider.address(base_url))

    @property
    def name(self) -> str:
        """`PROVIDER:MODEL`."""
        return f"{self.provider.name}:{self.model}"


def find_provider(planner: str) -> tuple[Provider, str]:
    """Return the provider and model of `PROVIDER:MODEL` or `PROVIDER`.

    Raises InputError: unknown provider, or no model without a default.
    """
    name, _, model = planner.partition(":")
    if name not in PROVIDERS:
        raise unknown_name("provider", name, PROVIDERS)
    provider = PROVIDERS[name]
    if not (model or provider.model):
        raise InputError(
            f"the planner '{name}' needs a model: '{name}:MODEL', with a model your server has"
        )
    return provider, model or provider.model


# Access to providers: SDK models, the HTTP client, and readable errors.


MAX_BODY = 2_000_000
"""bytes. Maximum size of a reply; a plan of fifteen objects has about 20 kB."""
MAX_COMPRESSED_BODY = 100_000
"""bytes. Maximum size of a compressed reply, which may expand a thousandfold."""
TOO_LARGE = "the reply is larger than any plan; check the base URL"
NOT_THE_API = "the reply is not in the form of this provider's API; check the base URL"


class ReplyTooLarge(Exception):
    """The reply of the provider exceeds its limit."""


class ReportedError(Exception):
    """The reply has the status of success, and an error of the server."""


def sdk_model(endpoint: Endpoint, client: httpx2.AsyncClient) -> Model:
    """Return the SDK's model of `endpoint`, with requests through `client`.

    Raises ImportError: the provider's SDK is not installed.
    """
    name, key, address = endpoint.provider.name, endpoint.provider.key(), endpoint.address
    # Google and Anthropic have their own SDKs.
    if name == "google":
        from pydantic_ai.models.google import GoogleModel
        from pydantic_ai.providers.google import GoogleProvider

        google = GoogleProvider(api_key=key, http_client=client, base_url=address)
        return GoogleModel(endpoint.model, provider=google)
    if name == "anthropic":
        from pydantic_ai.models.anthropic import AnthropicModel
        from pydantic_ai.providers.anthropic import AnthropicProvider

        anthropic = AnthropicProvider(api_key=key, http_client=client, base_url=address)
        return AnthropicModel(endpoint.model, provider=anthropic)
    # All others answer OpenAI chat completions.
    from pydantic_ai.models.openai import OpenAIChatModel
    from pydantic_ai.providers.ollama import OllamaProvider
    from pydantic_ai.providers.openai import OpenAIProvider
    from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider
    from pydantic_ai.providers.vllm import VLLMProvider

    own = {"openai": OpenAIProvider, "ollama": OllamaProvider, "vllm": VLLMProvider}
    if name in own:
        sdk = own[name](base_url=address, api_key=key, http_client=client)
    else:
        assert address is not None  # Provider.address requires one
        sdk = OpenAICompatibleProvider(
            "compatible", base_url=address, api_key=key, http_client=client
        )
    return OpenAIChatModel(endpoint.model, provider=sdk)


def bounded_client(seconds: float) -> httpx2.AsyncClient:
    """Return a client without redirects and with bounded replies; close it with `async with`.

    A reply beyond the bound raises `ReplyTooLarge`.
    """
    import httpx2

    return httpx2.AsyncClient(
        timeout=httpx2.Timeout(seconds, connect=min(10.0, seconds)),
        follow_redirects=False,  # a redirect could carry the key to another host
        event_hooks={"response": [_bound]},
    )


async def _bound(response: httpx2.Response) -> None:
    import httpx2

    # A compressed body may expand a thousandfold, so its limit is lower.
    compressed = response.headers.get("content-encoding", "identity") != "identity"
    limit = MAX_COMPRESSED_BODY if compressed else MAX_BODY
    # The declared length may be missing or false, so the received bytes are counted too.
    declared = response.headers.get("content-length", "0")
    if declared.isdigit() and int(declared) > limit:
        raise ReplyTooLarge
    # Count the received bytes while the SDK reads them.
    inner = response.stream
    assert isinstance(inner, httpx2.AsyncByteStream)
    plain = not compressed and response.is_success
    events = "text/event-stream" in response.headers.get("content-type", "")

    class Bounded(httpx2.AsyncByteStream):
        async def __aiter__(self) -> AsyncIterator[bytes]:
            read, chunks = 0, list[bytes]()
            async for chunk in inner:
                read += len(chunk)
                if read > limit:
                    raise ReplyTooLarge
                chunks.append(chunk)
            body = b"".join(chunks)
            yield complete_reply(body) if plain else body

        async def aclose(self) -> None:
            await inner.aclose()

    if plain and events:
        response.headers["content-type"] = "application/json"
    response.stream = Bounded()


def complete_reply(body: bytes) -> bytes:
    """Complete a chat completion of a server that leaves out fields or streams unasked.

    Raises ReportedError: the reply has an error in place of an answer.
    """
    try:
        document = _join_events(body) if body.lstrip().startswith(b"data:") else json.loads(body)
    except (ValueError, RecursionError, TypeError, AttributeError):
        return body
    if not isinstance(document, dict):
        return body
    reply = cast("dict[str, Any]", document)
    choices: Any = reply.get("choices")
    error = reply.get("error")
    if error and not (choices or reply.get("candidates") or reply.get("content")):
        message: Any = (
            cast("dict[str, Any]", error).get("message", error)
            if isinstance(error, dict)
            else error
        )
        raise ReportedError(redact(" ".join(str(message).split()))[:200])
    if not isinstance(choices, list):
        return body
    # Fields that the SDK requires, and that carry nothing for a plan.
    whole = {"id": "none", "object": "chat.completion", "created": 0, "model": "unknown"} | reply
    for i, choice in enumerate(cast("list[Any]", choices)):
        if isinstance(choice, dict):
            completed = cast("dict[str, Any]", choice)
            completed.setdefault("index", i)
            completed["finish_reason"] = completed.get("finish_reason") or "stop"
    return json.dumps(whole).encode()


def _join_events(body: bytes) -> dict[str, Any]:
    """Join the events of a streamed chat completion."""
    lines = [line[5:].strip() for line in body.splitlines() if line.startswith(b"data:")]
    events: list[Any] = [json.loads(line) for line in lines if line and line != b"[DONE]"]
    if any("error" in event for event in events):
        return next(event for event in events if "error" in event)
    parts: list[dict[str, Any]] = [c for event in events for c in event.get("choices", ())[:1]]
    deltas: list[dict[str, Any]] = [part.get("delta") or {} for part in parts]
    text = "".join(delta.get("content") or "" for delta in deltas)
    finish = next((part["finish_reason"] for part in parts if part.get("finish_reason")), "stop")
    message = {"role": "assistant", "content": text}
    usage = next((event["usage"] for event in events if event.get("usage")), None)
    merged = {
        key: value
        for event in events
        for key, value in event.items()
        if key in ("id", "created", "model")
    }
    return merged | {"choices": [{"message": message, "finish_reason": finish}], "usage": usage}


def cause_of(error: BaseException) -> str:
    """Return the reason why a reply is unusable, through any chain of exceptions."""
    link: BaseException | None = error  # the SDKs wrap the client's exceptions
    while link is not None:
        if isinstance(link, ReplyTooLarge):
            return TOO_LARGE
        if isinstance(link, ReportedError):
            return f"the server reports an error: {link}"
        link = link.__cause__ or link.__context__
    return ""


def may_pass(error: ModelAPIError) -> bool:
    """True if the same request may succeed later."""
    from pydantic_ai import exceptions as e

    # Rate limits, failures and lost connections are transient.
    kinds = (
        e.ModelRateLimitError,
        e.ModelUnavailableError,
        e.ModelServerError,
        e.ModelConnectionError,
        e.ModelRequestTimeout,
    )
    return isinstance(error, kinds) and not cause_of(error)


def reason(error: ModelAPIError, endpoint: Endpoint) -> str:
    """Describe a failure with a remedy; the provider's own text is truncated."""
    from pydantic_ai import exceptions as e

    status = f" (HTTP {error.status_code})" if isinstance(error, e.ModelHTTPError) else ""
    if cause := cause_of(error):
        return cause
    # Test specific exceptions before their base classes.
    if isinstance(error, e.ModelAuthenticationError):
        return f"the key was refused{status}; check {endpoint.provider.key_variables[0]} and what it may use"
    if isinstance(error, e.ModelNotFoundError):
        return f"there is no model '{endpoint.model}' at this address{status}; check the name and the base URL"
    if isinstance(error, e.ModelQuotaExceededError):
        return f"quota or credit is used up{status}; see your account with the provider"
    if isinstance(error, e.ModelRateLimitError):
        return f"the provider limits the rate{status}"
    if isinstance(error, e.ModelRequestTimeout | e.ModelTimeoutError):
        return "no answer came in time"
    if isinstance(error, e.ModelConnectionError):
        return "the provider cannot be reached; check the network and the base URL"
    if isinstance(error, e.ModelServerError | e.ModelUnavailableError):
        return f"the provider failed{status}"
    # All other HTTP errors quote the provider's text, without keys.
    if not isinstance(error, e.ModelHTTPError):
        return NOT_THE_API
    body = redact(" ".join(str(error.body).split()))[:200]
    # Servers without structured output name its field.
    hint = "; leave out --native" if re.search(r"response_format|json_schema", body) else ""
    return f"the request was refused{status}: {body}{hint}"
