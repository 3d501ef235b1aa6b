"""`palpate study`: its studies, in the order in which its help lists them."""

from __future__ import annotations

from collections.abc import Callable

import typer

from palpate.cli.command import command
from palpate.cli.study import faults, planners, scores

STUDIES: dict[str, Callable[..., None]] = {
    "accuracy": scores.accuracy,
    "variety": scores.variety,
    "efficiency": scores.efficiency,
    "ablation": planners.ablation,
    "repeatability": planners.repeatability,
    "faults": faults.faults,
    "deceptions": faults.deceptions,
}

app = typer.Typer(
    no_args_is_help=True,
    help="Run a study: accuracy, variety, efficiency, ablation, repeatability, faults, deceptions.",
)
for name, function in STUDIES.items():
    command(app, name)(function)
