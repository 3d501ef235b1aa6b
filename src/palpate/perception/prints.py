"""Procedural and deterministic textures.

Textures vary around white and are tinted with the colour of their part.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.common.pose import Array
from palpate.perception.renderer import Pixels

Ink = tuple[int, int, int]
"""RGB, 0 to 255."""
INK, PAPER = (38, 42, 48), (247, 243, 232)
"""Colours of text and of its background."""
FACING = 25
"""degrees. Rotation of a label so that its text faces the usual camera."""


@cache
def wood() -> Pixels:
    """Six planks with their grain from left to right."""
    random, size = np.random.default_rng(7), 512
    across = np.linspace(0, 1, size)[:, None]
    # Growth rings: stripes of a sine with a phase distorted by smooth noise.
    bend = 0.10 * noise(random, (4, 3), size) + 0.03 * noise(random, (12, 4), size)
    rings = np.sin(2 * np.pi * 12 * (across + bend))
    fibres = noise(random, (size - 1, 14), size)
    knots = noise(random, (6, 5), size)
    shade = 0.91 + 0.03 * rings + 0.035 * fibres + 0.03 * knots
    # Each plank is shifted along the grain, varies in brightness, and ends in a gap.
    width = size // 6
    for plank in range(7):
        rows = slice(plank * width, (plank + 1) * width)
        shade[rows] = np.roll(shade[rows], random.integers(size), axis=1)
        shade[rows] *= 0.96 + 0.06 * random.random()
        shade[rows][:2] *= 0.80
    return _pixels(shade, (1.0, 0.985, 0.96))


@cache
def concrete() -> Pixels:
    """Swept floor: light with cloudy variations."""
    random, size = np.random.default_rng(3), 512
    clouds = noise(random, (6, 6), size) + 0.6 * noise(random, (24, 24), size)
    grains = random.standard_normal((size, size))
    return _pixels(0.93 + 0.022 * clouds + 0.012 * grains, (1.0, 1.0, 0.985))


@cache
def fabric() -> Pixels:
    """Coarse weave with darker stripes."""
    random, size = np.random.default_rng(5), 256
    row, column = np.indices((size, size))
    # Product of two sines for the weave, with a stripe every 64 pixels.
    weave = np.sin(2 * np.pi * row / 8) * np.sin(2 * np.pi * column / 8)
    shade = 0.88 + 0.08 * weave + 0.03 * random.standard_normal((size, size))
    stripe = (column % 64 < 6) | (row % 64 < 6)
    return _pixels(np.where(stripe, shade * 0.78, shade))


@cache
def cardboard() -> Pixels:
    """Corrugated board."""
    random, size = np.random.default_rng(11), 256
    shade = 0.92 + 0.05 * noise(random, (size // 2, 4), size)
    return _pixels(shade + 0.012 * random.standard_normal((size, size)))


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
    """Printed carton in the texture regions of `meshes.cuboid`."""

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
def scale() -> Pixels:
    """Thermometer tube: red column and degree marks on four sides."""
    width, height = 256, 1024
    image = Image.new("RGB", (width, height), (250, 250, 247))
    draw = ImageDraw.Draw(image)
    for side in range(4):
        middle = width * (2 * side + 1) // 8
        # Column, and a longer mark every fifth degree.
        draw.line((middle, height // 3, middle, height), fill=(200, 30, 34), width=9)
        for step in range(31):
            y = round(height * (0.06 + 0.9 * step / 30))
            long = 14 if step % 5 == 0 else 7
            draw.line((middle + 9, y, middle + 9 + long, y), fill=INK, width=3)
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


def noise(random: np.random.Generator, cells: tuple[int, int], size: int) -> Array:
    """Smooth noise (size, size) of about unit standard deviation, with `cells` rows and columns."""
    # Bicubic interpolation of coarse white noise.
    coarse = random.standard_normal((cells[0] + 1, cells[1] + 1)).astype(np.float32)
    smooth = Image.fromarray(coarse).resize((size, size), Image.Resampling.BICUBIC)
    return np.asarray(smooth, dtype=float)


def _pixels(shade: Array, tint: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Pixels:
    """RGB of a grey picture (height, width) with shades 0 to 1, tinted."""
    return (255 * np.clip(shade[..., None] * np.array(tint), 0, 1)).astype(np.uint8)
