"""Commands: functions with groups of options, and the printing of their errors."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand, TyperOption
from typer.models import OptionInfo

from palpate.cli.console import Voice, print_error
from palpate.cli.options import FromSettings
from palpate.common.errors import ExecutionAborted, PalpateError
from palpate.common.processes import interrupts

VOICE = [field.name for field in fields(Voice)]
Function = TypeVar("Function", bound=Callable[..., None])


def command(app: typer.Typer, name: str | None = None) -> Callable[[Function], Function]:
    """Make a function a command of `app`, by its own name unless another is given.

    Every command takes the options of `Voice`. Two kinds of parameters are groups of options: one
    whose type is a dataclass (the command has its fields as options, and the function gets the
    dataclass), and one that is annotated with `options.settings(…)`. A `PalpateError`, or a signal,
    becomes a message and its exit status; a command with a parameter `as_json` that is set prints it
    as JSON too.
    """

    def register(function: Function) -> Function:
        hints = get_type_hints(function, include_extras=True)
        groups = {name: group for name, hint in hints.items() if (group := _group(hint))}

        @wraps(function)
        def call(**given: Any) -> None:
            as_json = given.get("as_json", False)
            voice = Voice(**{name: given.pop(name) for name in VOICE})
            with interrupts() as signals:
                try:
                    with signals.raised(), voice.heard():
                        function(**_gather_options(given, groups))
                except PalpateError as error:
                    raise typer.Exit(print_error(error, as_json)) from None
                except KeyboardInterrupt:
                    aborted = ExecutionAborted(signals.reason)
                    raise typer.Exit(print_error(aborted, as_json)) from None

        _set_options(call, [*_options(function, hints, groups), *_Group(Voice).parameters()])
        app.command(name, cls=SingleValued)(call)
        return function

    return register


class SingleValued(TyperCommand):
    """A command that refuses two values for an option that takes one; click keeps the last."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        _, _, given = self.make_parser(ctx).parse_args(list(args))
        for option in given:
            takes_one = isinstance(option, TyperOption) and not (option.multiple or option.is_flag)
            if takes_one and given.count(option) > 1:
                raise typer.BadParameter(f"{option.opts[-1]} is given twice: give it once", ctx)
        return super().parse_args(ctx, args)


@dataclass(frozen=True)
class _Group:
    """Options that are the fields of a dataclass, in the help's panel that it names."""

    kind: Any

    def parameters(self) -> Iterator[Parameter]:
        hints = get_type_hints(self.kind, include_extras=True)
        panel = getattr(self.kind, "PANEL", None)
        for field in fields(self.kind):
            hint = hints[field.name]
            kind, info = get_args(hint)
            if panel is not None and isinstance(info, OptionInfo):
                info = copy(info)
                info.rich_help_panel = panel
            yield _option(field.name, Annotated[kind, info], _default(field))

    def gather(self, values: dict[str, Any]) -> Any:
        return self.kind(**{field.name: values.pop(field.name) for field in fields(self.kind)})


def _group(hint: Any) -> _Group | FromSettings | None:
    """The group of options that a parameter of this type takes, if it does."""
    if is_dataclass(hint):
        return _Group(hint)
    return next((extra for extra in get_args(hint) if isinstance(extra, FromSettings)), None)


def _options(
    function: Callable[..., None],
    hints: Mapping[str, Any],
    groups: Mapping[str, _Group | FromSettings],
) -> list[Parameter]:
    """The function's parameters, the options of a group in the place of the group."""
    options: list[Parameter] = []
    for name, parameter in inspect.signature(function).parameters.items():
        if name in groups:
            options += groups[name].parameters()
        else:
            options.append(_option(name, hints[name], parameter.default))
    return options


def _default(field: Field[Any]) -> Any:
    if field.default is MISSING:
        return Parameter.empty
    return field.default


def _option(name: str, hint: Any, default: Any) -> Parameter:
    assert get_origin(hint) is Annotated, f"'{name}' is no option and no group of options"
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def _set_options(called: Any, options: list[Parameter]) -> None:
    """Set the signature from which typer makes the command."""
    called.__signature__ = Signature(options)
    called.__annotations__ = {option.name: option.annotation for option in options}


def _gather_options(
    given: Mapping[str, Any], groups: Mapping[str, _Group | FromSettings]
) -> dict[str, Any]:
    """The options as the function takes them: those of a group in a group."""
    arguments = dict(given)
    for name, group in groups.items():
        arguments[name] = group.gather(arguments)
    return arguments
