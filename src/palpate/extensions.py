"""Extensions by other packages through entry points.

Every group (`palpate.primitives`, `palpate.planners`, …) works alike: an entry point names a module, and
its public members of the group's kind are registered.

    [project.entry-points."palpate.planners"]
    cautious = "my_package.cautious"

In a group with many heavy members (`palpate.estimators`) an entry point names a single member, which is
loaded at first use.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType

from palpate.errors import InputError


def extensions(group: str) -> Iterator[ModuleType]:
    """Load the modules that the entry points of `group` name, sorted by name of the entry point.

    Entry points of palpate itself, from metadata of an older version, are ignored.

    Raises:
        InputError: a module cannot be loaded; the message names it.
    """
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        if not entry.value.startswith("palpate."):
            yield _loaded(entry)


def references(group: str) -> dict[str, str]:
    """References of a lazy group, `package.module:function` by name of the entry point."""
    entries = sorted(entry_points(group=group), key=lambda entry: entry.name)
    return {entry.name: entry.value for entry in entries}


def public(module: ModuleType) -> list[object]:
    """Public members of `module`: its `__all__`, else all without a leading underscore."""
    without_underscore = [name for name in vars(module) if not name.startswith("_")]
    names: list[str] = getattr(module, "__all__", without_underscore)
    return [getattr(module, name) for name in names]


def _loaded(entry: EntryPoint) -> ModuleType:
    kind = entry.group.removeprefix("palpate.")
    try:
        return entry.load()
    except Exception as error:
        raise InputError(
            f"the {kind} '{entry.name}' ({entry.value}) cannot be loaded: {type(error).__name__}: "
            f"{error}; repair or uninstall the package that brings them"
        ) from error
