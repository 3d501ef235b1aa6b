"""Access to providers: the SDK's model behind each, the HTTP client, and failures in plain words.

The SDKs are imported when a model is asked, never before.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

from palpate.planning.model.provider import Endpoint
from palpate.redaction import redact

if TYPE_CHECKING:
    import httpx2
    from pydantic_ai.exceptions import ModelAPIError
    from pydantic_ai.models import Model

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
