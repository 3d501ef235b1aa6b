"""Tables whose figures stay unbroken in any width of terminal, and the next command to copy."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from palpate.cli.console import escape, out
from palpate.runs.report.console import SafeConsole

NARROWEST = 14  # Characters: least width of a column of words. Below it the table becomes a list.
UNLIMITED = 10_000  # Characters of a line in a pipe or a file

Cell = str | Text


@dataclass(frozen=True, slots=True)
class TableColumn:
    """Column of a table."""

    heading: str  # its name
    # Its cells may be broken between words; figures, names and verdicts never are.
    words: bool = False
    right: bool = False  # aligned to the right, digits below each other
    style: str = ""  # of rich


def width() -> int:
    """Characters of a line: of the terminal, or `COLUMNS`; unlimited in pipes and files."""
    if out.is_terminal or os.environ.get("COLUMNS"):
        return out.width
    return UNLIMITED


def print_rows(
    columns: Sequence[TableColumn], rows: Sequence[Sequence[Cell]], title: str = ""
) -> None:
    """Print rows as a table, or as a list with a line per cell.

    The table is used if the line is wide enough for it, with words broken as needed. Cells are rich
    markup or text.
    """
    room = width()
    table = _table(columns, rows, title)
    natural = _natural(table)
    if natural > room and not _fits(columns, rows, room):
        if title:
            out.print(Text(title, "italic"))
        for row in rows:
            _print_item(columns, row, room)
        return
    SafeConsole(highlight=False, width=min(natural, room), soft_wrap=False).print(table)


def _table(columns: Sequence[TableColumn], rows: Sequence[Sequence[Cell]], title: str) -> Table:
    table = Table(
        title=title or None, title_justify="left", box=None, header_style="dim", pad_edge=False
    )
    # Words may be broken, figures never.
    for column in columns:
        table.add_column(
            column.heading,
            justify="right" if column.right else "left",
            style=column.style,
            no_wrap=not column.words,
            overflow="fold",
        )
    for row in rows:
        table.add_row(*row)
    return table


def _natural(renderable: RenderableType) -> int:
    """Width of a renderable without line breaks, in characters."""
    wide = SafeConsole(width=UNLIMITED)
    return Measurement.get(wide, wide.options, renderable).maximum


def _fits(columns: Sequence[TableColumn], rows: Sequence[Sequence[Cell]], room: int) -> bool:
    """True if the table fits into `room` characters with its words broken."""
    # A column of words needs at most `NARROWEST` characters, all others their longest cell.
    needed = 0
    for place, column in enumerate(columns):
        cells: list[Cell] = [column.heading, *(row[place] for row in rows)]
        whole = max(_natural(_text(cell)) for cell in cells)
        needed += min(whole, NARROWEST) if column.words else whole
    return needed + 2 * (len(columns) - 1) <= room


def _print_item(columns: Sequence[TableColumn], row: Sequence[Cell], room: int) -> None:
    """Print the first cell, and below it the others with their headings."""
    console = SafeConsole(highlight=False, width=room)
    first, *others = (_text(cell) for cell in row)
    first.stylize(columns[0].style or "bold")
    console.print(first)
    # Align the cells behind the longest heading.
    indent = 2 + max((len(column.heading) for column in columns[1:]), default=0) + 2
    for column, cell in zip(columns[1:], others, strict=True):
        if not cell.plain:
            continue
        cell.stylize(column.style)
        grid = Table.grid(padding=0)
        grid.add_column(width=indent, no_wrap=True, style="dim")
        grid.add_column(overflow="fold")
        grid.add_row(f"  {column.heading}", cell)
        console.print(grid)


def _text(cell: Cell) -> Text:
    return cell.copy() if isinstance(cell, Text) else Text.from_markup(cell)


def show_next(what: str, command: Sequence[str]) -> None:
    """Print the next command."""
    out.print(f"\n[dim]{what}:[/]\n  {escape(shlex.join(command))}", soft_wrap=True)
