"""YAML from somebody else: plain values, without what makes a short text a large one."""

from __future__ import annotations

from typing import Any

import yaml

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
    """The content of a YAML text without aliases, whose expansion is unbounded, and without deep
    nesting, which takes forever to read. `where` names it in messages.

    Raises:
        InputError: not YAML, or one of those; with line and column where the parser knows them.
    """
    try:
        _require_plain(text)
        return yaml.load(text, Loader)
    except yaml.YAMLError as error:
        raise InputError(_not_yaml(where, error)) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not YAML: {error}") from None


def yaml_text(content: Any) -> str:
    """Plain values as YAML that `plain_yaml` reads, in the order in which they are given."""
    return yaml.dump(content, Dumper=_Plain, sort_keys=False, allow_unicode=True, width=1000)


class _Plain(yaml.SafeDumper):
    """A value that is there twice is written twice; lists of numbers stand on one line."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_sequence(
        self, tag: str, sequence: Any, flow_style: bool | None = None
    ) -> yaml.SequenceNode:
        numbers = all(isinstance(part, int | float) for part in sequence)
        return super().represent_sequence(tag, sequence, flow_style=numbers or flow_style)


def _require_plain(text: str) -> None:
    depth = 0
    for token in yaml.scan(text, Loader=Loader):
        if isinstance(token, yaml.AliasToken):
            raise yaml.MarkedYAMLError(
                problem="aliases are not accepted", problem_mark=token.start_mark
            )
        depth += isinstance(token, _OPENING) - isinstance(token, _CLOSING)
        if depth > MAX_DEPTH:
            raise yaml.MarkedYAMLError(
                problem=f"nested deeper than {MAX_DEPTH}", problem_mark=token.start_mark
            )


def _not_yaml(where: str, error: yaml.YAMLError) -> str:
    """Error with the reason, and the position in the text if the parser gives one."""
    problem = getattr(error, "problem", None) or error
    mark = getattr(error, "problem_mark", None)
    if mark is not None:
        where += f", line {mark.line + 1}, column {mark.column + 1}"
    return f"{where}: not YAML: {problem}"
