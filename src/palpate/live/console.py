"""A console for text that others wrote."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from palpate.display import visible

TOLD = "palpate.told"
"""The logger of what the live view shows."""


class SafeConsole(Console):
    """Rich's console, on which no text is a command: names and explanations may come from a model.

    Rich's own commands are segments of a kind of their own and stay; every piece of text passes
    here on its way to the terminal, be it in a table, a tree or a line.
    """

    def prose(self, *markup: str) -> None:
        """Print a sentence: on a terminal its lines break between words, elsewhere it is one line. What
        is copied (a command, a path, an address) is printed with `soft_wrap` instead."""
        self.print(*markup, soft_wrap=not self.is_terminal)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """See `rich.console.Console.render`."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment(visible(segment.text), segment.style)
