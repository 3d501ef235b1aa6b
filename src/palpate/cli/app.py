"""`palpate`: its commands, in the order of its help."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from palpate.cli import commands_arms as arms
from palpate.cli import commands_running as running
from palpate.cli import commands_scenes as plans
from palpate.cli import commands_scenes as scenes
from palpate.cli import commands_scenes as seeing
from palpate.cli import commands_stored as estimates
from palpate.cli import commands_stored as stored
from palpate.cli.command import command
from palpate.cli.study import app as studies
from palpate.common.version import __version__

COMMANDS: dict[str, Callable[..., None]] = {
    "demo": running.demo,
    "scenarios": scenes.scenarios,
    "run": running.run,
    "init": scenes.init,
    "gap": scenes.gap,
    "see": seeing.see,
    "tags": seeing.tags,
    "plan": plans.plan,
    "prompt": plans.prompt,
    "check": plans.check,
    "execute": running.execute,
    "report": stored.report,
    "estimate": estimates.estimate,
    "fuse": stored.fuse,
    "compare": stored.compare,
    "open": stored.open_report,
    "export": stored.export,
    "prove": stored.prove,
    "vocabulary": plans.vocabulary,
    "dynamics": arms.dynamics,
    "noise": arms.noise,
    "calibrate": arms.calibrate,
    "teach": arms.teach,
    "doctor": arms.doctor,
}

app = typer.Typer(
    name="palpate",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Physics-accurate digital twins by touch: say what you want to simulate, and a robot measures only what your "
    "MuJoCo scene does not know yet.",
    epilog="Exit status: 0 every requested parameter identified · 1 finished, but a parameter is not, or wider than "
    "--within asks · 2 bad input · 3 no plan (the explanation says why) · 4 interrupted, or stopped early · "
    "5 planner or robot unavailable.",
)


def _version(value: bool) -> None:
    if value:
        print(f"palpate {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of `palpate` without a command."""


for name, function in COMMANDS.items():
    command(app, name)(function)
app.add_typer(studies, name="study")
