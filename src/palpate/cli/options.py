"""Options of the commands: those made from the fields of the settings, and shared ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer

from palpate.common.errors import InputError
from palpate.common.extensions import DeclaredOption, iter_options
from palpate.runs.settings import Settings

Fields = dict[str, Any]  # Fields of `Settings` given to a command, nested as in the settings

_DECLARED = tuple(iter_options(Settings))
SCENE = ("poses", "root", "robot_body", "arm")
ASKED = ("request", "measure", "scene", "images", *SCENE)
LOOK = ("camera", "intrinsics", "pose_estimator")
MOTION = tuple(o.name for o in _DECLARED if o.option.panel == "Robot")
PLANNER = tuple(o.name for o in _DECLARED if o.option.panel == "Planner")
MODEL = "model_settings"  # All options of a model as planner

SceneArgument = Annotated[
    Path | None, typer.Argument(metavar="[SCENE]", help="Your MJCF, as --scene.")
]
SceneFile = Annotated[Path, typer.Argument(help="Your MJCF.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan (JSON, BT.CPP), an answer, or a run folder.")
]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")]
LiveView = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Show the run in the browser, at the pace of a real arm; replay it afterwards.",
        rich_help_panel="Watching",
    ),
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask before a real robot moves.")]


@dataclass(frozen=True)
class FromSettings:
    """Annotation of a command's parameter: the command takes these fields of the settings as options."""

    # Fields, with a dot before those of a nested one, `model_settings.base_url`; the name of a
    # nested one alone includes all of its options.
    names: tuple[str, ...]
    defaults: Mapping[str, Any]  # values of fields that differ from those in the settings

    def parameters(self) -> Iterator[Parameter]:
        """Parameters from which typer makes the options."""
        for declared in self._chosen():
            # Lists and settings without a default are None if they are not given.
            several = get_origin(declared.kind) in (tuple, frozenset) or declared.kind is Any
            unset = None if several or declared.field.default is MISSING else declared.field.default
            yield Parameter(
                _flat(declared.name),
                Parameter.KEYWORD_ONLY,
                default=self.defaults.get(declared.name, unset),
                annotation=Annotated[_kind(declared.kind), typer_option(declared)],
            )

    def gather(self, values: dict[str, Any]) -> Fields:
        """Take these fields out of a command's arguments. Lists that were not given are left out."""
        gathered: Fields = {}
        for name in (declared.name for declared in self._chosen()):
            value = values.pop(_flat(name))
            if value is not None:
                # Rebuild the nesting from the dotted name.
                *outer, last = name.split(".")
                inner = gathered
                for part in outer:
                    inner = inner.setdefault(part, {})
                inner[last] = value
        return gathered

    def _chosen(self) -> list[DeclaredOption]:
        options: list[DeclaredOption] = []
        for wanted in self.names:
            options += [o for o in _DECLARED if o.name == wanted or o.name.startswith(f"{wanted}.")]
        return options


def settings(*names: str, defaults: Mapping[str, Any] | None = None) -> FromSettings:
    """Annotate a parameter that takes fields of the settings as options."""
    return FromSettings(names, defaults or {})


def one_scene(argument: Path | None, given: Fields) -> Fields:
    """Add the scene that was given as an argument to the fields. Raises InputError: two scenes."""
    if argument is None:
        return given
    if "scene" in given:
        raise InputError(f"two scenes, '{argument}' and '{given['scene']}': give one")
    return given | {"scene": argument}


def _flat(name: str) -> str:
    """Name of the parameter of a field, different from all parameters of commands."""
    return f"setting_{name.replace('.', '__')}"


def _kind(hint: Any) -> Any:
    """Type of an option for typer: several values are a list, `QUANTITY=VALUE` entries are texts."""
    if get_origin(hint) in (tuple, frozenset):
        return list[get_args(hint)[0]] | None
    return list[str] | None if hint is Any else hint


def typer_option(declared: DeclaredOption) -> Any:
    """Make typer's option of a declared one."""
    option = declared.option
    return typer.Option(
        *declared.flags,
        metavar=option.metavar,
        help=option.help,
        rich_help_panel=option.panel,
        min=option.low,
        max=option.high,
        autocompletion=(lambda: list(option.choices)) if option.choices else None,
    )
