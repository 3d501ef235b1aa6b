"""A tree with the statuses of its nodes, as HTML for the live page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape

from palpate.display import visible

MARKS = {
    "SUCCESS": ("✓", "#2e9e6b"),
    "FAILURE": ("✗", "#d43d3d"),
    "RUNNING": ("▶", "#e08a00"),
    "INVALID": ("·", "#9aa0a6"),
}


@dataclass(frozen=True, slots=True)
class Line:
    """A node: its text, how deep it stands, its status, and what it said at its end."""

    text: str
    depth: int
    status: str
    message: str = ""


def outline(lines: Iterable[Line]) -> str:
    """The tree as HTML; names and messages may come from a model, and are no markup."""
    return f'<div style="{_STYLE}">{"".join(_rows(lines))}</div>'


_STYLE = "font: 12px/1.6 ui-monospace, monospace; padding: .5em 1em; white-space: nowrap; overflow-x: auto"


def _rows(lines: Iterable[Line]) -> Iterator[str]:
    for line in lines:
        mark, colour = MARKS[line.status]
        indent = f"padding-left: {1.2 * line.depth:.1f}em"
        weight = "font-weight: 600" if line.status == "RUNNING" else ""
        said = f' <span style="color: #9aa0a6">{_text(line.message)}</span>' if line.message else ""
        yield (
            f'<div style="{indent}; {weight}"><span style="color: {colour}">{mark}</span> '
            f"{_text(line.text)}{said}</div>"
        )


def _text(text: str) -> str:
    return escape(visible(text.replace("\n", " ")))
