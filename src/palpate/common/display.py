"""Display of untrusted text, without terminal commands; small escaped tables for notebooks."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from pydantic_core import to_jsonable_python

from palpate.common.errors import Unavailable

if TYPE_CHECKING:
    from pandas import DataFrame


_UNSEEN = re.compile(
    "["
    "\x00-\x08\x0b-\x1f\x7f"  # C0 except tab and line feed, and delete
    "\x80-\x9f"  # C1: one character of these begins a command on some terminals
    "\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069"  # order of writing, lines
    "\ufeff\ufff9-\ufffb\U000e0000-\U000e007f"  # byte order, annotations, tags
    "\ud800-\udfff"  # halves of characters, which cannot be written at all
    "]"
)


def visible(text: str) -> str:
    r"""Escape every control character of `text` (`\x1b`), so that it cannot control a terminal.

    It could otherwise move the cursor, set colours or reverse the writing order. Tabs and line feeds stay.
    """
    return _UNSEEN.sub(_escape, text)


def json_text(content: Any, indent: int | None = None) -> str:
    """Dump strict JSON (no NaN) with every control character escaped. Raises ValueError: a number is not finite."""
    text = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    return _UNSEEN.sub(_json_escape, text)


def to_json(content: Any) -> Any:
    """Convert dataclasses, tuples, paths and arrays to JSON values.

    NaN and infinities become null, because JSON has no such numbers.
    """
    return to_jsonable_python(
        content, inf_nan_mode="null", fallback=lambda array: to_json(array.tolist())
    )


def _escape(match: re.Match[str]) -> str:
    code = ord(match.group())
    if code < 0x100:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}"


def _json_escape(match: re.Match[str]) -> str:
    # JSON escapes a character by its UTF-16 units.
    units = match.group().encode("utf-16-be", "surrogatepass")
    return "".join(
        f"\\u{high:02x}{low:02x}" for high, low in zip(units[::2], units[1::2], strict=True)
    )


def data_frame(columns: Mapping[str, Any]) -> DataFrame:
    """Make a pandas data frame from columns of equal length. Raises Unavailable: pandas is not installed."""
    try:
        from pandas import DataFrame  # pyright: ignore[reportMissingModuleSource]
    except ImportError:
        raise Unavailable("a data frame needs pandas: pip install pandas") from None
    return DataFrame(columns)


def table(caption: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a table as HTML with a caption; line breaks and spaces of the cells are kept."""
    lines = [f"<table><caption>{escape(caption.strip('<>'))}</caption>", _row("th", headings)]
    for row in rows:
        lines.append(_row("td", row))
    return "\n".join([*lines, "</table>"])


def text_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as text in columns, two spaces apart."""
    table = [headings, *rows]
    # Pad each column to its longest cell.
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines: list[str] = []
    for row in table:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def _row(tag: str, cells: Sequence[str]) -> str:
    style = ' style="text-align: left; white-space: pre-wrap"'
    return "<tr>" + "".join(f"<{tag}{style}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"
