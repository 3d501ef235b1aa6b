"""Conversion of the forms in which users give arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from palpate.errors import perhaps
from palpate.planning.planner import Planner

P = ParamSpec("P")
R = TypeVar("R")
Widths = Mapping[str, str | float] | str | Sequence[str]
"""Half widths of intervals, by quantity or by parameter: `{"mass": "1g"}`, or SI numbers; or `"mass=1g, com=2mm"`."""


def known_keywords(verb: Callable[P, R], more: Iterable[str] = ()) -> Callable[P, R]:
    """Decorate a function so that an unknown keyword is a TypeError that names the nearest known one.

    Args:
        more: keywords that it takes as `**options`.
    """
    known = [name for name in signature(verb).parameters if name not in ("self", "options")]
    known += more

    @wraps(verb)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for name in kwargs:
            if name not in known:
                guess = perhaps(name, known) or f" it takes {', '.join(known)}"
                raise TypeError(f"{verb.__name__}() has no argument '{name}';{guess}")
        return verb(*args, **kwargs)

    return checked


def is_text(source: object) -> bool:
    """Test for MJCF text, in contrast to a file name."""
    return isinstance(source, str) and source.lstrip().startswith("<")


def is_file(source: object) -> bool:
    """Test for the name of a file."""
    return isinstance(source, str | Path) and not is_text(source)


def planner_name(planner: str | Planner) -> str:
    """Name of a planner, for the settings."""
    named: Any = planner  # the settings refuse what is neither
    return getattr(named, "name", named)


def contents_of(thing: Any, kind: type) -> dict[str, Any]:
    """Values of the fields of the dataclass `kind` in an instance of it, to construct a subclass."""
    return {part.name: getattr(thing, part.name) for part in fields(kind) if part.init}
