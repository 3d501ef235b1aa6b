"""Settings and budget of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from palpate.planning.model.dialogue.conversation import Conversation
from palpate.planning.model.dialogue.rounds import FEEDBACK_ROUNDS

if TYPE_CHECKING:
    from palpate.planning.model.prompt.compose import Style


@dataclass(frozen=True, slots=True)
class Budget:
    """Budget of one plan.

    Attributes:
        seconds: wall time of the whole dialogue.
        attempt_seconds: of one request; None for all that is left. A model on one's own computer may
            think for minutes.
        tokens: input and output together.
        dollars: by list prices, where the model has one.
    """

    seconds: float = 300.0
    attempt_seconds: float | None = None
    tokens: int = 200_000
    dollars: float = 2.0

    def patience(self, left: float) -> float:
        """Seconds that one request may take when `left` are left of all."""
        patience = left if self.attempt_seconds is None else min(left, self.attempt_seconds)
        return max(0.1, patience)

    def exhausted(self, conversation: Conversation) -> str | None:
        """Reason why no further message may be sent, or None."""
        if conversation.tokens >= self.tokens:
            return f"the budget of {self.tokens} tokens is used up"
        if (conversation.cost or 0.0) >= self.dollars:
            return f"the budget of ${self.dollars:g} is used up"
        return None


@dataclass(frozen=True, slots=True)
class ModelSettings:
    """Settings of a model as planner.

    Attributes:
        base_url: where an OpenAI-compatible server, or a proxy, listens; the provider's own if
            None.
        native: ask for the provider's structured output, in the flat form, instead of JSON in
            prose.
        without: prompt modules and inputs to leave out (ablation).
        prompt: which system prompt: `full` tells how things are measured, `lean` only what there is.
        comments: whether comments in the scene's file are sent. Studies leave them out, as what
            somebody wrote beside a body ("was never weighed") gives the answer away.
        rounds: how often findings are fed back.
        critic: `PROVIDER:MODEL` of a second model that may object to the plan once.
    """

    base_url: str | None = None
    native: bool = False
    without: frozenset[str] = frozenset()
    prompt: Style = "full"
    comments: bool = True
    rounds: int = FEEDBACK_ROUNDS
    critic: str | None = None
    budget: Budget = field(default_factory=Budget)
