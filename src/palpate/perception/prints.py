"""Textures: pictures of the assets, and drawn labels, cartons and signs."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.perception.renderer import Pixels

ASSETS = Path(__file__).with_name("assets")
Ink = tuple[int, int, int]  # RGB, 0 to 255
INK, PAPER = (38, 42, 48), (247, 243, 232)  # Colours of text and of its background
FACING = 25  # degrees. Rotation of a label so that its text faces the usual camera.


@cache
def picture(name: str) -> Pixels:
    """Load the texture NAME.png of the assets."""
    return np.asarray(Image.open(ASSETS / f"{name}.png").convert("RGB"))


@cache
def label(words: str, colour: Ink) -> Pixels:
    """Label around a bottle or tin: colour bands and the text three times around."""
    width, height = 768, 256
    image = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(image)
    # Colour bands at top and bottom.
    band = height // 7
    draw.rectangle((0, 0, width, band), fill=colour)
    draw.rectangle((0, height - band, width, height), fill=colour)
    for third in range(3):
        centre = (width * (2 * third + 1) // 6, height // 2)
        _write(draw, words, centre, (width // 3 - 24, height - 3 * band))
    return np.roll(np.asarray(image), round(width * FACING / 360), axis=1)


@cache
def carton(words: str, colour: Ink) -> Pixels:
    """Printed carton in the texture regions of `assets/carton.obj`: front, side and lid."""

    def mix(factor: float, base: Ink = colour) -> Ink:
        """Darken a colour by a factor below 1, or lighten it by one above 1."""
        red, green, blue = (min(255, round(value * factor)) for value in base)
        return red, green, blue

    size = 512
    image = Image.new("RGB", (size, size), colour)
    draw = ImageDraw.Draw(image)
    dark = mix(0.72)
    half, lid = size // 2, size // 5
    # Front: a paper panel with text, a sun above hills below it.
    draw.rounded_rectangle((12, lid + 24, half - 12, lid + 210), 18, fill=PAPER)
    _write(draw, words, (half // 2, lid + 116), (half - 40, 150))
    draw.ellipse((half // 2 - 46, size - 178, half // 2 + 46, size - 86), fill=mix(1.35))
    draw.pieslice((-60, size - 110, half // 2 + 60, size + 130), 180, 360, fill=dark)
    hill = (half // 2 - 60, size - 84, half + 60, size + 110)
    draw.pieslice(hill, 180, 360, fill=mix(0.8, dark))
    # Side: a table of figures.
    draw.rectangle((half, lid, size, size), fill=mix(0.9))
    draw.rectangle((half + 36, lid + 40, size - 36, size - 60), fill=PAPER)
    for line in range(lid + 62, size - 84, 22):
        draw.line((half + 52, line, size - 110, line), fill=INK, width=5)
        draw.line((size - 88, line, size - 54, line), fill=INK, width=5)
    # Lid with the fold of its flaps.
    draw.rectangle((0, 0, size, lid), fill=mix(1.08))
    draw.line((0, lid // 2, size, lid // 2), fill=dark, width=4)
    return np.asarray(image)


@cache
def sign(words: str, colour: Ink) -> Pixels:
    """Text on a background of one colour."""
    width, height = 384, 256
    image = Image.new("RGB", (width, height), colour)
    # Dark text on light backgrounds, and the reverse.
    ink = INK if sum(colour) > 380 else PAPER
    _write(ImageDraw.Draw(image), words, (width // 2, height // 2), (width - 40, height - 40), ink)
    return np.asarray(image)


def _write(
    draw: ImageDraw.ImageDraw,
    words: str,
    centre: tuple[int, int],
    room: tuple[int, int],
    ink: Ink = INK,
) -> None:
    """Write text as large as fits into `room` (width, height) pixels around `centre`.

    The text is on one line, or has one word per line, whichever is larger.
    """
    # Largest font size of both layouts.
    sizes: list[tuple[int, str]] = []
    for text in (words, words.replace(" ", "\n")):
        for size in (*range(120, 8, -4), 8):
            font = ImageFont.load_default(size=size)
            left, top, right, foot = draw.multiline_textbbox((0, 0), text, font=font, spacing=2)
            if size == 8 or (right - left <= room[0] and foot - top <= room[1]):
                sizes.append((size, text))
                break
    size, text = max(sizes, key=lambda fitting: fitting[0])
    font = ImageFont.load_default(size=size)
    draw.multiline_text(centre, text, font=font, fill=ink, anchor="mm", align="center", spacing=2)
