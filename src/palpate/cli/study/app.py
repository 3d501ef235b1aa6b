"""`palpate study`: its studies, in the order in which its help lists them."""

from __future__ import annotations

from collections.abc import Callable

import typer

from palpate.cli.command import command
from palpate.cli.study import planners, scores

STUDIES: dict[str, Callable[..., None]] = {
    "accuracy": scores.accuracy,
    "efficiency": scores.efficiency,
    "ablation": planners.ablation,
    "repeatability": planners.repeatability,
}

app = typer.Typer(
    no_args_is_help=True,
    help="Run a study: accuracy, efficiency, ablation, repeatability.",
)
for name, function in STUDIES.items():
    command(app, name)(function)
