"""Dialogue with a provider through pydantic-ai: messages, pictures, retries, deadlines, errors.

Only pydantic-ai's request function is used, for these reasons:

- Its `Agent` fences feedback and adds a note to the system prompt, which then differs from the
  recorded one. It ends at a refusal or a truncated answer instead of returning it to the model.
- Its `UsageLimits` discard the answer that reaches a limit, even a valid plan.
- Its retrying transport sees the status, not an exhausted quota. It does not repeat a truncated
  body.
"""

from __future__ import annotations

import asyncio
import hashlib
import io
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

from palpate.common.errors import PalpateError, Unavailable
from palpate.common.redaction import redact
from palpate.planning.model.conversation import Answer
from palpate.planning.model.provider import (
    NOT_THE_API,
    Endpoint,
    bounded_client,
    cause_of,
    may_pass,
    reason,
    sdk_model,
)
from palpate.planning.model.settings import Budget
from palpate.scene.camera import load_image

if TYPE_CHECKING:
    from pydantic_ai.exceptions import ModelAPIError
    from pydantic_ai.messages import ModelMessage, ModelResponse


BACKOFF = (1.0, 2.0, 4.0, 8.0)
"""s. Waits before each retry, if the provider states none."""
LONGEST_ANSWER = 16_000
"""Tokens. Maximum length of an answer, including reasoning."""
LONGEST_SIDE = 1024
"""px. Maximum side of a sent picture; larger ones are downscaled."""
JPEG_QUALITY = 90


@dataclass(frozen=True, slots=True)
class Picture:
    """Encoded picture: JPEG bytes and size in pixels."""

    data: bytes
    width: int
    height: int
    media_type: str = "image/jpeg"

    def note(self) -> dict[str, Any]:
        """Return size and digest of the picture for the record."""
        return {
            "width": self.width,
            "height": self.height,
            "sha256": hashlib.sha256(self.data).hexdigest(),
        }


def picture(path: Path) -> Picture:
    """Encode a picture file for sending: downscaled and without the file's metadata.

    Raises InputError: not readable as a picture, or too large.
    """
    # Encoding again removes metadata and bounds the size.
    pixels = load_image(path, LONGEST_SIDE)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=JPEG_QUALITY)
    return Picture(buffer.getvalue(), pixels.shape[1], pixels.shape[0])


@dataclass(slots=True)
class ModelSession:
    """Dialogue with a provider: the messages so far and the deadline."""

    endpoint: Endpoint
    system: str
    pictures: Sequence[Picture]
    schema: dict[str, Any] | None
    budget: Budget
    messages: list[ModelMessage] = field(default_factory=list["ModelMessage"], init=False)
    tokens: int = field(default=0, init=False)
    deadline: float = field(default=0.0, init=False)

    def ask(self, message: str) -> Answer:
        """Send the next message and return the answer.

        Raises Unavailable: the provider is unreachable or refuses, or the time is used up.
        """
        started = time.monotonic()
        self.deadline = self.deadline or started + self.budget.seconds  # of the whole dialogue
        try:
            response, requests = asyncio.run(self._exchange(message))
        except ImportError:
            provider = self.endpoint.provider
            raise Unavailable(
                f"the planner '{provider.name}' needs its SDK: "
                f"pip install 'palpate[{provider.extra}]'"
            ) from None
        answer = answer_of(response, time.monotonic() - started, requests)
        self.tokens += answer.input_tokens + answer.output_tokens
        return answer

    async def _exchange(self, message: str) -> tuple[ModelResponse, int]:
        """Return the response to `message`, and the number of requests."""
        from pydantic_ai.exceptions import ModelAPIError
        from pydantic_ai.messages import BinaryContent, ModelRequest, TextPart, UserContent
        from pydantic_ai.messages import UserPromptPart as Prompt

        content: list[UserContent] = [message]
        if not self.messages:  # pictures are sent once
            for each in self.pictures:
                content.append(BinaryContent(each.data, media_type=each.media_type))
        self.messages.append(ModelRequest([Prompt(content)], instructions=self.system or None))
        # Retry after transient errors; `_wait` raises after the last attempt.
        for attempt in range(1, len(BACKOFF) + 2):
            try:
                response = await self._response()
            except ModelAPIError as error:
                await asyncio.sleep(self._wait(error, attempt))
                continue
            # Redact any key in the answer before it is stored or sent again.
            parts = [
                replace(part, content=redact(part.content)) if isinstance(part, TextPart) else part
                for part in response.parts
            ]
            response = replace(response, parts=parts)
            self.messages.append(response)
            return response, attempt
        raise AssertionError("unreachable: _wait raises after the last attempt")

    async def _response(self) -> ModelResponse:
        """Send one request with the messages so far and return the response.

        Raises:
            ModelAPIError: the provider failed or refused.
            Unavailable: the response is not in the form of its API.
        """
        from pydantic_ai.direct import model_request
        from pydantic_ai.exceptions import ModelAPIError
        from pydantic_ai.models import ModelRequestParameters
        from pydantic_ai.output import OutputObjectDefinition

        # Structured output needs the schema; without one the answer is prose.
        parameters = ModelRequestParameters()
        if self.schema is not None:
            wanted = OutputObjectDefinition(json_schema=self.schema, name="plan", strict=True)
            parameters = ModelRequestParameters(output_mode="native", output_object=wanted)
        # Bound the time of the request by the remaining time of the dialogue.
        patience = self.budget.patience(self.deadline - time.monotonic())
        async with bounded_client(patience) as client:
            try:
                return await model_request(
                    sdk_model(self.endpoint, client),
                    self.messages,
                    model_settings={
                        "max_tokens": max(1, min(LONGEST_ANSWER, self.budget.tokens - self.tokens)),
                        "request_timeout": patience,
                        "max_retries": 0,  # `_exchange` retries, within the deadline
                        "cache": True,  # the system prompt is the same for every task
                    },
                    model_request_parameters=parameters,
                )
            except (ModelAPIError, ImportError, PalpateError):
                raise
            except Exception as error:
                # SDKs raise many kinds of exceptions for unparseable answers.
                raise self._failure(cause_of(error) or NOT_THE_API) from None

    def _wait(self, error: ModelAPIError, attempt: int) -> float:
        """Return the seconds until a retry. Raises Unavailable: a retry is useless, or there is no time for it."""
        # Give up after permanent errors and after the last retry.
        problem = reason(error, self.endpoint)
        if not may_pass(error):
            raise self._failure(problem) from None
        if attempt > len(BACKOFF):
            raise self._failure(f"{problem}, {attempt} times") from None
        wait = BACKOFF[attempt - 1]
        # A wait stated by the provider (Retry-After) has priority.
        if error.retry_after is not None:
            wait = max(0.0, error.retry_after)
            problem += f" and asks to wait {wait:.0f} s"
        # A wait beyond the deadline is useless.
        left = self.deadline - time.monotonic()
        if wait < left:
            return wait
        of_budget = f"{max(0.0, left):.0f} s of {self.budget.seconds:.0f} s are left"
        raise self._failure(f"{problem}; {of_budget}") from None

    def _failure(self, reason: str) -> Unavailable:
        return Unavailable(redact(f"{self.endpoint.name}: {reason}"))


def answer_of(response: ModelResponse, seconds: float, requests: int) -> Answer:
    """Return the answer in a provider's response, with its statistics."""
    from pydantic_ai.messages import TextPart, ThinkingPart, ToolCallPart

    # Join the text parts. Without any, a call of a tool or the reasoning may have the plan.
    usage, parts = response.usage, response.parts
    text = "".join(part.content for part in parts if isinstance(part, TextPart))
    if not text.strip():
        calls = [part.args_as_json_str() for part in parts if isinstance(part, ToolCallPart)]
        thoughts = [part.content for part in parts if isinstance(part, ThinkingPart)]
        text = "\n".join(calls or thoughts)
    # A refusal has no text part; its text is in the details.
    refusal = str((response.provider_details or {}).get("refusal", ""))
    try:
        cost = float(response.cost().total_price)  # list prices of the SDK
    except (LookupError, ValueError, AssertionError):
        cost = None
    return Answer(
        text=redact(text or refusal),
        model=redact(response.model_name or ""),
        input_tokens=usage.input_tokens,
        cached_tokens=usage.cache_read_tokens,
        output_tokens=usage.output_tokens,
        cost=cost,
        seconds=seconds,
        requests=requests,
        finish=redact(response.finish_reason or ""),
    )
