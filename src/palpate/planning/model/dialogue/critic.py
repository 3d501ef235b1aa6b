"""A second model that reads a plan which passed the check, and may object to it once.

It sees what the planner saw, and the plan. What it says goes to the planner as one round of feedback;
the planner may heed it or stay with its plan. A critic that fails costs nothing but its opinion.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources

from palpate.errors import Unavailable
from palpate.planning.model.answer import json_objects
from palpate.planning.model.dialogue.conversation import Conversation, Critique
from palpate.planning.model.picture import Picture
from palpate.planning.model.prompt.compose import fenced
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.session import Session
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.planning.plan import Plan, plan_json

LONGEST_OBJECTION = 1000
"""Characters that go to the planner."""


@dataclass(slots=True)
class Critic:
    """Critic: a second model with the planner's prompt; one call is one question."""

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
        """The critic that the settings name, if any. The planner's address is its own, too, where both
        have one provider.

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
        """Ask the critic; return its objection, or None. The conversation keeps its answer."""
        asked = self.endpoint.name
        folder = resources.files("palpate.planning.model.prompt")
        system = folder.joinpath("critic.md").read_text(encoding="utf-8")
        shown = fenced(json.dumps(plan_json(plan), ensure_ascii=False), "json")
        message = f"{self.message}\n\n# The plan\n{shown}\n\nIs there an objection?"
        session = Session(self.endpoint, system, self.pictures, None, self._left())
        try:
            if spent := self.budget.exhausted(self.conversation):
                raise Unavailable(spent)
            answer = session.ask(message)
        except Unavailable as error:
            self.conversation.critique = Critique(asked, system, message, error=str(error))
            return None
        objection = read_objection(answer.text)
        self.conversation.critique = Critique(asked, system, message, answer, objection)
        return objection or None

    def _left(self) -> Budget:
        """Rest of the dialogue's budget."""
        spent = sum(round.answer.seconds for round in self.conversation.rounds)
        return replace(
            self.budget,
            seconds=max(0.1, self.budget.seconds - spent),
            tokens=max(1, self.budget.tokens - self.conversation.tokens),
        )


def read_objection(text: str) -> str:
    """Parse the objection of a critic's answer; empty for none, or in another form."""
    said = ""
    for found in json_objects(text):
        objection = found.get("objection")
        if isinstance(objection, str):
            said = objection
    return " ".join(said.split())[:LONGEST_OBJECTION]
