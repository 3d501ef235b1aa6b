"""Commands: functions with groups of options, and the output of their errors."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand, TyperOption

from palpate.cli.console import Voice, print_error
from palpate.cli.options import FromSettings, typer_option
from palpate.common.errors import ExecutionAborted, PalpateError
from palpate.common.extensions import DeclaredOption, Option
from palpate.common.processes import interrupts

VOICE = [field.name for field in fields(Voice)]
Function = TypeVar("Function", bound=Callable[..., None])


def command(app: typer.Typer, name: str | None = None) -> Callable[[Function], Function]:
    """Make a function a command of `app`, by its own name or another one.

    Every command takes the options of `Voice`. A parameter may be a group of options in two ways.
    With a dataclass as its type, the command has its fields as options, and the function gets the
    dataclass. The other way is the annotation `options.settings(…)`.

    A `PalpateError`, or a signal, becomes a message and its exit status. With `as_json` set, it is
    also printed as JSON.
    """

    def register(function: Function) -> Function:
        # Find the parameters that are groups of options.
        hints = get_type_hints(function, include_extras=True)
        groups = {name: group for name, hint in hints.items() if (group := _group(hint))}

        @wraps(function)
        def call(**given: Any) -> None:
            as_json = given.get("as_json", False)
            voice = Voice(**{name: given.pop(name) for name in VOICE})
            # Convert errors and signals to messages and exit statuses.
            with interrupts() as signals:
                try:
                    with signals.raise_in_block(), voice.apply():
                        # The options of a group become one argument.
                        gathered = {name: group.gather(given) for name, group in groups.items()}
                        function(**given, **gathered)
                except PalpateError as error:
                    raise typer.Exit(print_error(error, as_json)) from None
                except KeyboardInterrupt:
                    aborted = ExecutionAborted(signals.reason)
                    raise typer.Exit(print_error(aborted, as_json)) from None

        # typer reads the signature: give it the options in place of the groups.
        options = [*_options(function, hints, groups), *_Group(Voice).parameters()]
        called: Any = call
        called.__signature__ = Signature(options)
        called.__annotations__ = {option.name: option.annotation for option in options}
        app.command(name, cls=SingleValued)(call)
        return function

    return register


class SingleValued(TyperCommand):
    """Command that refuses an option of one value that is given twice. click uses the last value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        # Parse once to count the options, before click merges them.
        _, _, given = self.make_parser(ctx).parse_args(list(args))
        for option in given:
            takes_one = isinstance(option, TyperOption) and not (option.multiple or option.is_flag)
            if takes_one and given.count(option) > 1:
                raise typer.BadParameter(f"{option.opts[-1]} is given twice: give it once", ctx)
        return super().parse_args(ctx, args)


@dataclass(frozen=True)
class _Group:
    """Options that are the fields of a dataclass."""

    kind: Any

    def parameters(self) -> Iterator[Parameter]:
        hints = get_type_hints(self.kind, include_extras=True)
        for field in fields(self.kind):
            kind, info = get_args(hints[field.name])
            if isinstance(info, Option):
                info = typer_option(DeclaredOption(field.name, field, kind, info))
            default = Parameter.empty if field.default is MISSING else field.default
            yield _option(field.name, Annotated[kind, info], default)

    def gather(self, values: dict[str, Any]) -> Any:
        return self.kind(**{field.name: values.pop(field.name) for field in fields(self.kind)})


def _group(hint: Any) -> _Group | FromSettings | None:
    """Make the group of options of a parameter with this type; None for a single option."""
    if is_dataclass(hint):
        return _Group(hint)
    return next((extra for extra in get_args(hint) if isinstance(extra, FromSettings)), None)


def _options(
    function: Callable[..., None],
    hints: Mapping[str, Any],
    groups: Mapping[str, _Group | FromSettings],
) -> list[Parameter]:
    """List the function's parameters, with the options of a group in place of the group."""
    options: list[Parameter] = []
    for name, parameter in inspect.signature(function).parameters.items():
        if name in groups:
            options += groups[name].parameters()
        else:
            options.append(_option(name, hints[name], parameter.default))
    return options


def _option(name: str, hint: Any, default: Any) -> Parameter:
    assert get_origin(hint) is Annotated, f"'{name}' is no option and no group of options"
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=hint)
