"""Rounds of a dialogue with a model: ask, check, feed the findings back, a bounded number of times.

The model is a function of a message, so the same loop runs on a provider and on a recorded conversation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from difflib import unified_diff

from palpate.errors import InputError, PlanRejected, Unavailable
from palpate.planning.model.conversation import Answer, Conversation, Round
from palpate.planning.model.settings import FEEDBACK_ROUNDS
from palpate.planning.plan import Plan

MAX_FINDINGS = 20
MAX_FINDING = 500
"""Findings in one message, and characters of each."""
MAX_CHANGES = 40
"""Lines that list the differences of a plan from the one before."""
MAX_COMPARED = 500
"""Nodes of a plan that are compared."""

Ask = Callable[[str], Answer]
"""Sends the next user message of a dialogue and returns the answer."""

Judge = Callable[[str], tuple[Plan | None, Sequence[str]]]
"""Reads an answer: its plan, if any, and the findings on it."""

Object = Callable[[Plan], str | None]
"""Question about a plan that passed the check, or a critic's objection to it; None for none."""

MayGoOn = Callable[[Conversation], str | None]
"""Reason against another round, such as a used-up budget, or None."""


def converse(
    conversation: Conversation,
    message: str,
    ask: Ask,
    judge: Judge,
    rounds: int = FEEDBACK_ROUNDS,
    may_go_on: MayGoOn = lambda _: None,
    critic: Object = lambda _: None,
    question: Object = lambda _: None,
) -> Plan:
    """The first plan without findings; every round is appended to `conversation`.

    The objection of a `critic`, or else a `question` about it, goes to the model once. The plan stands if
    no other passes after that.

    Raises:
        PlanRejected: none after `rounds` rounds of feedback, or the budget is used up.
        Unavailable: as `ask`.
    """

    def once(message: str, before: Plan | None) -> tuple[Plan | None, Sequence[str]]:
        """Do a round; return the plan, if any, and the findings on it."""
        answer = ask(message)
        plan, findings = judge(answer.text)
        kept = tuple(finding[:MAX_FINDING] for finding in findings)
        promised = tuple(str(parameter) for parameter in plan.parameters) if plan else ()
        changed = differences(before, plan) if before and plan else ()
        conversation.rounds.append(Round(message, answer, kept, promised, changed))
        return plan, findings

    plan, findings = once(message, None)
    left = rounds
    while plan is None or findings:
        why = may_go_on(conversation)
        if left == 0:
            why = f"{rounds} round(s) of feedback were not enough"
        if why:
            raise PlanRejected(rejection(conversation, why))
        left -= 1
        plan, findings = once(feedback(findings), plan)

    def reconsidered(plan: Plan, message: str) -> Plan:
        """The next plan that passes after a message; whatever ends the reconsideration, `plan`
        stands."""
        latest: Plan | None = plan
        for _ in range(left + 1):
            if may_go_on(conversation):
                break
            try:
                latest, findings = once(message, latest)
            except Unavailable:
                break
            if latest is not None and not findings:
                return latest
            message = feedback(findings)
        return plan

    objection = critic(plan)
    if objection is not None:
        conversation.rounds[-1] = replace(conversation.rounds[-1], objection=objection)
        # No question after an objection, which may have demanded what would be questioned.
        return reconsidered(plan, objected(objection))
    asked = question(plan)
    if asked is not None:
        conversation.rounds[-1] = replace(conversation.rounds[-1], question=asked)
        return reconsidered(plan, questioned(asked))
    return plan


def differences(before: Plan, after: Plan) -> tuple[str, ...]:
    """Differences between two plans, a line each, at most `MAX_CHANGES`."""
    texts: list[list[str]] = []
    for plan in (before, after):
        promised = [str(parameter) for parameter in plan.parameters]
        tree = str(plan.tree or plan.outcome).splitlines()  # a node per line
        texts.append([*promised, *tree[:MAX_COMPARED]])
    old, new = texts
    compared = unified_diff(old, new, n=0, lineterm="")
    lines = [
        f"{line[0]} {line[1:].strip()}"
        for line in compared
        if line[:1] in ("-", "+") and line not in ("--- ", "+++ ")  # these head the diff
    ]
    if len(lines) > MAX_CHANGES:
        lines[MAX_CHANGES:] = [f"and {len(lines) - MAX_CHANGES} more"]
    return tuple(lines)


def objected(objection: str) -> str:
    """A critic's objection as the next message to the model."""
    return (
        "The plan passes the check. A second reader, who sees what you see, objects:\n"
        f"- {objection}\n\n"
        "If the reader is right, correct the plan; if not, return it as it is. Return the whole JSON "
        "object again."
    )


def questioned(question: str) -> str:
    """A question about a plan as the next message to the model."""
    return (
        "The answer passes the check. One question, asked once, to which either answer may be right:\n"
        f"- {question}\n\n"
        "Return the whole JSON object again, changed or as it is."
    )


def feedback(findings: Sequence[str]) -> str:
    """The findings as the next message to the model."""
    lines = ["The check refused the plan:"]
    for finding in findings[:MAX_FINDINGS]:
        lines.append(f"- {finding[:MAX_FINDING]}")
    if len(findings) > MAX_FINDINGS:
        lines.append(f"- and {len(findings) - MAX_FINDINGS} more")
    lines += ["", "Correct it and return the whole JSON object again."]
    return "\n".join(lines)


def replayed(kept: Conversation, again: Conversation, judge: Judge) -> Plan:
    """The plan of a recorded conversation, checked again without network; every round is appended to
    `again`.

    Raises:
        PlanRejected: its answers do not pass.
        InputError: it ends after an objection whose answers do not pass.
    """

    def ask(message: str) -> Answer:
        if len(again.rounds) == len(kept.rounds):
            raise InputError(
                "the recorded conversation ends before a valid plan: its answers do not pass the check "
                "in this scene; record it again"
            )
        return kept.rounds[len(again.rounds)].answer

    def objection(plan: Plan) -> str | None:
        return kept.rounds[len(again.rounds) - 1].objection or None

    def question(plan: Plan) -> str | None:
        return kept.rounds[len(again.rounds) - 1].question or None

    left = len(kept.rounds) - 1
    message = kept.rounds[0].message
    return converse(again, message, ask, judge, left, critic=objection, question=question)


def rejection(conversation: Conversation, why: str) -> str:
    """Reason why a dialogue ended without a plan, with the last findings and words."""
    last = conversation.rounds[-1]
    words = " ".join(last.answer.text.split())[:200]
    findings = "; ".join(last.findings[:3]) or "no plan"
    return (
        f"{conversation.planner} gave no valid plan in {len(conversation.rounds)} answer(s) ({why}). "
        f"Last: {findings}. It said: {words or 'nothing'}"
    )
