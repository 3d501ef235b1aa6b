"""Providers of models, and access to them by the SDK."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import TYPE_CHECKING
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
        extra: pip extra that installs its SDK.
        key_variables: environment variables that may hold its key, the first wins.
        url_variable: environment variable that may hold its address.
        model: default model; empty where that depends on the server.
        url: default address, None for the SDK's own, empty where one must be given.
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
        """The key in the environment, if any."""
        return next((value for v in self.key_variables if (value := os.environ.get(v))), None)

    def require_key(self) -> None:
        """Raise Unavailable if the provider needs a key and the environment has none."""
        if self.key_required and not self.key():
            raise Unavailable(
                f"the planner '{self.name}' needs a key: set {self.key_variables[0]} in the environment, "
                "or use planner=symbolic, which needs none"
            )

    def address(self, base_url: str | None) -> str | None:
        """The address to use: `base_url`, else the environment's, else the default.

        Raises:
            InputError: it is not an http or https address, or there is none.
        """
        url = base_url or os.environ.get(self.url_variable) or self.url
        if url == "":
            raise InputError(
                f"the planner '{self.name}' needs an address: give base_url=URL, or set {self.url_variable}"
            )
        if url is not None and (
            urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname
        ):
            raise InputError(
                "the base URL must start with http:// or https:// and name a host, "
                "e.g. http://localhost:8080/v1"
            )
        return url


def _local(name: str, variables: str, url: str) -> Provider:
    """A server that speaks OpenAI chat completions and needs no key."""
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
"""`compatible` is any other server that speaks OpenAI chat completions, such as llama.cpp's."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Model of a provider with its address, None for the SDK's own."""

    provider: Provider
    model: str
    address: str | None

    @classmethod
    def of(cls, planner: str, base_url: str | None = None) -> Endpoint:
        """Endpoint of `PROVIDER:MODEL` or `PROVIDER`.

        Raises:
            InputError: unknown provider, no model where there is no default, or no address.
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
    """Provider and model of `PROVIDER:MODEL` or `PROVIDER`.

    Raises:
        InputError: unknown provider, or no model where there is no default.
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


# Access to providers: the SDK's model behind each, the HTTP client, and failures in plain words.


MAX_BODY = 2_000_000
"""Bytes of one reply; a plan of fifteen objects is some 20 kB."""
MAX_COMPRESSED_BODY = 100_000
"""Bytes of a compressed reply, of which one may expand to a thousand."""
TOO_LARGE = "the reply is larger than any plan; check the base URL"
NOT_THE_API = "the reply is not in the form of this provider's API; check the base URL"


class ReplyTooLarge(Exception):
    """The provider sends more than is read."""


def sdk_model(endpoint: Endpoint, client: httpx2.AsyncClient) -> Model:
    """The SDK's model behind `endpoint`, asked through `client`.

    Raises:
        ImportError: the provider's SDK is not installed.
    """
    name, key, address = endpoint.provider.name, endpoint.provider.key(), endpoint.address
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
        assert address is not None  # Provider.address demands one
        sdk = OpenAICompatibleProvider(
            "compatible", base_url=address, api_key=key, http_client=client
        )
    return OpenAIChatModel(endpoint.model, provider=sdk)


def bounded_client(seconds: float) -> httpx2.AsyncClient:
    """A client without redirects, whose replies end in `ReplyTooLarge` when they grow beyond the bound.
    Close it with `async with`."""
    import httpx2

    return httpx2.AsyncClient(
        timeout=httpx2.Timeout(seconds, connect=min(10.0, seconds)),
        follow_redirects=False,  # a redirect could carry the key to another host
        event_hooks={"response": [_bound]},
    )


async def _bound(response: httpx2.Response) -> None:
    import httpx2

    compressed = response.headers.get("content-encoding", "identity") != "identity"
    limit = MAX_COMPRESSED_BODY if compressed else MAX_BODY
    # The declared length may be missing or false, so the received bytes are counted, too.
    declared = response.headers.get("content-length", "0")
    if declared.isdigit() and int(declared) > limit:
        raise ReplyTooLarge
    inner = response.stream
    assert isinstance(inner, httpx2.AsyncByteStream)

    class Bounded(httpx2.AsyncByteStream):
        async def __aiter__(self) -> AsyncIterator[bytes]:
            read = 0
            async for chunk in inner:
                read += len(chunk)
                if read > limit:
                    raise ReplyTooLarge
                yield chunk

        async def aclose(self) -> None:
            await inner.aclose()

    response.stream = Bounded()


def is_too_large(error: BaseException) -> bool:
    """True if a `ReplyTooLarge` caused `error`, through any number of exceptions."""
    link: BaseException | None = error  # the SDKs wrap the client's exceptions
    while link is not None:
        if isinstance(link, ReplyTooLarge):
            return True
        link = link.__cause__ or link.__context__
    return False


def may_pass(error: ModelAPIError) -> bool:
    """True if the same request may succeed a little later."""
    from pydantic_ai import exceptions as e

    kinds = (
        e.ModelRateLimitError,
        e.ModelUnavailableError,
        e.ModelServerError,
        e.ModelConnectionError,
        e.ModelRequestTimeout,
    )
    return isinstance(error, kinds) and not is_too_large(error)


def reason(error: ModelAPIError, endpoint: Endpoint) -> str:
    """Description of a failure with a remedy; the provider's own text is cut short."""
    from pydantic_ai import exceptions as e

    status = f" (HTTP {error.status_code})" if isinstance(error, e.ModelHTTPError) else ""
    if is_too_large(error):
        return TOO_LARGE
    # Specific kinds before their bases.
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
    if not isinstance(error, e.ModelHTTPError):
        return NOT_THE_API
    return f"the request was refused{status}: {redact(' '.join(str(error.body).split()))[:200]}"
