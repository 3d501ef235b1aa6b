"""Next commands, as lines that can be copied."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from palpate.cli.console import escape, out


def show_next(what: str, command: Sequence[str]) -> None:
    """Print the next command."""
    out.print(f"\n[dim]{what}:[/]\n  {escape(shlex.join(command))}", soft_wrap=True)
