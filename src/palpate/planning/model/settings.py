"""Settings and budget of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated
from urllib.parse import urlsplit, urlunsplit

from palpate.common.extensions import Option

if TYPE_CHECKING:
    from palpate.planning.model.conversation import Conversation
    from palpate.planning.model.prompt import Style
else:
    Style = str  # not imported: its module loads the vocabulary

PANEL = "Model as planner"
FEEDBACK_ROUNDS = 3
"""Number of rounds in which findings return to the model."""


@dataclass(frozen=True, slots=True)
class Budget:
    """Budget of one plan.

    Attributes:
        seconds: total time, s.
        attempt_seconds: time of one request, s; None for all the remaining time. A local model may
            take minutes.
        tokens: input and output tokens together.
        dollars: cost by list prices, for models with a known price.
    """

    seconds: Annotated[
        float, Option("Most time for a plan.", "S", PANEL, ("--budget-seconds",), low=1)
    ] = 300
    attempt_seconds: float | None = None
    tokens: Annotated[
        int, Option("Most tokens for a plan.", "N", PANEL, ("--budget-tokens",), low=1)
    ] = 200_000
    dollars: Annotated[
        float,
        Option("Most cost of a plan, by list prices.", "USD", PANEL, ("--budget-dollars",), low=0),
    ] = 2

    def patience(self, left: float) -> float:
        """Return the maximum seconds of one request with `left` seconds remaining in total."""
        patience = left if self.attempt_seconds is None else min(left, self.attempt_seconds)
        return max(0.1, patience)

    def exhaustion_reason(self, conversation: Conversation) -> str | None:
        """Return the reason why no further message may be sent, or None."""
        # Both limits apply to the whole dialogue, including the critic.
        if conversation.tokens >= self.tokens:
            return f"the budget of {self.tokens} tokens is used up"
        if (conversation.cost or 0.0) >= self.dollars:
            return f"the budget of ${self.dollars:g} is used up"
        return None


@dataclass(frozen=True, slots=True)
class ModelSettings:
    """Settings of a model as planner.

    Attributes:
        base_url: address of an OpenAI-compatible server or proxy; None for the provider's own.
        native: request structured output in the flat form, instead of JSON in prose.
        without: parts of the prompt to leave out.
        prompt: style of the system prompt.
        comments: send the comments in the scene's file. Studies leave them out, because a note on a
            body ("was never weighed") reveals the answer.
        rounds: rounds in which findings return to the model.
        critic: `PROVIDER:MODEL` of a critic; None without one.
        budget: time, tokens and cost of a plan.
    """

    base_url: Annotated[str | None, Option("Address of the model's server.", "URL", PANEL)] = None
    native: Annotated[bool, Option("Ask for the provider's structured output.", None, PANEL)] = (
        False
    )
    without: Annotated[
        frozenset[str], Option("Part of the prompt to leave out; may be repeated.", "MODULE", PANEL)
    ] = frozenset()
    prompt: Annotated[
        Style,
        Option(
            "full: with how quantities are measured; lean: only the scene and the safety rules.",
            "full|lean",
            PANEL,
        ),
    ] = "full"
    comments: bool = True
    rounds: Annotated[
        int,
        Option(
            "Rounds in which findings go back to the model.", "N", PANEL, ("--feedback",), 0, 10
        ),
    ] = FEEDBACK_ROUNDS
    critic: Annotated[
        str | None,
        Option("A second model that may object to the plan once.", "PROVIDER:MODEL", PANEL),
    ] = None
    budget: Budget = field(default_factory=Budget)

    @property
    def address(self) -> str | None:
        """`base_url` without user name, password and query, for files and reports."""
        # User name, password and query may contain keys.
        url = urlsplit(self.base_url or "")
        host = url.netloc.rpartition("@")[2]
        return urlunsplit((url.scheme, host, url.path, "", "")) or None

    def check_values(self) -> ModelSettings:
        """Return these settings after a check of their names.

        Raises InputError: no such style, module or provider.
        """
        # Load the prompt module only if there is something to check.
        if self.prompt != "full" or self.without:
            from palpate.planning.model.prompt import check_modules, check_style

            check_style(self.prompt)
            check_modules(self.without)
        if self.critic is not None:
            from palpate.planning.model.provider import find_provider

            find_provider(self.critic)
        return self
