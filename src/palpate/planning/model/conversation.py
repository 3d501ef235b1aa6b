"""Record of a dialogue with a model: complete but for headers and keys, so that it can be replayed without a
network."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from palpate.common.display import json_text
from palpate.common.errors import InputError
from palpate.common.files import read_text
from palpate.planning.plan import MAX_BYTES

MAX_CONVERSATION = 20 * MAX_BYTES
"""Bytes of a file that may be a conversation."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to one message.

    Attributes:
        text: the model's words.
        model: the name that the provider reports.
        input_tokens, cached_tokens, output_tokens: as the provider counts them.
        cost: US dollars by the list price, None where no price is known.
        seconds: wall time, waits for retries included.
        requests: number of requests, retries included.
        finish: the provider's reason for the end, e.g. `stop`, `length`, `content_filter`.
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
        findings: findings of the check on the answer.
        parameters: promised parameters of its plan, `object.quantity` each.
        changed: differences from the plan before, a line each: `-` removed, `+` new.
        objection: objection of a critic to the plan.
        question: question about the plan, which passed the check.
    """

    message: str
    answer: Answer
    findings: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    objection: str = ""
    question: str = ""


@dataclass(frozen=True, slots=True)
class Critique:
    """Remarks of a critic on a plan that passed the check.

    Attributes:
        planner: the critic's `PROVIDER:MODEL`, as configured.
        system, message: the prompt and the message that it was sent.
        answer: its answer; None with a reason in `error`.
        objection: its objection; empty for none.
    """

    planner: str
    system: str
    message: str
    answer: Answer | None = None
    objection: str = ""
    error: str = ""


@dataclass(slots=True)
class Conversation:
    """Whole dialogue, as it is kept in the run folder.

    Attributes:
        planner: `PROVIDER:MODEL`, as configured, e.g. `openai:gpt-4o`.
        system: the system prompt as sent.
        images: width and height in pixels and SHA-256 of every picture as sent.
        critique: remarks of a second model on the plan, if one was asked.
    """

    planner: str
    system: str
    images: tuple[dict[str, Any], ...] = ()
    rounds: list[Round] = field(default_factory=list[Round])
    critique: Critique | None = None

    @property
    def answers(self) -> list[Answer]:
        """All answers, those of a critic included."""
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
        # One unknown price makes the sum unknown.
        costs = [answer.cost for answer in self.answers if answer.cost is not None]
        return sum(costs) if len(costs) == len(self.answers) else None

    def summary(self) -> dict[str, Any]:
        """Figures for `plan.json`."""
        answers, rounds, cost = self.answers, self.rounds, self.cost
        findings = [list(r.findings) for r in rounds]
        # An answer that a question changed was not right at first; one that stayed was.
        questioned = next((i for i, r in enumerate(rounds, start=1) if r.question), len(rounds))
        revised = any(r.changed for r in rounds[questioned : questioned + 1])
        figures: dict[str, Any] = {
            "asked": self.planner,
            "reported": rounds[-1].answer.model if rounds else "",
            "rounds": len(rounds),
            "valid_first": findings[:1] == [[]] and not revised,
            "valid_after_feedback": [] in findings,
            "input_tokens": sum(answer.input_tokens for answer in answers),
            "cached_tokens": sum(answer.cached_tokens for answer in answers),
            "output_tokens": sum(answer.output_tokens for answer in answers),
            "cost_usd": None if cost is None else round(cost, 6),
            "seconds": round(sum(answer.seconds for answer in answers), 3),
            "findings": findings,
            "parameters": [list(r.parameters) for r in rounds],
            "changed": [list(r.changed) for r in rounds],
            "questions": [r.question for r in rounds if r.question],
        }
        if self.critique is not None:
            # Heeded: the plan changed in a round after the objection.
            objected = next((i for i, r in enumerate(rounds, start=1) if r.objection), len(rounds))
            figures["critic"] = {
                "asked": self.critique.planner,
                "reported": self.critique.answer.model if self.critique.answer else "",
                "objection": self.critique.objection or None,
                "heeded": any(r.changed for r in rounds[objected:]),
                "error": self.critique.error or None,
            }
        return {"model": figures}

    def dump(self) -> str:
        """JSON text, which `load` reads back."""
        return json_text(asdict(self), indent=2) + "\n"

    @classmethod
    def load(cls, text: str) -> Conversation:
        """A conversation from its JSON text.

        Raises:
            InputError: it is not one.
        """
        try:
            return TypeAdapter(cls).validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"]) or "it"
            raise InputError(
                f"not a recorded conversation: {place}: {first['msg'][:200]}"
            ) from None


def read_conversation(path: Path) -> Conversation:
    """A conversation from its file.

    Raises:
        InputError: no such file, or not a conversation.
    """
    return Conversation.load(read_text(path, MAX_CONVERSATION, "a conversation"))
