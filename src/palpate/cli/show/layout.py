"""Tables whose figures are whole however narrow the terminal is."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from palpate.cli.console import out
from palpate.live.console import SafeConsole

NARROWEST = 14
"""Characters that words are given at least before a table becomes a list."""
UNLIMITED = 10_000
"""Characters of a line where nobody said how many there are."""

Cell = str | Text


@dataclass(frozen=True, slots=True)
class Column:
    """`words` may be broken between words; what is none, a figure, a name, a verdict, is always
    whole. `right` puts figures under each other."""

    heading: str
    words: bool = False
    right: bool = False
    style: str = ""


def width() -> int:
    """Characters of a line: of the terminal, or as `COLUMNS` says; what goes into a pipe or a file
    may be as wide as it is."""
    if out.is_terminal or os.environ.get("COLUMNS"):
        return out.width
    return UNLIMITED


def print_rows(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], title: str = "") -> None:
    """Print rows as a table where there is room, with words broken as far as needed; else as a
    list, a line per cell. Cells are rich markup, or text."""
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


def _table(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], title: str) -> Table:
    table = Table(
        title=title or None, title_justify="left", box=None, header_style="dim", pad_edge=False
    )
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


def _natural(thing: RenderableType) -> int:
    """Characters that it takes unbroken."""
    wide = SafeConsole(width=UNLIMITED)
    return Measurement.get(wide, wide.options, thing).maximum


def _fits(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], room: int) -> bool:
    """True if the table is narrow enough when its words are broken."""
    needed = 0
    for place, column in enumerate(columns):
        cells: list[Cell] = [column.heading, *(row[place] for row in rows)]
        whole = max(_natural(_text(cell)) for cell in cells)
        needed += min(whole, NARROWEST) if column.words else whole
    return needed + 2 * (len(columns) - 1) <= room


def _print_item(columns: Sequence[Column], row: Sequence[Cell], room: int) -> None:
    """The first cell, and below it the others with their headings."""
    console = SafeConsole(highlight=False, width=room)
    first, *others = (_text(cell) for cell in row)
    first.stylize(columns[0].style or "bold")
    console.print(first)
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
