"""Command-line form of a field of the settings, declared beside the field."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import Field, dataclass, fields, is_dataclass
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints


@dataclass(frozen=True, slots=True)
class Option:
    """Annotation of a field that is an option of the command line, too.

    Attributes:
        help: one sentence; the command's help and the documentation show it.
        metavar: placeholder of the value; None for a switch.
        panel: heading under which the help lists it.
        flags: spelling; by default the field's name, `--robot-config`.
        low, high: bounds of a number.
        choices: values that a shell completes.
    """

    help: str
    metavar: str | None = None
    panel: str | None = None
    flags: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()


class Declared(NamedTuple):
    """A field that is an option: its dotted name, `model_settings.base_url`, and its type."""

    name: str
    field: Field[Any]
    kind: Any
    option: Option

    @property
    def flags(self) -> tuple[str, ...]:
        return self.option.flags or (f"--{self.field.name.replace('_', '-')}",)


def declared(model: Any, outer: str = "") -> Iterator[Declared]:
    """The fields of a dataclass that are options, those of nested dataclasses included."""
    hints = get_type_hints(model, include_extras=True)
    for field in fields(model):
        hint, name = hints[field.name], f"{outer}{field.name}"
        if is_dataclass(hint):
            yield from declared(hint, f"{name}.")
        elif get_origin(hint) is Annotated:
            kind, *extras = get_args(hint)
            for option in extras:
                if isinstance(option, Option):
                    yield Declared(name, field, kind, option)
