"""Output of the commands: stdout for results, stderr for everything else."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from typing import Any

from rich.table import Table
from rich.text import Text

from palpate.cli.exits import exit_status, in_flags
from palpate.display import json_text, visible
from palpate.errors import PalpateError
from palpate.live.console import SafeConsole
from palpate.redaction import redact

out = SafeConsole(highlight=False)
err = SafeConsole(stderr=True, highlight=False)


def print_json(content: Any) -> None:
    """Print an object on stdout, as strict JSON."""
    sys.stdout.write(json_text(content) + "\n")


def print_error(error: PalpateError, as_json: bool) -> int:
    """Print an error as a line on stderr, and as an object on stdout where JSON is wanted; return
    the exit status."""
    status, message = exit_status(error), redact(in_flags(str(error)))
    if as_json:
        with printing():
            print_failure(message, status)
    say(message)
    return status


def print_failure(message: str, status: int) -> None:
    """Print a failure as an object on stdout."""
    ended = {3: "rejected", 4: "aborted"}.get(status, "failed")
    print_json({"status": ended, "error": {"message": message, "exit_status": status}})


def say(line: str) -> None:
    """Print a line on stderr, if it is open."""
    with suppress(OSError, ValueError):
        print(f"palpate: {visible(line)}", file=sys.stderr, flush=True)


def aside(line: str) -> None:
    """Print a dim line on stderr: progress, or the place of a file."""
    err.print(Text(line, "dim"), soft_wrap=True)


@contextmanager
def printing() -> Generator[None]:
    """Print results inside the block; a failure to print is reported on stderr and does not change the
    exit status."""
    try:
        yield
        sys.stdout.flush()
    # Rich leaves by SystemExit when its pipe was closed.
    except (OSError, SystemExit) as error:
        say(f"the result was not printed: {getattr(error, 'strerror', None) or 'nobody reads it'}")
        # What is still in its buffer must not fail again when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class Ticker:
    """Progress line on stderr: rewritten in place on a terminal, else a new line now and then."""

    EVERY = 30.0
    """s between two lines that are not rewritten."""

    def __init__(self) -> None:
        self._told = -math.inf
        self._line = ""

    def __call__(self, line: str) -> None:
        self._line = line
        if err.is_terminal:
            width = err.width - 1
            err.print(Text(line[:width].ljust(width), "dim"), end="\r")
        elif time.monotonic() - self._told >= self.EVERY:
            self._told = time.monotonic()
            self.end()

    def end(self) -> None:
        """Keep the last line."""
        if self._line:
            err.print(Text(self._line, "dim"))
        self._line = ""


def escape(text: str) -> str:
    """Escape untrusted text for rich."""
    from rich.markup import escape as rich_escape

    return rich_escape(text)


def confirmed(question: str, default: bool = False) -> bool:
    """Ask at the terminal; no answer is a no."""
    import typer

    try:
        return typer.confirm(question, default, err=True)
    except typer.Abort:
        err.print()
        return False


def figure_table(*headings: str, title: str | None = None, no_wrap: bool = False) -> Table:
    """Make a table without rules: names in the first column, right-aligned numbers in the others."""
    table = Table(title=title, title_justify="left", box=None, header_style="dim", pad_edge=False)
    names, *figures = headings
    table.add_column(names, no_wrap=no_wrap)
    for heading in figures:
        table.add_column(heading, justify="right", no_wrap=no_wrap)
    return table
