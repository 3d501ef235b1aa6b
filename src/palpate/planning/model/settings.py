"""Settings and budget of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from palpate.planning.model.conversation import Conversation

if TYPE_CHECKING:
    from palpate.planning.model.prompt.compose import Style

FEEDBACK_ROUNDS = 3
"""Number of times that findings go back to the model."""


@dataclass(frozen=True, slots=True)
class Budget:
    """Budget of one plan.

    Attributes:
        seconds: wall time of the whole dialogue.
        attempt_seconds: of one request; None for all that is left. A model on a local computer may take
            minutes.
        tokens: input and output together.
        dollars: by list prices, where the model has one.
    """

    seconds: float = 300.0
    attempt_seconds: float | None = None
    tokens: int = 200_000
    dollars: float = 2.0

    def patience(self, left: float) -> float:
        """Seconds that one request may take when `left` are left of all."""
        limit = left if self.attempt_seconds is None else self.attempt_seconds
        return max(0.1, min(left, limit))

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
        base_url: address of an OpenAI-compatible server or a proxy; None for the provider's own.
        native: ask for the provider's structured output, in the flat form, instead of JSON in
            prose.
        without: prompt modules and inputs to leave out (ablation).
        prompt: system prompt, `full` with methods of measurement or `lean` without.
        comments: comments in the scene's file are sent. Studies leave them out, as a comment beside a
            body ("was never weighed") gives the answer away.
        rounds: number of times that findings go back to the model.
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
