"""HTML of all text on the live page. Names, messages and explanations may come from a model: they are
escaped here."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape

from palpate.display import visible

MARKS = {
    "SUCCESS": ("✓", "#2e9e6b"),
    "FAILURE": ("✗", "#d43d3d"),
    "RUNNING": ("▶", "#e08a00"),
    "INVALID": ("·", "#9aa0a6"),
}
_NOTE = "padding: .6em 1em; overflow-wrap: anywhere; line-height: 1.5"
_TREE = "padding: .5em 1em; overflow-wrap: anywhere; font: 12px/1.6 ui-monospace, monospace"


@dataclass(frozen=True, slots=True)
class Line:
    """A node of a tree: its text, depth, status, and its message at the end."""

    text: str
    depth: int
    status: str
    message: str = ""


def note(headline: str, *lines: str) -> str:
    """HTML of a headline with lines of text below it."""
    below = "".join(f"<div>{_text(line)}</div>" for line in lines)
    return f'<div style="{_NOTE}"><b>{_text(headline)}</b>{below}</div>'


def preformatted(text: str) -> str:
    """HTML of text with its line breaks and indentation."""
    return f'<div style="{_TREE}; white-space: pre-wrap">{escape(visible(text))}</div>'


def outline(lines: Iterable[Line]) -> str:
    """HTML of a tree with the statuses of its nodes; long messages are wrapped."""
    rows = ""
    for line in lines:
        mark, colour = MARKS[line.status]
        # A hanging indent: wrapped text stands below the name, not below the mark.
        indent = f"padding-left: {1.2 * line.depth + 1.4:.1f}em; text-indent: -1.4em"
        weight = "font-weight: 600" if line.status == "RUNNING" else ""
        said = f' <span style="color: #858b92">{_text(line.message)}</span>' if line.message else ""
        rows += (
            f'<div style="{indent}; {weight}"><span style="color: {colour}">{mark}</span> '
            f"{_text(line.text)}{said}</div>"
        )
    return f'<div style="{_TREE}">{rows}</div>'


def _text(text: str) -> str:
    return escape(visible(text.replace("\n", " ")))
