"""Picture of what a calibration of a camera leaves: every corner where it was seen, with a line, many times as long,
from there to where the fit has it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.files.write import write_new
from palpate.pictures.renderer import png
from palpate.seeing.handeye.fit import HandEye

LONGER = 100
"""Factor of a residual as drawn."""
INK, PALE, RED = (30, 30, 30), (190, 190, 190), (200, 60, 40)
MARGIN = 12
"""Pixels: between writing and the picture's edge."""


def draw_residuals(found: HandEye, path: Path) -> None:
    """Write a PNG of a calibration's residuals.

    Raises:
        InputError: it exists, or cannot be written.
    """
    picture = Image.new("RGB", found.lens.size, (255, 255, 255))
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(16)
    for corners, residuals in zip(found.corners, found.residuals, strict=True):
        draw.polygon([(x, y) for x, y in corners.tolist()], outline=PALE)
        for (x, y), (u, v) in zip(corners.tolist(), residuals.tolist(), strict=True):
            draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=INK)
            draw.line((x, y, x + LONGER * u, y + LONGER * v), fill=RED, width=2)
    size = math.sqrt(float(np.mean(found.residuals**2)))
    words = (
        f"{len(found.corners)} pictures of the tag, {len(found.refused)} left out; residuals {LONGER} times as long, "
        f"{size:.2f} pixels rms"
    )
    draw.text((MARGIN, MARGIN), words, fill=INK, font=font)
    write_new(path, png(np.asarray(picture)))
