"""Conversion of the forms in which users give arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from palpate.planning.planner import Planner

Widths = Mapping[str, str | float]
"""Half widths of intervals, by quantity or by parameter: `{"mass": "1g"}`, or SI numbers."""


def is_text(source: object) -> bool:
    """Test for MJCF text, in contrast to a file name."""
    return isinstance(source, str) and source.lstrip().startswith("<")


def is_file(source: object) -> bool:
    """Test for the name of a file."""
    return isinstance(source, str | Path) and not is_text(source)


def planner_name(planner: str | Planner) -> str:
    """Name of a planner, for the settings."""
    return planner if isinstance(planner, str) else planner.name


def contents_of(thing: Any, kind: type) -> dict[str, Any]:
    """Values of the fields of the dataclass `kind` in an instance of it, to construct a subclass."""
    return {part.name: getattr(thing, part.name) for part in fields(kind) if part.init}
