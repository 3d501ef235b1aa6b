"""`palpate`: its commands, in the order of its help."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from palpate.cli import commands_arms, commands_running, commands_scenes, commands_stored
from palpate.cli.command import command
from palpate.cli.study import app as studies
from palpate.common.version import __version__

COMMANDS: dict[str, Callable[..., None]] = {
    "demo": commands_running.demo,
    "scenarios": commands_scenes.scenarios,
    "run": commands_running.run,
    "init": commands_scenes.init,
    "gap": commands_scenes.gap,
    "see": commands_scenes.see,
    "tags": commands_scenes.tags,
    "plan": commands_scenes.plan,
    "prompt": commands_scenes.prompt,
    "check": commands_scenes.check,
    "execute": commands_running.execute,
    "report": commands_stored.report,
    "estimate": commands_stored.estimate,
    "fuse": commands_stored.fuse,
    "compare": commands_stored.compare,
    "open": commands_stored.open_report,
    "export": commands_stored.export,
    "prove": commands_stored.prove,
    "vocabulary": commands_scenes.vocabulary,
    "dynamics": commands_arms.dynamics,
    "noise": commands_arms.noise,
    "calibrate": commands_arms.calibrate,
    "teach": commands_arms.teach,
    "doctor": commands_arms.doctor,
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
