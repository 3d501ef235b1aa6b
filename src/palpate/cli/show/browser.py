"""A run's page, shown by the browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

from palpate.cli.console import escape, out, say
from palpate.errors import InputError

PAGE = "report.html"


def show_report(folder: Path) -> None:
    """Open the page and tell where it is, also where there is no browser to open it.

    Raises:
        InputError: there is no such page.
    """
    page = folder / PAGE
    if not folder.is_dir():
        raise InputError(f"'{folder}' is no folder: give that of a run")
    if not (folder / "result.json").exists():
        raise InputError(f"'{folder}' is not a run's folder: it has no result.json")
    if not page.exists():
        raise InputError(f"'{folder}' has no {PAGE} yet: `palpate report {folder}` writes it")
    out.print(escape(str(page.absolute())), soft_wrap=True)
    try:
        opened = webbrowser.open(page.absolute().as_uri())
    except webbrowser.Error:
        opened = False
    if not opened:
        say("no browser was found here: open the file above in one")
