"""Verbosity on stderr and log file: options of every command."""

from __future__ import annotations

import logging
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli import console
from palpate.display import visible
from palpate.errors import InputError
from palpate.live.console import TOLD
from palpate.redaction import redact

Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Say on stderr what goes on inside, too.")
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show no progress; errors and results alone.")
]
Log = Annotated[
    Path | None,
    typer.Option("--log", metavar="FILE", help="Write progress and what goes on inside there."),
]


@dataclass(frozen=True)
class Voice:
    """Options of verbosity and log file."""

    verbose: Verbose = False
    quiet: Quiet = False
    log: Log = None

    @contextmanager
    def heard(self) -> Generator[None]:
        """Apply the options inside the block.

        Raises:
            InputError: the log cannot be written.
        """
        logger = logging.getLogger("palpate")
        level, quiet = logger.level, console.err.quiet
        handlers = list(self._handlers())
        console.err.quiet = self.quiet
        if self.verbose or self.log is not None:
            logger.setLevel(logging.DEBUG)
        for handler in handlers:
            handler.setFormatter(_Redacting("%(asctime)s %(levelname)s %(name)s: %(message)s"))
            logger.addHandler(handler)
        try:
            yield
        finally:
            console.err.quiet = quiet
            logger.setLevel(level)
            for handler in handlers:
                logger.removeHandler(handler)
                handler.close()

    def _handlers(self) -> Generator[logging.Handler]:
        if self.verbose or self.log is not None:
            spoken = logging.StreamHandler(sys.stderr)
            spoken.setLevel(logging.DEBUG if self.verbose else logging.WARNING)
            # The live view shows these messages already: they go to the log only.
            spoken.addFilter(lambda record: record.name != TOLD)
            yield spoken
        if self.log is not None:
            try:
                yield logging.FileHandler(self.log, encoding="utf-8")
            except OSError as error:
                raise InputError(f"cannot write --log '{self.log}': {error.strerror}") from error


class _Redacting(logging.Formatter):
    """Formatter that removes keys of the environment and control characters of terminals."""

    def format(self, record: logging.LogRecord) -> str:
        # Indented, no line of a message looks like the first line of another one.
        return visible(redact(super().format(record))).replace("\n", "\n    ")
