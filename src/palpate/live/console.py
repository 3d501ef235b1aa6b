"""A console for text that others wrote."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

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

    def print(self, *objects: Any, soft_wrap: bool | None = None, **options: Any) -> None:
        """See `rich.console.Console.print`; `soft_wrap` holds where nobody reads lines at a width."""
        # On a terminal lines break between words; in a file or a pipe each stays one line.
        super().print(*objects, soft_wrap=soft_wrap and not self.is_terminal, **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """See `rich.console.Console.render`."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment(visible(segment.text), segment.style)
