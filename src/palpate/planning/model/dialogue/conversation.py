"""A dialogue with a model as it is kept: complete without any header or key, so that it can be judged
again without a network."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from palpate.display import json_text
from palpate.errors import InputError
from palpate.files.read import read_text
from palpate.planning.plan import MAX_BYTES

MAX_CONVERSATION = 20 * MAX_BYTES
"""Bytes of one in a file, and of a file that may be one."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to one message.

    Attributes:
        text: the model's words.
        model: the name the provider reports.
        input_tokens, cached_tokens, output_tokens: as the provider counts them.
        cost: US dollars by the list price, None where no price is known.
        seconds: wall time, waits for retries included.
        requests: how many it took.
        finish: why the model stopped, e.g. `stop`, `length`, `content_filter`.
    """

    text: str
    model: str = ""
    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    cost: float | None = None
    seconds: float = 0.0
    requests: int = 1
    finish: str = ""


@dataclass(frozen=True, slots=True)
class Round:
    """Message to the model, its answer, and the outcome.

    Attributes:
        findings: what the check found wrong with it.
        parameters: what its plan promises, `object.quantity` each.
        changed: how its plan differs from the one before, a line each: `-` gone, `+` new.
        objection: what a critic said against it.
    """

    message: str
    answer: Answer
    findings: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    objection: str = ""


@dataclass(frozen=True, slots=True)
class Critique:
    """Remarks of a critic on a plan that passed the check.

    Attributes:
        planner: as asked for.
        system, message: what it was sent.
        answer: what came back; None where nothing did, and `error` says why.
        objection: what it objects to; empty for nothing.
    """

    planner: str
    system: str
    message: str
    answer: Answer | None = None
    objection: str = ""
    error: str = ""


@dataclass(slots=True)
class Conversation:
    """A whole dialogue, as it is kept in the run folder.

    Attributes:
        planner: as asked for, e.g. `openai:gpt-4o`.
        system: the system prompt as sent.
        images: width and height in pixels and SHA-256 of every picture as sent.
        critique: what a second model said of the plan, if one was asked.
    """

    planner: str
    system: str
    images: tuple[dict[str, Any], ...] = ()
    rounds: list[Round] = field(default_factory=list[Round])
    critique: Critique | None = None

    @property
    def answers(self) -> list[Answer]:
        """Everything that was answered, a critic's words too."""
        found = [r.answer for r in self.rounds]
        if self.critique is not None and self.critique.answer is not None:
            found.append(self.critique.answer)
        return found

    @property
    def tokens(self) -> int:
        """Input and output tokens so far."""
        return sum(answer.input_tokens + answer.output_tokens for answer in self.answers)

    @property
    def cost(self) -> float | None:
        """US dollars so far; None when an answer has no known price."""
        total: float = 0
        for answer in self.answers:
            if answer.cost is None:
                return None
            total += answer.cost
        return total

    def summary(self) -> dict[str, Any]:
        """The figures that go into `plan.json`."""
        sent = received = cached = 0
        seconds: float = 0
        for answer in self.answers:
            sent += answer.input_tokens
            cached += answer.cached_tokens
            received += answer.output_tokens
            seconds += answer.seconds
        reported = self.rounds[-1].answer.model if self.rounds else ""
        findings = [list(r.findings) for r in self.rounds]
        cost = self.cost
        critic = {} if self.critique is None else {"critic": self._criticism(self.critique)}
        return {
            "model": {
                "asked": self.planner,
                "reported": reported,
                "rounds": len(self.rounds),
                "valid_first": findings[:1] == [[]],
                "valid_after_feedback": [] in findings,
                "input_tokens": sent,
                "cached_tokens": cached,
                "output_tokens": received,
                "cost_usd": None if cost is None else round(cost, 6),
                "seconds": round(seconds, 3),
                "findings": findings,
                "parameters": [list(r.parameters) for r in self.rounds],
                "changed": [list(r.changed) for r in self.rounds],
                **critic,
            }
        }

    def _criticism(self, critique: Critique) -> dict[str, Any]:
        """Entry of a critic in `plan.json`."""
        reported = "" if critique.answer is None else critique.answer.model
        return {
            "asked": critique.planner,
            "reported": reported,
            "objection": critique.objection or None,
            "heeded": self._heeded(),
            "error": critique.error or None,
        }

    def _heeded(self) -> bool:
        """True if the plan changed after an objection."""
        objected = False
        for one in self.rounds:
            if objected and one.changed:
                return True
            objected = objected or bool(one.objection)
        return False

    def dump(self) -> str:
        """Serialise as JSON text; `load` reads it back."""
        return json_text(asdict(self), indent=2) + "\n"

    @classmethod
    def load(cls, text: str) -> Conversation:
        """A conversation from its JSON text.

        Raises:
            InputError: it is not one.
        """
        if len(text) > MAX_CONVERSATION:
            raise InputError("the conversation is larger than 20 MB")
        try:
            return TypeAdapter(cls).validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"]) or "it"
            raise InputError(
                f"not a recorded conversation: {place}: {first['msg'][:200]}"
            ) from None


def read_conversation(path: Path) -> Conversation:
    """A conversation that was kept.

    Raises:
        InputError: no such file, or not a conversation.
    """
    return Conversation.load(read_text(path, MAX_CONVERSATION, "a conversation"))


def load(path: Path) -> Conversation:
    """Load a conversation as `read_conversation`, to be replayed.

    Raises:
        InputError: not a conversation, or nothing was answered in it.
    """
    kept = read_conversation(path)
    if not kept.rounds:
        raise InputError(f"'{path.name}' holds no answer")
    return kept
