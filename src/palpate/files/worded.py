"""Schema of a user's file, with errors in the file's own words."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError


class Section(BaseModel):
    """Part of a form: its keys, and no others."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)


def plain_number(value: Any) -> Any:
    """For a key that takes a number: YAML reads `1e-3` as a text, which pydantic takes for the
    number that it is, and `yes` as a truth value, which is none.

    Raises:
        ValueError: a truth value.
    """
    if isinstance(value, bool):
        raise ValueError("give a number")
    return value


def worded(error: ValidationError, form: type[BaseModel]) -> str:
    """The first thing that is wrong: its key, and what may stand there."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"]) or "content"
    if first["type"] == "missing":
        return f"'{key}' is missing"
    if first["type"] != "extra_forbidden":
        return f"'{key}': {first['msg'].removeprefix('Value error, ')}"
    valid = _keys(first["loc"][:-1], form)
    return f"unknown key '{key}'; valid: {', '.join(valid)}"


def _keys(where: tuple[int | str, ...], form: type[BaseModel]) -> list[str]:
    """The keys of the section that a path into the form leads to."""
    section = form
    for part in where:
        inner = section.model_fields[str(part)].annotation if isinstance(part, str) else None
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            section = inner
    return sorted(section.model_fields)
