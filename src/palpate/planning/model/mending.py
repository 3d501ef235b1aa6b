"""Repair of unambiguous deviations of models from JSON, or from a plan's form.

Everything else is left as it is, for a finding. Each step is bounded by the length of the answer.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, cast

MOST_COMMENTS = 200
"""Block comments of an answer that are taken out; each may be looked for until its end."""
MOST_DIGITS = 9
"""Of a whole number that is written as text."""

_APART = re.compile(
    r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/|\b(?:None|True|False)\b|[\u00a0\u200b\u2028\ufeff]',
    re.DOTALL,
)
_TRAILING = re.compile(r'"(?:[^"\\]|\\.)*"|,(?=\s*[}\]])', re.DOTALL)
_ESCAPED = {code: f"\\u{code:04x}" for code in range(0x20)}
_LITERALS = {"None": "null", "True": "true", "False": "false"}

_FIELDS = frozenset(
    [
        "outcome",
        "parameters",
        "explanation",
        "tree",
        "nodes",
        "scene",
        "object",
        "quantity",
        "type",
        "children",
        "name",
        "id",
    ]
)
"""Names of fields, which are recognised in any case."""


def mended(text: str) -> str:
    """The text as JSON, as far as comments, trailing commas, blanks of other kinds and Python's words
    for null, true and false are what keeps it from being that. In strings, line ends and the like are
    escaped, and all else is left alone."""
    if text.count("/*") > MOST_COMMENTS:
        return text
    return _TRAILING.sub(_kept, _APART.sub(_replaced, text))


def normal(document: Mapping[str, Any]) -> dict[str, Any]:
    """A plan's document with its fields in lower case, `"cup.mass"` for a parameter, a list for the
    Sequence of what is in it, and without fields that are null where they may be absent."""
    found = _lower(document)
    parameters: object = found.get("parameters")
    if isinstance(parameters, list):
        found["parameters"] = [_parameter(item) for item in cast("list[object]", parameters)]
    if isinstance(found.get("outcome"), str):
        found["outcome"] = found["outcome"].strip().lower()
    if isinstance(found.get("nodes"), list):
        found["nodes"] = [_numbered(item) for item in cast("list[object]", found["nodes"])]
    if "tree" in found:
        found["tree"] = _tree(found["tree"])
    return found


def _replaced(match: re.Match[str]) -> str:
    token = match[0]
    if token.startswith('"'):
        return token.translate(_ESCAPED)
    return _LITERALS.get(token, " ")


def _kept(match: re.Match[str]) -> str:
    return match[0] if match[0].startswith('"') else ""


def _lower(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields by their names in lower case, where that is a field's name and is not there, too."""
    found: dict[str, Any] = {}
    for key, value in fields.items():
        name = key.strip().lower()
        known = name in _FIELDS and (name == key or name not in fields)
        found[name if known else key] = value
    return found


def _parameter(item: object) -> object:
    if isinstance(item, dict):
        return _lower(cast("dict[str, Any]", item))
    if isinstance(item, str) and item.count(".") == 1:
        body, quantity = item.split(".")
        return {"object": body.strip(), "quantity": quantity.strip()}
    return item


def _tree(value: object) -> object:
    """A tree with the same done to every node; it is no deeper than JSON is read."""
    if isinstance(value, list):
        return _tree({"type": "Sequence", "children": cast("list[object]", value)})
    if not isinstance(value, dict):
        return value
    node = _lower(cast("dict[str, Any]", value))
    for optional in ("name", "children"):
        if node.get(optional, "") is None:
            del node[optional]
    if isinstance(node.get("children"), list):
        node["children"] = [_tree(child) for child in cast("list[object]", node["children"])]
    return node


def _numbered(item: object) -> object:
    """A node of the flat form with its id, and those of its children, as numbers."""
    if not isinstance(item, dict):
        return item
    node = _lower(cast("dict[str, Any]", item))
    if "id" in node:
        node["id"] = _number(node["id"])
    if isinstance(node.get("children"), list):
        node["children"] = [_number(child) for child in cast("list[object]", node["children"])]
    return node


def _number(value: object) -> object:
    if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) <= MOST_DIGITS:
        return int(value)
    return value
