"""One dialogue with a provider through pydantic-ai: messages, retries, deadlines, errors in plain
words.

The home of the model SDK, which is loaded when a model is asked, never before.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from palpate.errors import PalpateError, Unavailable
from palpate.planning.model.conversation import FEEDBACK_ROUNDS, Answer, Conversation
from palpate.planning.model.picture import Picture
from palpate.planning.model.provider import Provider, redact
from palpate.planning.model.wire import bounded_client, is_too_large

if TYPE_CHECKING:
    import httpx2
    from pydantic_ai.exceptions import ModelAPIError
    from pydantic_ai.messages import ModelMessage, ModelResponse
    from pydantic_ai.models import Model, ModelRequestParameters
    from pydantic_ai.settings import ModelSettings as RequestSettings

BACKOFF = (1.0, 2.0, 4.0, 8.0)
"""s: waits before a request is repeated when the provider names none; as many repeats as there are
waits."""
LONGEST_ANSWER = 16_000
"""Tokens of one answer, reasoning included."""
TOO_LARGE = "the reply is larger than any plan; check the base URL"
NOT_THE_API = "the reply is not in the form of this provider's API; check the base URL"


@dataclass(frozen=True, slots=True)
class Budget:
    """What one plan may cost.

    Attributes:
        seconds: wall time of the whole dialogue. attempt_seconds: of one request.
        tokens: input and output together. dollars: by list prices, where the model has one.
    """

    seconds: float = 300.0
    attempt_seconds: float = 120.0
    tokens: int = 200_000
    dollars: float = 2.0

    def exhausted(self, conversation: Conversation) -> str | None:
        """Why no further message may be sent, or None."""
        if conversation.tokens >= self.tokens:
            return f"the budget of {self.tokens} tokens is used up"
        if (conversation.cost or 0.0) >= self.dollars:
            return f"the budget of ${self.dollars:g} is used up"
        return None


@dataclass(frozen=True, slots=True)
class ModelSettings:
    """How a model is asked.

    Attributes:
        base_url: where an OpenAI-compatible server, or a proxy, listens; the provider's own if
            None.
        native: ask for the provider's structured output, in the flat form, instead of JSON in
            prose.
        without: prompt modules and inputs to leave out (ablation).
        rounds: how often findings are fed back.
    """

    base_url: str | None = None
    native: bool = False
    without: frozenset[str] = frozenset()
    rounds: int = FEEDBACK_ROUNDS
    budget: Budget = field(default_factory=Budget)


@dataclass(slots=True)
class Session:
    """The dialogue as the provider sees it: the messages so far, and the time that is left."""

    provider: Provider
    model: str
    address: str | None
    system: str
    pictures: Sequence[Picture]
    schema: dict[str, Any] | None
    budget: Budget
    messages: list[ModelMessage] = field(default_factory=list["ModelMessage"], init=False)
    tokens: int = field(default=0, init=False)
    deadline: float = field(default=0.0, init=False)

    def ask(self, message: str) -> Answer:
        """Send the next message.

        Raises:
            Unavailable: the provider cannot be reached, refuses, or the time is used up.
        """
        started = time.monotonic()
        self.deadline = self.deadline or started + self.budget.seconds
        try:
            response, requests = asyncio.run(self._exchange(message))
        except ImportError:
            raise Unavailable(
                f"the planner '{self.provider.name}' needs its SDK: "
                f"pip install 'palpate[{self.provider.extra}]'"
            ) from None
        answer = _answer(response, time.monotonic() - started, requests)
        self.tokens += answer.input_tokens + answer.output_tokens
        return answer

    async def _exchange(self, message: str) -> tuple[ModelResponse, int]:
        """The response to `message`, repeated where that helps, and how many requests it took."""
        from pydantic_ai.direct import model_request
        from pydantic_ai.exceptions import ModelAPIError

        self.messages.append(self._request(message))
        for attempt in range(1, len(BACKOFF) + 2):
            async with bounded_client(self.budget.attempt_seconds) as client:
                try:
                    response = await model_request(
                        _model(self.provider, self.model, self.address, client),
                        self.messages,
                        model_settings=self._settings(),
                        model_request_parameters=self._parameters(),
                    )
                except ModelAPIError as error:
                    wait = self._wait(error, attempt)
                except (ImportError, PalpateError):
                    raise
                except (
                    Exception
                ) as error:  # the SDKs raise their own kinds on answers they do not understand
                    raise self._failure(TOO_LARGE if is_too_large(error) else NOT_THE_API) from None
                else:
                    response = _without_keys(response)
                    self.messages.append(response)
                    return response, attempt
            await asyncio.sleep(wait)
        raise AssertionError("unreachable: _wait raises after the last attempt")

    def _request(self, message: str) -> ModelMessage:
        from pydantic_ai.messages import BinaryContent, ModelRequest, UserContent, UserPromptPart

        pictures = (
            []
            if self.messages
            else [BinaryContent(p.data, media_type=p.media_type) for p in self.pictures]
        )
        content: list[UserContent] = [message, *pictures]
        return ModelRequest([UserPromptPart(content)], instructions=self.system or None)

    def _settings(self) -> RequestSettings:
        left = max(0.1, self.deadline - time.monotonic())
        return {
            "max_tokens": max(1, min(LONGEST_ANSWER, self.budget.tokens - self.tokens)),
            "request_timeout": min(left, self.budget.attempt_seconds),
            "max_retries": 0,
            "cache": True,
        }

    def _parameters(self) -> ModelRequestParameters:
        from pydantic_ai.models import ModelRequestParameters
        from pydantic_ai.output import OutputObjectDefinition

        if self.schema is None:
            return ModelRequestParameters()
        wanted = OutputObjectDefinition(json_schema=self.schema, name="plan", strict=True)
        return ModelRequestParameters(output_mode="native", output_object=wanted)

    def _wait(self, error: ModelAPIError, attempt: int) -> float:
        """Seconds until the request may be repeated.

        Raises:
            Unavailable: repeating does not help, or there is no time for it.
        """
        reason = _reason(error, self.provider, self.model)
        if not _passing(error):
            raise self._failure(reason) from None
        if attempt > len(BACKOFF):
            raise self._failure(f"{reason}, {attempt} times") from None
        wait = BACKOFF[attempt - 1] if error.retry_after is None else max(0.0, error.retry_after)
        left = self.deadline - time.monotonic()
        if wait >= left:
            asked = "" if error.retry_after is None else f" and asks to wait {wait:.0f} s"
            raise self._failure(
                f"{reason}{asked}; {max(0.0, left):.0f} s of {self.budget.seconds:.0f} s are left"
            ) from None
        return wait

    def _failure(self, reason: str) -> Unavailable:
        return Unavailable(redact(f"{self.provider.name}:{self.model}: {reason}"))


def _model(
    provider: Provider, model: str, address: str | None, client: httpx2.AsyncClient
) -> Model:
    """The SDK's model behind `provider`, asked through `client`."""
    if provider.name == "google":
        from pydantic_ai.models.google import GoogleModel
        from pydantic_ai.providers.google import GoogleProvider

        return GoogleModel(
            model,
            provider=GoogleProvider(api_key=provider.key(), http_client=client, base_url=address),
        )
    if provider.name == "anthropic":
        from pydantic_ai.models.anthropic import AnthropicModel
        from pydantic_ai.providers.anthropic import AnthropicProvider

        return AnthropicModel(
            model,
            provider=AnthropicProvider(
                api_key=provider.key(), http_client=client, base_url=address
            ),
        )
    return _chat_model(provider, model, address, client)


def _chat_model(
    provider: Provider, model: str, address: str | None, client: httpx2.AsyncClient
) -> Model:
    """A model behind OpenAI chat completions, OpenAI's own or another server's."""
    from pydantic_ai.models.openai import OpenAIChatModel
    from pydantic_ai.providers.ollama import OllamaProvider
    from pydantic_ai.providers.openai import OpenAIProvider
    from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider
    from pydantic_ai.providers.vllm import VLLMProvider

    key = provider.key()
    if provider.name == "openai":
        return OpenAIChatModel(
            model, provider=OpenAIProvider(base_url=address, api_key=key, http_client=client)
        )
    if provider.name == "ollama":
        return OpenAIChatModel(
            model, provider=OllamaProvider(base_url=address, api_key=key, http_client=client)
        )
    if provider.name == "vllm":
        return OpenAIChatModel(
            model, provider=VLLMProvider(base_url=address, api_key=key, http_client=client)
        )
    assert address is not None
    return OpenAIChatModel(
        model,
        provider=OpenAICompatibleProvider(
            "compatible", base_url=address, api_key=key, http_client=client
        ),
    )


def _without_keys(response: ModelResponse) -> ModelResponse:
    from pydantic_ai.messages import TextPart

    return replace(
        response,
        parts=[
            replace(part, content=redact(part.content)) if isinstance(part, TextPart) else part
            for part in response.parts
        ],
    )


def _answer(response: ModelResponse, seconds: float, requests: int) -> Answer:
    from pydantic_ai.messages import TextPart

    usage = response.usage
    text = "".join(part.content for part in response.parts if isinstance(part, TextPart))
    refusal = str((response.provider_details or {}).get("refusal", ""))
    return Answer(
        text or redact(refusal),
        response.model_name or "",
        usage.input_tokens,
        usage.cache_read_tokens,
        usage.output_tokens,
        _cost(response),
        seconds,
        requests,
        response.finish_reason or "",
    )


def _cost(response: ModelResponse) -> float | None:
    """US dollars by the list prices that came with the SDK; None for a model they do not know."""
    try:
        return float(response.cost().total_price)
    except (LookupError, ValueError, AssertionError):
        return None


def _passing(error: ModelAPIError) -> bool:
    """Whether the same request may succeed a little later."""
    from pydantic_ai import exceptions as e

    kinds = (
        e.ModelRateLimitError,
        e.ModelUnavailableError,
        e.ModelServerError,
        e.ModelConnectionError,
        e.ModelRequestTimeout,
    )
    return isinstance(error, kinds) and not is_too_large(error)


def _reason(error: ModelAPIError, provider: Provider, model: str) -> str:
    """What went wrong and what to do about it, without the provider's own text where that may be
    long."""
    from pydantic_ai import exceptions as e

    status = f" (HTTP {error.status_code})" if isinstance(error, e.ModelHTTPError) else ""
    if is_too_large(error):
        return TOO_LARGE
    if isinstance(error, e.ModelAuthenticationError):
        return f"the key was refused{status}; check {provider.key_variables[0]} and what it may use"
    if isinstance(error, e.ModelNotFoundError):
        return (
            f"there is no model '{model}' at this address{status}; check the name and the base URL"
        )
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
    return f"the request was refused{status}: {' '.join(str(error.body).split())[:200]}"
