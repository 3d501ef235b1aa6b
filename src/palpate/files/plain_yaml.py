"""YAML of users: plain values of bounded size, and schemas whose errors use the file's own keys."""

from __future__ import annotations

from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from palpate.errors import InputError

try:  # libyaml's parser is ten times as fast as the one in Python
    from yaml import CSafeLoader as Loader
except ImportError:
    from yaml import SafeLoader as Loader

MAX_DEPTH = 10
"""Deepest nesting of lists and mappings."""

_OPENING = (
    yaml.BlockMappingStartToken,
    yaml.BlockSequenceStartToken,
    yaml.FlowMappingStartToken,
    yaml.FlowSequenceStartToken,
)
_CLOSING = (yaml.BlockEndToken, yaml.FlowMappingEndToken, yaml.FlowSequenceEndToken)


def plain_yaml(text: str, where: str) -> Any:
    """Parse a YAML text; `where` names it in messages.

    Raises:
        InputError: not YAML, an alias, or too deep nesting; with line and column where the parser
            knows them.
    """
    try:
        # Aliases expand without bound, and deep nesting takes the parser quadratic time.
        depth, problem = 0, ""
        for token in yaml.scan(text, Loader=Loader):
            depth += isinstance(token, _OPENING) - isinstance(token, _CLOSING)
            if isinstance(token, yaml.AliasToken):
                problem = "aliases are not accepted"
            elif depth > MAX_DEPTH:
                problem = f"nested deeper than {MAX_DEPTH}"
            if problem:
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=token.start_mark)
        return yaml.load(text, Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        if mark is not None:
            where += f", line {mark.line + 1}, column {mark.column + 1}"
        raise InputError(f"{where}: not YAML: {getattr(error, 'problem', None) or error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not YAML: {error}") from None


def yaml_text(content: Any) -> str:
    """Write plain values as YAML that `plain_yaml` reads, in the given order."""
    return yaml.dump(content, Dumper=_Plain, sort_keys=False, allow_unicode=True, width=1000)


class _Plain(yaml.SafeDumper):
    """Dumper without aliases, with lists of numbers on one line."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_sequence(
        self, tag: str, sequence: Any, flow_style: bool | None = None
    ) -> yaml.SequenceNode:
        numbers = all(isinstance(part, int | float) for part in sequence)
        return super().represent_sequence(tag, sequence, flow_style=numbers or flow_style)


class Section(BaseModel):
    """Base of a file's schema: other keys than its own are errors."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", arbitrary_types_allowed=True, defer_build=True
    )


def plain_number(value: Any) -> Any:
    """Validate a key that takes a number.

    Raises:
        ValueError: a truth value.
    """
    # YAML reads `1e-3` as a text, which pydantic converts, and `yes` as a truth value.
    if isinstance(value, bool):
        raise ValueError("give a number")
    return value


def worded(error: ValidationError, form: type[BaseModel]) -> str:
    """Describe the first error: its key and the valid choices."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"]) or "content"
    if first["type"] == "missing":
        return f"'{key}' is missing"
    if first["type"] != "extra_forbidden":
        return f"'{key}': {first['msg'].removeprefix('Value error, ')}"
    section = form  # the one that the path to the key leads to
    for part in first["loc"][:-1]:
        inner = section.model_fields[str(part)].annotation if isinstance(part, str) else None
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            section = inner
    return f"unknown key '{key}'; valid: {', '.join(sorted(section.model_fields))}"
