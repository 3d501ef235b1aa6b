"""Options that say which planner is asked, and how a model is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from palpate.planning.model.settings import ModelSettings


Planner = Annotated[
    str, typer.Option("--planner", help="symbolic | exhaustive | replay:FILE | PROVIDER:MODEL")
]
Remeasure = Annotated[
    bool, typer.Option("--remeasure", help="Measure what is asked even if the scene states it.")
]
BaseUrl = Annotated[str | None, typer.Option("--base-url", help="Address of the model's server.")]
Native = Annotated[bool, typer.Option("--native", help="Ask for the provider's structured output.")]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without", metavar="MODULE", help="Part of the prompt to leave out; may be repeated."
    ),
]
PromptStyle = Annotated[
    str,
    typer.Option(
        "--prompt",
        metavar="full|lean",
        help="Tell a model how quantities are measured, too, or only what there is and what is safe.",
    ),
]
CriticModel = Annotated[
    str | None,
    typer.Option(
        "--critic",
        metavar="PROVIDER:MODEL",
        help="A second model that reads the plan and may object to it once.",
    ),
]
Feedback = Annotated[
    int, typer.Option("--feedback", min=0, max=10, help="How often findings go back to the model.")
]
Seconds = Annotated[
    float, typer.Option("--budget-seconds", min=1, help="Longest that a model may take for a plan.")
]
Tokens = Annotated[
    int, typer.Option("--budget-tokens", min=1, help="Most tokens that a plan may take.")
]
Dollars = Annotated[
    float,
    typer.Option("--budget-dollars", min=0, help="Most that a plan may cost, by list prices."),
]


@dataclass(frozen=True)
class ModelOptions:
    """How a model is asked, where the planner is one."""

    base_url: BaseUrl = None
    native: Native = False
    prompt: PromptStyle = "full"
    critic: CriticModel = None
    feedback: Feedback = 3
    budget_seconds: Seconds = 300
    budget_tokens: Tokens = 200_000
    budget_dollars: Dollars = 2

    def settings(self, without: Without = None) -> ModelSettings:
        """As the planner takes them; `without` names modules of the prompt that are left out.

        Raises:
            InputError: no such module, prompt or provider.
        """
        from palpate.tools import model_settings

        return model_settings(
            self.base_url,
            self.native,
            without or (),
            self.feedback,
            self.prompt,
            self.critic,
            seconds=self.budget_seconds,
            tokens=self.budget_tokens,
            dollars=self.budget_dollars,
        )
