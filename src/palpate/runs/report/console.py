"""Consoles for stdout and stderr, and text without markup."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from palpate.common.display import visible

LIVE_LOGGER = "palpate.live"  # Name of the logger for the content of the live view


class SafeConsole(Console):
    """Rich's console without interpretation of text: names and explanations may come from a model.

    Every piece of text is made safe on its way to the terminal, in tables, trees and lines.
    """

    def prose(self, *markup: str) -> None:
        """Print a sentence. On a terminal its lines break between words, elsewhere it is one line.

        Print text to copy (a command, a path, an address) with `soft_wrap` instead.
        """
        self.print(*markup, soft_wrap=not self.is_terminal)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """See `rich.console.Console.render`."""
        for segment in super().render(renderable, options):
            # Rich's own commands are control segments, not text.
            if segment.control:
                yield segment
            else:
                yield Segment(visible(segment.text), segment.style)


# HTML of all text on the live page. Names, messages and explanations may come from a model: they
# are escaped here.

MARKS = {
    "SUCCESS": ("✓", "#2e9e6b"),
    "FAILURE": ("✗", "#d43d3d"),
    "RUNNING": ("▶", "#e08a00"),
    "INVALID": ("·", "#9aa0a6"),
}
_NOTE = "padding: .6em 1em; overflow-wrap: anywhere; line-height: 1.5"
_TREE = "padding: .5em 1em; overflow-wrap: anywhere; font: 12px/1.6 ui-monospace, monospace"


@dataclass(frozen=True, slots=True)
class TreeLine:
    """A node of a tree: its text, depth, status, and its message at the end."""

    text: str
    depth: int
    status: str
    message: str = ""


def note(headline: str, *lines: str) -> str:
    """HTML of a headline with lines of text below it."""
    below = "".join(f"<div>{_text(line)}</div>" for line in lines)
    return f'<div style="{_NOTE}"><b>{_text(headline)}</b>{below}</div>'


def to_html(text: str) -> str:
    """HTML of text with its line breaks and indentation."""
    return f'<div style="{_TREE}; white-space: pre-wrap">{escape(visible(text))}</div>'


def outline(lines: Iterable[TreeLine]) -> str:
    """HTML of a tree with the statuses of its nodes; long messages are wrapped."""
    rows = ""
    for line in lines:
        mark, colour = MARKS[line.status]
        # Use a hanging indent: wrapped text begins below the name, not below the mark.
        indent = f"padding-left: {1.2 * line.depth + 1.4:.1f}em; text-indent: -1.4em"
        weight = "font-weight: 600" if line.status == "RUNNING" else ""
        note = f' <span style="color: #858b92">{_text(line.message)}</span>' if line.message else ""
        rows += (
            f'<div style="{indent}; {weight}"><span style="color: {colour}">{mark}</span> '
            f"{_text(line.text)}{note}</div>"
        )
    return f'<div style="{_TREE}">{rows}</div>'


def _text(text: str) -> str:
    return escape(visible(text.replace("\n", " ")))
