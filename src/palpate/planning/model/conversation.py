"""Record of a dialogue with a model, for a replay without network.

It is complete except for headers and keys.
"""

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
"""bytes. Maximum size of a conversation file."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to one message.

    Attributes:
        text: the model's text.
        model: model name as reported by the provider.
        input_tokens, cached_tokens, output_tokens: as counted by the provider.
        cost: US dollars by list price; None without a known price.
        seconds: wall time, including waits before retries.
        requests: number of requests, including retries.
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
        message: the message.
        answer: the answer.
        findings: findings of the check on the answer.
        parameters: parameters of its plan, `object.quantity` each.
        changed: differences from the previous plan, one per line: `-` removed, `+` new.
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
        system: the system prompt of the critic.
        message: the message to the critic.
        answer: its answer; None with a reason in `error`.
        objection: its objection; empty without one.
        error: reason why there is no answer.
    """

    planner: str
    system: str
    message: str
    answer: Answer | None = None
    objection: str = ""
    error: str = ""


@dataclass(slots=True)
class Conversation:
    """Complete dialogue, as stored in the run folder.

    Attributes:
        planner: `PROVIDER:MODEL`, as configured, e.g. `openai:gpt-4o`.
        system: the system prompt as sent.
        images: width and height in pixels and SHA-256 of every picture as sent.
        rounds: messages and answers in order.
        critique: remarks of a second model on the plan, if configured.
    """

    planner: str
    system: str
    images: tuple[dict[str, Any], ...] = ()
    rounds: list[Round] = field(default_factory=list[Round])
    critique: Critique | None = None

    @property
    def answers(self) -> list[Answer]:
        """All answers, including that of a critic."""
        # The critic's answer counts towards cost and tokens.
        answers = [r.answer for r in self.rounds]
        if self.critique is not None and self.critique.answer is not None:
            answers.append(self.critique.answer)
        return answers

    @property
    def tokens(self) -> int:
        """Input and output tokens so far."""
        return sum(answer.input_tokens + answer.output_tokens for answer in self.answers)

    @property
    def cost(self) -> float | None:
        """US dollars so far; None if an answer has no known price."""
        # One unknown price makes the sum unknown.
        costs = [answer.cost for answer in self.answers if answer.cost is not None]
        return sum(costs) if len(costs) == len(self.answers) else None

    def summary(self) -> dict[str, Any]:
        """Return the statistics for `plan.json`."""
        answers, rounds, cost = self.answers, self.rounds, self.cost
        # Statistics per round.
        findings = [list(r.findings) for r in rounds]
        # An answer counts as right at first only if a later question did not change the plan.
        questioned = next((i for i, r in enumerate(rounds, start=1) if r.question), len(rounds))
        revised = any(r.changed for r in rounds[questioned : questioned + 1])
        # Totals over all rounds; the critic has separate fields below.
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
        """Return JSON text that `load` reads."""
        return json_text(asdict(self), indent=2) + "\n"

    @classmethod
    def load(cls, text: str) -> Conversation:
        """Read a conversation from its JSON text. Raises InputError: the text is no conversation."""
        try:
            return TypeAdapter(cls).validate_json(text)
        except ValidationError as error:
            # Report the first error alone, with its path.
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"]) or "it"
            raise InputError(
                f"not a recorded conversation: {place}: {first['msg'][:200]}"
            ) from None


def read_conversation(path: Path) -> Conversation:
    """Read a conversation from its file. Raises InputError: no such file, or not a conversation."""
    return Conversation.load(read_text(path, MAX_CONVERSATION, "a conversation"))
