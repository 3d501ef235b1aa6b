"""Output of the commands, exit statuses, and verbosity."""

from __future__ import annotations

import logging
import math
import os
import re
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from palpate.common.display import json_text, visible
from palpate.common.errors import ExecutionAborted, InputError, PalpateError, Unavailable
from palpate.common.extensions import iter_options
from palpate.common.parameter import PlanRejected
from palpate.common.redaction import redact
from palpate.runs.report.console import LIVE_LOGGER, SafeConsole
from palpate.runs.settings import Settings

# Exit status of a run, by its status.
EXIT = {"complete": 0, "failed": 1, "rejected": 3, "aborted": 4, "running": 4}

ERRORS: dict[type[PalpateError], int] = {
    InputError: 2,
    PlanRejected: 3,
    ExecutionAborted: 4,
    Unavailable: 5,
}

_FLAGS = {option.field.name: option.flags[-1] for option in iter_options(Settings)}
# Options of the commands that read recordings.
_FLAGS.update({name: f"--{name}" for name in ("columns", "loaded", "empty", "hand")})
_ARGUMENT = re.compile(rf"\b({'|'.join(_FLAGS)})=(?=[\s\w,:.*]|$)")


def exit_status(error: PalpateError) -> int:
    """The process's exit status for an error."""
    statuses = [status for kind, status in ERRORS.items() if isinstance(error, kind)]
    return statuses[0] if statuses else 1


def in_flags(message: str) -> str:
    """Rewrite the library's arguments as options: `scene=D.xml` as `--scene D.xml`, and `scene=`
    alone as `--scene`.
    """

    def flag(match: re.Match[str]) -> str:
        value_follows = message[match.end() : match.end() + 1] not in " ,:."
        return _FLAGS[match.group(1)] + " " * value_follows

    return _ARGUMENT.sub(flag, message)


# Output of the commands: stdout for results, stderr for everything else.

out = SafeConsole(highlight=False)
err = SafeConsole(stderr=True, highlight=False)


def print_json(content: Any) -> None:
    """Print an object on stdout, as strict JSON."""
    sys.stdout.write(json_text(content) + "\n")


def print_error(error: PalpateError, as_json: bool) -> int:
    """Print an error as a line on stderr; with `as_json` also as an object on stdout. Return the exit status."""
    status, message = exit_status(error), redact(in_flags(str(error)))
    if as_json:
        with guard_printing():
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


def print_dim(line: str) -> None:
    """Print a dim line on stderr: progress, or the path of a file."""
    err.print(Text(line, "dim"), soft_wrap=True)


@contextmanager
def guard_printing() -> Generator[None]:
    """Report a failure to print inside the block on stderr; the exit status stays."""
    try:
        yield
        sys.stdout.flush()
    # Rich exits by SystemExit if its pipe was closed.
    except (OSError, SystemExit) as error:
        say(f"the result was not printed: {getattr(error, 'strerror', None) or 'nobody reads it'}")
        # Redirect the rest of the buffer, so that it does not fail again when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class Ticker:
    """Progress line on stderr: rewritten in place on a terminal, else a new line from time to time."""

    EVERY = 30.0  # s: interval of lines that are not rewritten

    def __init__(self) -> None:
        self._told = -math.inf
        self._line = ""

    def __call__(self, line: str) -> None:
        self._line = line
        # Pad the line, so that it covers the one before.
        if err.is_terminal:
            width = err.width - 1
            err.print(Text(line[:width].ljust(width), "dim"), end="\r")
        elif time.monotonic() - self._told >= self.EVERY:
            self._told = time.monotonic()
            self.end()

    def end(self) -> None:
        """Print the last line so that it stays."""
        if self._line:
            err.print(Text(self._line, "dim"))
        self._line = ""


def escape(text: str) -> str:
    """Escape untrusted text for rich."""
    from rich.markup import escape as rich_escape

    return rich_escape(text)


def ask_yes_no(question: str, default: bool = False) -> bool:
    """Ask at the terminal; no answer means no."""
    import typer

    try:
        return typer.confirm(question, default, err=True)
    except typer.Abort:
        err.print()
        return False


def figure_table(*headings: str, title: str | None = None, no_wrap: bool = False) -> Table:
    """Make a table without rules: names in the first column, right-aligned figures in the others."""
    table = Table(title=title, title_justify="left", box=None, header_style="dim", pad_edge=False)
    names, *figures = headings
    table.add_column(names, no_wrap=no_wrap)
    for heading in figures:
        table.add_column(heading, justify="right", no_wrap=no_wrap)
    return table


# Verbosity on stderr and log file, options of every command.


@dataclass(frozen=True)
class Voice:
    """Options of verbosity and log file."""

    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Say on stderr what goes on inside, too.")
    ] = False
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Show no progress; errors and results alone.")
    ] = False
    log: Annotated[
        Path | None,
        typer.Option("--log", metavar="FILE", help="Write progress and what goes on inside there."),
    ] = None

    @contextmanager
    def apply(self) -> Generator[None]:
        """Apply the options inside the block."""
        logger = logging.getLogger("palpate")
        level, silent = logger.level, err.quiet
        # Change the logger and the console, and restore both after the block.
        handlers = list(self._handlers())
        err.quiet = self.quiet
        if self.verbose or self.log is not None:
            logger.setLevel(logging.DEBUG)
        for handler in handlers:
            handler.setFormatter(_Redacting("%(asctime)s %(levelname)s %(name)s: %(message)s"))
            logger.addHandler(handler)
        try:
            yield
        finally:
            err.quiet = silent
            logger.setLevel(level)
            for handler in handlers:
                logger.removeHandler(handler)
                handler.close()

    def _handlers(self) -> Generator[logging.Handler]:
        if self.verbose or self.log is not None:
            # Details on stderr only with --verbose; warnings always.
            handler = logging.StreamHandler(sys.stderr)
            handler.setLevel(logging.DEBUG if self.verbose else logging.WARNING)
            # The live view shows these messages already: send them only to the log.
            handler.addFilter(lambda record: record.name != LIVE_LOGGER)
            yield handler
        if self.log is not None:
            try:
                yield logging.FileHandler(self.log, encoding="utf-8")
            except OSError as error:
                raise InputError(f"cannot write --log '{self.log}': {error.strerror}") from error


class _Redacting(logging.Formatter):
    """Formatter that removes keys of the environment and control characters of terminals."""

    def format(self, record: logging.LogRecord) -> str:
        # Indent the lines of a message, so that none looks like the first line of another message.
        return visible(redact(super().format(record))).replace("\n", "\n    ")
