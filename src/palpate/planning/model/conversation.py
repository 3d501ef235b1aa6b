"""The dialogue with a model: ask, check, feed the findings back, a bounded number of times.

Nothing here knows a provider: whoever answers is a function. The same loop therefore runs on a live
model and on a recorded conversation, and the record is complete without any header or key.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from palpate.errors import InputError, PlanRejected
from palpate.files.read import read_text
from palpate.planning.plan import MAX_BYTES, Plan

FEEDBACK_ROUNDS = 3
"""How often findings go back to the model."""
MAX_CONVERSATION = 20 * MAX_BYTES
"""Bytes of one in a file, and of a file that may be one."""
MAX_FINDINGS = 20
MAX_FINDING = 500
"""Findings in one message, and characters of each."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What came back for one message.

    Attributes:
        text: the model's words. model: the name the provider reports.
        input_tokens, cached_tokens, output_tokens: as the provider counts them.
        cost: US dollars by the list price, None where no price is known.
        seconds: wall time, waits for retries included. requests: how many it took.
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
    """One message to the model, its answer, and what the check found wrong with it."""

    message: str
    answer: Answer
    findings: tuple[str, ...] = ()


@dataclass(slots=True)
class Conversation:
    """A whole dialogue, as it is kept in the run folder.

    Attributes:
        planner: as asked for, e.g. `openai:gpt-4o`. system: the system prompt as sent.
        images: width and height in pixels and SHA-256 of every picture as sent.
    """

    planner: str
    system: str
    images: tuple[dict[str, Any], ...] = ()
    rounds: list[Round] = field(default_factory=list[Round])

    @property
    def tokens(self) -> int:
        """Input and output tokens so far."""
        return sum(r.answer.input_tokens + r.answer.output_tokens for r in self.rounds)

    @property
    def cost(self) -> float | None:
        """US dollars so far; None when an answer has no known price."""
        total: float = 0
        for r in self.rounds:
            if r.answer.cost is None:
                return None
            total += r.answer.cost
        return total

    def summary(self) -> dict[str, Any]:
        """The figures that go into `plan.json`."""
        sent = received = cached = 0
        seconds: float = 0
        reported = ""
        findings: list[list[str]] = []
        for r in self.rounds:
            sent += r.answer.input_tokens
            cached += r.answer.cached_tokens
            received += r.answer.output_tokens
            seconds += r.answer.seconds
            reported = r.answer.model
            findings.append(list(r.findings))
        cost = self.cost
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
            }
        }

    def dump(self) -> str:
        """As JSON text; `load` reads it back."""
        return json.dumps(asdict(self), indent=2, ensure_ascii=False) + "\n"

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


Ask = Callable[[str], Answer]
"""Sends the next user message of a dialogue and returns the answer."""

Judge = Callable[[str], tuple[Plan | None, Sequence[str]]]
"""Reads an answer: the plan in it, if any, and what is wrong with it."""

MayGoOn = Callable[[Conversation], str | None]
"""Asked before another round: the reason why there is no budget left, or None."""


def converse(
    conversation: Conversation,
    message: str,
    ask: Ask,
    judge: Judge,
    rounds: int = FEEDBACK_ROUNDS,
    may_go_on: MayGoOn = lambda _: None,
) -> Plan:
    """The first plan that nothing is wrong with; every round is appended to `conversation`.

    Raises:
        PlanRejected: none after `rounds` rounds of feedback, or the budget is used up. Whatever
            `ask` raises.
    """
    for _ in range(rounds + 1):
        answer = ask(message)
        plan, findings = judge(answer.text)
        kept = tuple(finding[:MAX_FINDING] for finding in findings)
        conversation.rounds.append(Round(message, answer, kept))
        if plan is not None and not findings:
            return plan
        message = feedback(findings)
        if stop := may_go_on(conversation):
            raise PlanRejected(_rejection(conversation, stop))
    raise PlanRejected(_rejection(conversation, f"{rounds} round(s) of feedback were not enough"))


def feedback(findings: Sequence[str]) -> str:
    """The findings as the next message to the model."""
    lines = ["The check refused the plan:"]
    for finding in findings[:MAX_FINDINGS]:
        lines.append(f"- {finding[:MAX_FINDING]}")
    if len(findings) > MAX_FINDINGS:
        lines.append(f"- and {len(findings) - MAX_FINDINGS} more")
    lines += ["", "Correct it and return the whole JSON object again."]
    return "\n".join(lines)


def recorded(conversation: Conversation) -> Ask:
    """Answers in the order in which they were given.

    The returned function raises `InputError` when asked for more than were recorded.
    """
    answers = iter([r.answer for r in conversation.rounds])

    def ask(message: str) -> Answer:
        answer = next(answers, None)
        if answer is None:
            raise InputError(
                "the recorded conversation ends before a valid plan: its answers do not pass the check "
                "in this scene; record it again"
            )
        return answer

    return ask


def read_conversation(path: Path) -> Conversation:
    """A conversation that was kept.

    Raises:
        InputError: no such file, or not a conversation.
    """
    return Conversation.load(read_text(path, MAX_CONVERSATION, "a conversation"))


def load(path: Path) -> Conversation:
    """As `read_conversation`, to be replayed.

    Raises:
        InputError: not a conversation, or nothing was answered in it.
    """
    kept = read_conversation(path)
    if not kept.rounds:
        raise InputError(f"'{path.name}' holds no answer")
    return kept


def replayed(kept: Conversation, again: Conversation, judge: Judge) -> Plan:
    """The plan of a recorded conversation, judged anew, without network; every round is appended to
    `again`.

    Raises:
        PlanRejected: its answers do not pass.
    """
    return converse(
        again, kept.rounds[0].message, recorded(kept), judge, rounds=len(kept.rounds) - 1
    )


def _rejection(conversation: Conversation, why: str) -> str:
    last = conversation.rounds[-1]
    words = " ".join(last.answer.text.split())[:200]
    findings = "; ".join(last.findings[:3]) or "no plan"
    return (
        f"{conversation.planner} gave no valid plan in {len(conversation.rounds)} answer(s) ({why}). "
        f"Last: {findings}. It said: {words or 'nothing'}"
    )
