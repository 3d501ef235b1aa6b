"""Rounds of a dialogue with a model, and a critic with one objection."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from difflib import unified_diff

from palpate.common.errors import InputError, Unavailable
from palpate.common.parameter import PlanRejected
from palpate.planning.model.answer import json_objects
from palpate.planning.model.conversation import Answer, Conversation, Critique, Round
from palpate.planning.model.prompt import fence, fill_module
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.session import ModelSession
from palpate.planning.model.settings import FEEDBACK_ROUNDS, ModelSettings
from palpate.planning.plan import Plan, plan_json
from palpate.primitives.registry import vocabulary

LONGEST_OBJECTION = 1000
"""Characters. Maximum length of an objection to the planner."""


def critic_endpoint(settings: ModelSettings, planner: Endpoint) -> Endpoint | None:
    """Return the critic's endpoint, if configured; at the planner's address for the same provider.

    Raises:
        InputError: no such provider.
        Unavailable: its key is not set.
    """
    if settings.critic is None:
        return None
    shared = settings.critic.partition(":")[0] == planner.provider.name
    return Endpoint.of(settings.critic, settings.base_url if shared else None)


def objection_to(
    plan: Plan, critic: Endpoint, task: str, planner: ModelSession, conversation: Conversation
) -> str | None:
    """Ask the critic about a plan; return its objection, or None.

    The conversation stores its answer.

    Args:
        plan: the plan of the planner.
        critic: the critic, within the remaining budget of the dialogue.
        task: R, D, robot and poses, as sent to the planner.
        planner: the dialogue with the planner.
        conversation: its record.
    """
    # Remaining time and tokens of the dialogue.
    budget = planner.budget
    spent = sum(round.answer.seconds for round in conversation.rounds)
    rest = replace(
        budget,
        seconds=max(0.1, budget.seconds - spent),
        tokens=max(1, budget.tokens - conversation.tokens),
    )
    # The critic receives the same task and pictures as the planner, and the plan.
    system = fill_module("critic.md", vocabulary(), "full")
    shown = fence(json.dumps(plan_json(plan), ensure_ascii=False), "json")
    message = f"{task}\n\n# The plan\n{shown}\n\nIs there an objection?"
    # A failed critic leaves the plan unchanged.
    try:
        if exhausted := budget.exhaustion_reason(conversation):
            raise Unavailable(exhausted)
        answer = ModelSession(critic, system, planner.pictures, None, rest).ask(message)
    except Unavailable as error:
        conversation.critique = Critique(critic.name, system, message, error=str(error))
        return None
    objection = read_objection(answer.text)
    conversation.critique = Critique(critic.name, system, message, answer, objection)
    return objection or None


def read_objection(text: str) -> str:
    """Return the last objection in a critic's answer; empty without one."""
    sentence = ""
    for candidate in json_objects(text):
        objection = candidate.get("objection")
        if isinstance(objection, str):
            sentence = objection
    return " ".join(sentence.split())[:LONGEST_OBJECTION]


# Rounds of a dialogue: ask, check, and return the findings, a bounded number of times.


MAX_FINDINGS = 20
MAX_FINDING = 500
"""Maximum number of findings in a message, and of characters in each."""
MAX_CHANGES = 40
"""Maximum number of lines in the difference of two plans."""
MAX_COMPARED = 500
"""Maximum number of compared nodes of a plan."""

Ask = Callable[[str], Answer]
"""Sends the next user message of a dialogue and returns the answer."""

Judge = Callable[[str], tuple[Plan | None, Sequence[str]]]
"""Reads an answer: its plan, if any, and the findings on it."""

Object = Callable[[Plan], str | None]
"""Question about a plan that passed the check, or a critic's objection to it; None without any."""

MayContinue = Callable[[Conversation], str | None]
"""Reason against another round, such as an exhausted budget, or None."""


def converse(
    conversation: Conversation,
    message: str,
    ask: Ask,
    judge: Judge,
    rounds: int = FEEDBACK_ROUNDS,
    may_go_on: MayContinue = lambda _: None,
    critic: Object = lambda _: None,
    question: Object = lambda _: None,
) -> Plan:
    """Return the first plan without findings; appends every round to `conversation`.

    The objection of a `critic`, else a `question`, goes to the model once. The plan stays valid if
    no other plan passes after that.

    Raises:
        PlanRejected: no valid plan after `rounds` rounds of feedback, or the budget is exhausted.
        Unavailable: as in `ask`.
    """

    def once(message: str, before: Plan | None) -> tuple[Plan | None, Sequence[str]]:
        """Execute one round; return the plan, if any, and the findings on it."""
        # Ask, check, and record the round with its difference from the previous plan.
        answer = ask(message)
        plan, findings = judge(answer.text)
        kept = tuple(finding[:MAX_FINDING] for finding in findings)
        promised = tuple(str(parameter) for parameter in plan.parameters) if plan else ()
        changed = differences(before, plan) if before and plan else ()
        conversation.rounds.append(Round(message, answer, kept, promised, changed))
        return plan, findings

    # Return the findings to the model until a plan passes or the rounds are exhausted.
    plan, findings = once(message, None)
    left = rounds
    while plan is None or findings:
        # The budget and the number of rounds both end the dialogue.
        reason = may_go_on(conversation)
        if left == 0:
            reason = f"{rounds} round(s) of feedback were not enough"
        if reason:
            raise PlanRejected(rejection(conversation, reason))
        left -= 1
        plan, findings = once(feedback(findings), plan)

    def reconsider(plan: Plan, message: str) -> Plan:
        """Return the next valid plan after a message, else the current `plan`."""
        current: Plan | None = plan
        for _ in range(left + 1):
            if may_go_on(conversation):
                break
            try:
                current, findings = once(message, current)
            except Unavailable:
                break
            if current is not None and not findings:
                return current
            message = feedback(findings)
        return plan

    # One objection or question about the valid plan.
    objection = critic(plan)
    if objection is not None:
        conversation.rounds[-1] = replace(conversation.rounds[-1], objection=objection)
        # An objection excludes a question, because it may have demanded the questioned part.
        return reconsider(plan, objection_message(objection))
    asked = question(plan)
    if asked is not None:
        conversation.rounds[-1] = replace(conversation.rounds[-1], question=asked)
        return reconsider(plan, question_message(asked))
    return plan


def differences(before: Plan, after: Plan) -> tuple[str, ...]:
    """Return the differences between two plans, one per line, at most `MAX_CHANGES`."""
    # Compare parameters and nodes, one per line.
    texts: list[list[str]] = []
    for plan in (before, after):
        promised = [str(parameter) for parameter in plan.parameters]
        tree = str(plan.tree or plan.outcome).splitlines()  # one node per line
        texts.append([*promised, *tree[:MAX_COMPARED]])
    old, new = texts
    # Without context lines, the difference contains changes alone.
    compared = unified_diff(old, new, n=0, lineterm="")
    lines = [
        f"{line[0]} {line[1:].strip()}"
        for line in compared
        if line[:1] in ("-", "+") and line not in ("--- ", "+++ ")  # header of the diff
    ]
    if len(lines) > MAX_CHANGES:
        lines[MAX_CHANGES:] = [f"and {len(lines) - MAX_CHANGES} more"]
    return tuple(lines)


def objection_message(objection: str) -> str:
    """Message with a critic's objection to the model."""
    return (
        "The plan passes the check. A second reader, who sees what you see, objects:\n"
        f"- {objection}\n\n"
        "If the reader is right, correct the plan; if not, return it as it is. Return the whole JSON "
        "object again."
    )


def question_message(question: str) -> str:
    """Message with a question about the plan to the model."""
    return (
        "The answer passes the check. One question, asked once, to which either answer may be right:\n"
        f"- {question}\n\n"
        "Return the whole JSON object again, changed or as it is."
    )


def feedback(findings: Sequence[str]) -> str:
    """Message with the findings to the model."""
    lines = ["The check refused the plan:"]
    for finding in findings[:MAX_FINDINGS]:
        lines.append(f"- {finding[:MAX_FINDING]}")
    if len(findings) > MAX_FINDINGS:
        lines.append(f"- and {len(findings) - MAX_FINDINGS} more")
    lines += ["", "Correct it and return the whole JSON object again."]
    return "\n".join(lines)


def replay_conversation(kept: Conversation, again: Conversation, judge: Judge) -> Plan:
    """Check the answers of a recorded conversation again, without network.

    Appends every round to `again`.

    Raises:
        PlanRejected: its answers do not pass.
        InputError: it ends after an objection whose answers do not pass.
    """

    def ask(message: str) -> Answer:
        # The recorded answers were not enough in this scene.
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


def rejection(conversation: Conversation, reason: str) -> str:
    """Reason why a dialogue ended without a plan, with the last findings and text."""
    last = conversation.rounds[-1]
    # Quote the last findings and the beginning of the last answer.
    words = " ".join(last.answer.text.split())[:200]
    findings = "; ".join(last.findings[:3]) or "no plan"
    return (
        f"{conversation.planner} gave no valid plan in {len(conversation.rounds)} answer(s) ({reason}). "
        f"Last: {findings}. It said: {words or 'nothing'}"
    )
