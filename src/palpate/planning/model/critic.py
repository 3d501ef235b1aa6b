"""Critic: a second model that reads a plan which passed the check, and may object to it once.

It receives the planner's task and pictures, and the plan; its own prompt names quantities and purposes. Its
objection goes to the planner as one round of feedback; the planner may change its plan or keep it. If
the critic fails, the plan stands.
"""

from __future__ import annotations

import json
from dataclasses import replace

from palpate.errors import Unavailable
from palpate.planning.model.answer import json_objects
from palpate.planning.model.conversation import Conversation, Critique
from palpate.planning.model.prompt.compose import fenced, filled_module
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.session import Session
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan, plan_json
from palpate.vocabulary.registry import vocabulary

LONGEST_OBJECTION = 1000
"""Characters that go to the planner."""


def critic_endpoint(settings: ModelSettings, planner: Endpoint) -> Endpoint | None:
    """The critic that the settings name, if any; at the planner's address where both have the same
    provider.

    Raises:
        InputError: no such provider.
        Unavailable: its key is not set.
    """
    if settings.critic is None:
        return None
    shared = settings.critic.partition(":")[0] == planner.provider.name
    return Endpoint.of(settings.critic, settings.base_url if shared else None)


def objection_to(
    plan: Plan, critic: Endpoint, task: str, planner: Session, conversation: Conversation
) -> str | None:
    """Ask the critic about a plan; return its objection, or None. The conversation keeps its answer.

    Args:
        plan: the plan of the planner.
        critic: the model that is asked, within the rest of the dialogue's budget.
        task: R, D, robot and poses, as the planner received them.
        planner, conversation: the dialogue with the planner, and its record.
    """
    budget = planner.budget
    spent = sum(round.answer.seconds for round in conversation.rounds)
    rest = replace(
        budget,
        seconds=max(0.1, budget.seconds - spent),
        tokens=max(1, budget.tokens - conversation.tokens),
    )
    system = filled_module("critic.md", vocabulary(), "full")
    shown = fenced(json.dumps(plan_json(plan), ensure_ascii=False), "json")
    message = f"{task}\n\n# The plan\n{shown}\n\nIs there an objection?"
    # A critic that fails leaves the plan as it is.
    try:
        if exhausted := budget.exhausted(conversation):
            raise Unavailable(exhausted)
        answer = Session(critic, system, planner.pictures, None, rest).ask(message)
    except Unavailable as error:
        conversation.critique = Critique(critic.name, system, message, error=str(error))
        return None
    objection = read_objection(answer.text)
    conversation.critique = Critique(critic.name, system, message, answer, objection)
    return objection or None


def read_objection(text: str) -> str:
    """The last objection in a critic's answer; empty for none, or one in another form."""
    said = ""
    for found in json_objects(text):
        objection = found.get("objection")
        if isinstance(objection, str):
            said = objection
    return " ".join(said.split())[:LONGEST_OBJECTION]
