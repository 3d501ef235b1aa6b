"""A console for text from elsewhere."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from palpate.display import visible

LIVE_LOGGER = "palpate.told"
"""Name of the logger of what the live view shows."""


class SafeConsole(Console):
    """Rich's console, on which no text is a command: names and explanations may come from a model.

    Every piece of text is made safe on its way to the terminal, be it in a table, a tree or a line.
    """

    def prose(self, *markup: str) -> None:
        """Print a sentence: on a terminal its lines break between words, elsewhere it is one line. Print
        what is copied (a command, a path, an address) with `soft_wrap` instead."""
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
