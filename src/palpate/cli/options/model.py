"""Options: the planner, and a model as planner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

if TYPE_CHECKING:
    from palpate.planning.model.settings import ModelSettings


Planner = Annotated[
    str,
    typer.Option(
        "--planner",
        metavar="NAME",
        help="symbolic | exhaustive | replay:FILE | PROVIDER:MODEL",
        rich_help_panel="Planner",
    ),
]
Remeasure = Annotated[
    bool,
    typer.Option(
        "--remeasure",
        help="Measure requested quantities even if the scene states them.",
        rich_help_panel="Planner",
    ),
]
BaseUrl = Annotated[
    str | None, typer.Option("--base-url", metavar="URL", help="Address of the model's server.")
]
Native = Annotated[bool, typer.Option("--native", help="Ask for the provider's structured output.")]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="MODULE",
        help="Part of the prompt to leave out; may be repeated.",
        rich_help_panel="Model as planner",
    ),
]
PromptStyle = Annotated[
    str,
    typer.Option(
        "--prompt",
        metavar="full|lean",
        help="full: with how quantities are measured; lean: only the scene and the safety rules.",
    ),
]
CriticModel = Annotated[
    str | None,
    typer.Option(
        "--critic",
        metavar="PROVIDER:MODEL",
        help="A second model that may object to the plan once.",
    ),
]
Feedback = Annotated[
    int,
    typer.Option(
        "--feedback",
        metavar="N",
        min=0,
        max=10,
        help="Rounds in which findings go back to the model.",
    ),
]
Seconds = Annotated[
    float, typer.Option("--budget-seconds", metavar="S", min=1, help="Most time for a plan.")
]
Tokens = Annotated[
    int, typer.Option("--budget-tokens", metavar="N", min=1, help="Most tokens for a plan.")
]
Dollars = Annotated[
    float,
    typer.Option(
        "--budget-dollars", metavar="USD", min=0, help="Most cost of a plan, by list prices."
    ),
]


@dataclass(frozen=True)
class ModelOptions:
    """Settings of a model as planner."""

    PANEL: ClassVar[str] = "Model as planner"

    base_url: BaseUrl = None
    native: Native = False
    prompt: PromptStyle = "full"
    critic: CriticModel = None
    feedback: Feedback = 3
    budget_seconds: Seconds = 300
    budget_tokens: Tokens = 200_000
    budget_dollars: Dollars = 2

    def settings(self, without: Without = None) -> ModelSettings:
        """Settings of the model; `without` names modules of the prompt that are left out.

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
