"""How things look in a notebook: small tables, everything in them escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def table(caption: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """HTML of a table with a caption above it; line breaks and spaces of the cells are kept."""
    lines = [f"<table><caption>{escape(caption.strip('<>'))}</caption>", _row("th", headings)]
    for row in rows:
        lines.append(_row("td", row))
    return "\n".join([*lines, "</table>"])


def _row(tag: str, cells: Sequence[str]) -> str:
    style = ' style="text-align: left; white-space: pre-wrap"'
    return "<tr>" + "".join(f"<{tag}{style}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"
