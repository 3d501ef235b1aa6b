"""Dialogue with a provider through pydantic-ai: messages, retries, deadlines, errors in plain
words.

The home of the model SDK, which is loaded when a model is asked, never before. Of pydantic-ai
this takes the request alone. Its `Agent` fences feedback and adds a note about the fence to the
system prompt, which then is not the one that was recorded; it ends at a refusal or an answer cut
short instead of telling the model; and its `UsageLimits` throw away the answer that reaches a
limit, be it a valid plan. Its retrying transport sees a status, not that a quota is used up, and
does not repeat a body that breaks off.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from palpate.errors import PalpateError, Unavailable
from palpate.planning.model.dialogue.conversation import Answer
from palpate.planning.model.failures import NOT_THE_API, TOO_LARGE, may_pass, reason
from palpate.planning.model.picture import Picture
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.sdk import sdk_model
from palpate.planning.model.settings import Budget
from palpate.planning.model.wire import bounded_client, is_too_large
from palpate.redaction import redact

if TYPE_CHECKING:
    from pydantic_ai.exceptions import ModelAPIError
    from pydantic_ai.messages import ModelMessage, ModelResponse
    from pydantic_ai.models import ModelRequestParameters
    from pydantic_ai.settings import ModelSettings as RequestSettings


BACKOFF = (1.0, 2.0, 4.0, 8.0)
"""s: waits before a request is repeated when the provider names none; as many repeats as there are
waits."""
LONGEST_ANSWER = 16_000
"""Tokens of one answer, reasoning included."""


@dataclass(slots=True)
class Session:
    """The dialogue as the provider sees it: the messages so far, and the time that is left."""

    endpoint: Endpoint
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
            provider = self.endpoint.provider
            raise Unavailable(
                f"the planner '{provider.name}' needs its SDK: "
                f"pip install 'palpate[{provider.extra}]'"
            ) from None
        answer = _answer(response, time.monotonic() - started, requests)
        self.tokens += answer.input_tokens + answer.output_tokens
        return answer

    async def _exchange(self, message: str) -> tuple[ModelResponse, int]:
        """The response to `message`, repeated where that helps, and how many requests it took."""
        from pydantic_ai.exceptions import ModelAPIError

        self.messages.append(self._request(message))
        for attempt in range(1, len(BACKOFF) + 2):
            try:
                response = _without_keys(await self._response())
            except ModelAPIError as error:
                wait = self._wait(error, attempt)
            else:
                self.messages.append(response)
                return response, attempt
            await asyncio.sleep(wait)
        raise AssertionError("unreachable: _wait raises after the last attempt")

    async def _response(self) -> ModelResponse:
        """The response to the messages so far, from one request.

        Raises:
            ModelAPIError: the provider failed or refused.
            Unavailable: what came back is not its API.
        """
        from pydantic_ai.direct import model_request
        from pydantic_ai.exceptions import ModelAPIError

        async with bounded_client(self._patience()) as client:
            try:
                return await model_request(
                    sdk_model(self.endpoint, client),
                    self.messages,
                    model_settings=self._settings(),
                    model_request_parameters=self._parameters(),
                )
            except (ModelAPIError, ImportError, PalpateError):
                raise
            except Exception as error:
                # the SDKs raise kinds of their own on answers that they do not understand
                if is_too_large(error):
                    raise self._failure(TOO_LARGE) from None
                raise self._failure(NOT_THE_API) from None

    def _request(self, message: str) -> ModelMessage:
        from pydantic_ai.messages import BinaryContent, ModelRequest, UserContent, UserPromptPart

        content: list[UserContent] = [message]
        if not self.messages:  # the pictures go with the first message
            for picture in self.pictures:
                content.append(BinaryContent(picture.data, media_type=picture.media_type))
        return ModelRequest([UserPromptPart(content)], instructions=self.system or None)

    def _settings(self) -> RequestSettings:
        return {
            "max_tokens": max(1, min(LONGEST_ANSWER, self.budget.tokens - self.tokens)),
            "request_timeout": self._patience(),
            "max_retries": 0,
            "cache": True,
        }

    def _patience(self) -> float:
        """s that the next request may take."""
        return self.budget.patience(self.deadline - time.monotonic())

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
        what = reason(error, self.endpoint)
        if not may_pass(error):
            raise self._failure(what) from None
        if attempt > len(BACKOFF):
            raise self._failure(f"{what}, {attempt} times") from None
        wait = BACKOFF[attempt - 1]
        if error.retry_after is not None:
            wait = max(0.0, error.retry_after)
            what += f" and asks to wait {wait:.0f} s"
        left = self.deadline - time.monotonic()
        if wait < left:
            return wait
        of_budget = f"{max(0.0, left):.0f} s of {self.budget.seconds:.0f} s are left"
        raise self._failure(f"{what}; {of_budget}") from None

    def _failure(self, reason: str) -> Unavailable:
        return Unavailable(redact(f"{self.endpoint.name}: {reason}"))


def _without_keys(response: ModelResponse) -> ModelResponse:
    """The response as it may be kept, without any key that it repeats."""
    from pydantic_ai.messages import ModelResponsePart, TextPart

    parts: list[ModelResponsePart] = []
    for part in response.parts:
        if isinstance(part, TextPart):
            parts.append(replace(part, content=redact(part.content)))
        else:
            parts.append(part)
    return replace(response, parts=parts)


def _answer(response: ModelResponse, seconds: float, requests: int) -> Answer:
    from pydantic_ai.messages import TextPart

    usage = response.usage
    text = "".join(part.content for part in response.parts if isinstance(part, TextPart))
    refusal = str((response.provider_details or {}).get("refusal", ""))
    return Answer(
        redact(text or refusal),
        redact(response.model_name or ""),
        usage.input_tokens,
        usage.cache_read_tokens,
        usage.output_tokens,
        _cost(response),
        seconds,
        requests,
        redact(response.finish_reason or ""),
    )


def _cost(response: ModelResponse) -> float | None:
    """US dollars by the list prices that came with the SDK; None for a model they do not know."""
    try:
        return float(response.cost().total_price)
    except (LookupError, ValueError, AssertionError):
        return None
