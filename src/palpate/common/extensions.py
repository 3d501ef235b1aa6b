"""Registries of palpate's own parts and those of other packages, and command-line forms of settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, fields, is_dataclass
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import (
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from palpate.common.errors import InputError, unknown_name

T = TypeVar("T")


class Registry(dict[str, T]):
    """Parts by name: palpate's own first, then those of other packages. The first part of a name stays."""

    kind: ClassVar[str]  # Word for a part in messages

    def __init__(self, parts: Mapping[str, T] | Sequence[tuple[str, T]]) -> None:
        super().__init__()
        for name, part in parts.items() if isinstance(parts, Mapping) else parts:
            self.setdefault(name, part)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(self)}>"

    def named(self, name: str, hint: str = "", intended: str | None = None) -> T:
        """Return the part of that name; `hint` and `intended` as in `unknown_name`.

        Raises InputError: unknown; the message lists the valid names.
        """
        if name not in self:
            raise unknown_name(self.kind, name, self, hint, intended)
        return self[name]


def iter_entry_points(group: str) -> Iterator[object]:
    """Yield the public members of the modules that the entry points of `group` name.
    Raises InputError: a module cannot be loaded; the message names it."""
    for module in extensions(group):
        yield from public(module)


def extensions(group: str) -> Iterator[ModuleType]:
    """Load the modules that the entry points of `group` name, sorted by name of the entry point.

    Entry points of palpate itself, from metadata of an older version, are ignored.
    Raises InputError: a module cannot be loaded; the message names it.
    """
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        if not entry.value.startswith("palpate."):
            yield _load_entry(entry)


def references(group: str) -> dict[str, str]:
    """Return the references of a lazy group, `package.module:function` by name of the entry point."""
    entries = sorted(entry_points(group=group), key=lambda entry: entry.name)
    return {entry.name: entry.value for entry in entries}


def public(module: ModuleType) -> list[object]:
    """Return the public members of `module`: its `__all__`, else all without a leading underscore."""
    without_underscore = [name for name in vars(module) if not name.startswith("_")]
    names: list[str] = getattr(module, "__all__", without_underscore)
    return [getattr(module, name) for name in names]


def _load_entry(entry: EntryPoint) -> ModuleType:
    kind = entry.group.removeprefix("palpate.")
    try:
        return entry.load()
    except Exception as error:
        raise InputError(
            f"the {kind} '{entry.name}' ({entry.value}) cannot be loaded: {type(error).__name__}: "
            f"{error}; repair or uninstall the package that brings them"
        ) from error


# Command-line form of a field of the settings, declared at the field.


@dataclass(frozen=True, slots=True)
class Option:
    """Annotation of a settings field that is also a command-line option."""

    help: str  # one sentence; the command's help and the documentation show it
    metavar: str | None = None  # placeholder of the value; None for a switch
    panel: str | None = None  # heading under which the help lists it
    flags: tuple[str, ...] = ()  # spelling; by default the field's name, `--robot-config`
    # low, high: bounds of a number.
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()  # values that a shell completes


class DeclaredOption(NamedTuple):
    """A field that is an option: its dotted name, `model_settings.base_url`, and its type."""

    name: str
    field: Field[Any]
    kind: Any
    option: Option

    @property
    def flags(self) -> tuple[str, ...]:
        return self.option.flags or (f"--{self.field.name.replace('_', '-')}",)


def iter_options(model: Any, outer: str = "") -> Iterator[DeclaredOption]:
    """Iterate over the fields of a dataclass that are options, including those of nested dataclasses."""
    # Options are annotated fields; nested dataclasses add a prefix.
    hints = get_type_hints(model, include_extras=True)
    for field in fields(model):
        hint, name = hints[field.name], f"{outer}{field.name}"
        if is_dataclass(hint):
            yield from iter_options(hint, f"{name}.")
        elif get_origin(hint) is Annotated:
            kind, *extras = get_args(hint)
            for option in extras:
                if isinstance(option, Option):
                    yield DeclaredOption(name, field, kind, option)
