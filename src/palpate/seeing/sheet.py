"""A sheet of tags to print: a PDF at its exact size, with numbers and a scale bar."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.errors import InputError
from palpate.seeing.vision import MODULES, QUIET, TAGS, tag_pixels

DPI = 600
PAPER = (0.210, 0.297)
"""m: ISO A4, upright."""
EDGE, GAP, LINE = 0.012, 0.006, 0.004
"""m: margin of the sheet, space between tags, height of a line of writing."""
BAR = 0.1
"""m: length of the scale bar."""


def write_sheet(path: Path, numbers: Sequence[int], side: float) -> int:
    """Write a PDF of tags whose black square has a `side` in m; return its pages.

    Raises:
        InputError: a number or a side that cannot be, or the file exists or cannot be written.
    """
    widest = min(PAPER) - 2 * EDGE
    cell = side * (MODULES + 2 * QUIET) / MODULES
    if not (side >= 0.005 and cell <= widest):
        most = 1e3 * widest * MODULES / (MODULES + 2 * QUIET)
        raise InputError(f"size= must be 0.005 to {most / 1e3:.3f} m, not {side:g}")
    wrong = [number for number in numbers if not 0 <= number < TAGS]
    if wrong or not 0 < len(numbers) <= TAGS:
        raise InputError(f"tags are numbered 0 to {TAGS - 1}; give some of them")
    if path.exists():
        raise InputError(f"'{path}' exists already: choose another file")
    columns = int((widest + GAP) / (cell + GAP))
    rows = int((PAPER[1] - 2 * EDGE - 3 * LINE + GAP) / (cell + GAP + LINE))
    each = columns * rows
    pages = [_page(numbers[i : i + each], side, columns) for i in range(0, len(numbers), each)]
    try:
        pages[0].save(path, "PDF", resolution=DPI, save_all=True, append_images=pages[1:])
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}") from None
    return len(pages)


def _page(numbers: Sequence[int], side: float, columns: int) -> Image.Image:
    sheet = Image.new("L", (_dots(PAPER[0]), _dots(PAPER[1])), 255)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(_dots(0.7 * LINE))
    module = side / MODULES
    cell = side + 2 * QUIET * module
    for i, number in enumerate(numbers):
        row, column = divmod(i, columns)
        x, y = EDGE + column * (cell + GAP), EDGE + row * (cell + GAP + LINE)
        inner = (_dots(x + QUIET * module), _dots(y + QUIET * module))
        tag = Image.fromarray(np.asarray(tag_pixels(number)))
        sheet.paste(tag.resize((_dots(side), _dots(side)), Image.Resampling.NEAREST), inner)
        words = f'tag_{number}  size="{side / 2:g}"'
        draw.text((_dots(x + QUIET * module), _dots(y + cell)), words, fill=0, font=font)
    # A printer that scales is found out with a ruler.
    x, y = _dots(EDGE), _dots(PAPER[1] - EDGE)
    draw.line((x, y, x + _dots(BAR), y), fill=0, width=_dots(3e-4))
    for end in (x, x + _dots(BAR)):
        draw.line((end, y - _dots(0.002), end, y + _dots(0.002)), fill=0, width=_dots(3e-4))
    words = "100 mm: print at 100 %, and measure this line"
    draw.text((x, y - _dots(1.6 * LINE)), words, fill=0, font=font)
    return sheet


def _dots(length: float) -> int:
    return round(length / 0.0254 * DPI)
