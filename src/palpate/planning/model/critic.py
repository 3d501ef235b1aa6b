"""Critic: a second model that reads a plan which passed the check, and may object to it once.

It receives the planner's message and pictures, and the plan. Its objection goes to the planner as one
round of feedback; the planner may change its plan or keep it. If the critic fails, the plan stands.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources

from palpate.errors import Unavailable
from palpate.planning.model.answer import json_objects
from palpate.planning.model.conversation import Conversation, Critique
from palpate.planning.model.prompt.compose import fenced
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.session import Picture, Session
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.planning.plan import Plan, plan_json

LONGEST_OBJECTION = 1000
"""Characters that go to the planner."""


@dataclass(slots=True)
class Critic:
    """Second model with the planner's message and pictures; one call is one question."""

    endpoint: Endpoint
    budget: Budget
    message: str
    pictures: Sequence[Picture]
    conversation: Conversation

    @classmethod
    def of(
        cls,
        settings: ModelSettings,
        planner: Endpoint,
        message: str,
        pictures: Sequence[Picture],
        conversation: Conversation,
    ) -> Critic | None:
        """The critic that the settings name, if any; at the planner's address where both have the same
        provider.

        Raises:
            InputError: no such provider.
            Unavailable: its key is not there.
        """
        if settings.critic is None:
            return None
        shared = settings.critic.partition(":")[0] == planner.provider.name
        endpoint = Endpoint.of(settings.critic, settings.base_url if shared else None)
        return cls(endpoint, settings.budget, message, pictures, conversation)

    def __call__(self, plan: Plan) -> str | None:
        """Ask the critic; return its objection, or None. Its answer is kept in the conversation."""
        asked, spent = self.endpoint.name, self.conversation.rounds
        rest = replace(  # of the dialogue's budget
            self.budget,
            seconds=max(0.1, self.budget.seconds - sum(round.answer.seconds for round in spent)),
            tokens=max(1, self.budget.tokens - self.conversation.tokens),
        )
        folder = resources.files("palpate.planning.model.prompt")
        system = folder.joinpath("critic.md").read_text(encoding="utf-8")
        shown = fenced(json.dumps(plan_json(plan), ensure_ascii=False), "json")
        message = f"{self.message}\n\n# The plan\n{shown}\n\nIs there an objection?"
        session = Session(self.endpoint, system, self.pictures, None, rest)
        try:
            if exhausted := self.budget.exhausted(self.conversation):
                raise Unavailable(exhausted)
            answer = session.ask(message)
        except Unavailable as error:
            self.conversation.critique = Critique(asked, system, message, error=str(error))
            return None
        objection = read_objection(answer.text)
        self.conversation.critique = Critique(asked, system, message, answer, objection)
        return objection or None


def read_objection(text: str) -> str:
    """The last objection in a critic's answer; empty for none, or one in another form."""
    said = ""
    for found in json_objects(text):
        objection = found.get("objection")
        if isinstance(objection, str):
            said = objection
    return " ".join(said.split())[:LONGEST_OBJECTION]
