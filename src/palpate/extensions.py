"""Extensions by other packages: the modules that their entry points name.

Every group works alike (`palpate.primitives`, `palpate.planners`, …): an entry point names a
module, and what is public in it and of the group's kind is registered.

    [project.entry-points."palpate.planners"]
    cautious = "my_package.cautious"

Where a group has very many heavy members of which few are used (`palpate.estimators`), an entry
point names one of them, and is loaded when it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType

from palpate.errors import InputError


def extensions(group: str) -> Iterator[ModuleType]:
    """The modules that the entry points of `group` name, in the order of the entry points' names.

    What is palpate's own needs none; metadata of an older palpate that names it is passed over.

    Raises:
        InputError: a module cannot be loaded; the message names it.
    """
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        if not entry.value.startswith("palpate."):
            yield _loaded(entry)


def references(group: str) -> dict[str, str]:
    """Of a group whose members are loaded only when they are used: what each entry point's name
    refers to, `package.module:function`, in the order of the names."""
    entries = sorted(entry_points(group=group), key=lambda entry: entry.name)
    return {entry.name: entry.value for entry in entries}


def public(module: ModuleType) -> list[object]:
    """Public names of `module`: its `__all__`, else all without a leading underscore."""
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
