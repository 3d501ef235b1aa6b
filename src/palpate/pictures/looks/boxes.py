"""Looks with corners: printed cartons, painted blocks, open and closed boxes, tables."""

from __future__ import annotations

from itertools import product

from palpate.pictures.looks.mesh import (
    WHITE,
    Colour,
    Fit,
    Part,
    cuboid,
    joined,
    level_quad,
    quad,
    superellipsoid,
)
from palpate.pictures.looks.prints import cardboard, sign, wood
from palpate.pictures.looks.prints import carton as printed

TAPE: Colour = (0.80, 0.69, 0.48)
INSIDE = 0.62
"""Share of light that reaches the inside of an open box."""
BOARD = 0.0022
"""Thickness of drawn cardboard, m."""
FRAME: Colour = (0.20, 0.21, 0.23)
LEG = 0.022
"""Half the width of a table's leg, m."""
SHORTEST = 0.15
"""Height below which a table is drawn without legs, m."""


def carton(fit: Fit, words: str) -> list[Part]:
    """A printed carton."""
    return [Part(cuboid(fit.half, whole=False), WHITE, printed(words, fit.ink), shine=0.2)]


def block(fit: Fit, words: str) -> list[Part]:
    """A painted block with rounded edges, the words on its top."""
    parts = [Part(superellipsoid(fit.half, 0.12), fit.colour, shine=0.35)]
    if words:
        lid = level_quad(0.8 * fit.half[0], 0.8 * fit.half[1], fit.half[2] + 0.0004)
        parts.append(Part(lid, WHITE, sign(words, fit.ink), shine=0.1))
    return parts


def board(fit: Fit, _: str) -> list[Part]:
    """Something made of wood, in its own colour."""
    return [Part(cuboid(fit.half), fit.colour, wood(), shine=0.2)]


def shut(fit: Fit, words: str) -> list[Part]:
    """A cardboard box, its flaps closed and taped; the words on its front."""
    x, y, z = fit.half
    raised, tape, out = z + 0.0005, min(0.22 * y, 0.02), x + 0.0005
    strips = [
        level_quad(x, tape, raised),
        quad([[out, -tape, 0.5 * z], [out, tape, 0.5 * z], [out, tape, z], [out, -tape, z]]),
        quad([[-out, -tape, z], [-out, tape, z], [-out, tape, 0.5 * z], [-out, -tape, 0.5 * z]]),
    ]
    body = Part(cuboid(fit.half), fit.colour, cardboard())
    return [body, Part(joined(strips), TAPE, shine=0.7), *_front(fit, words)]


def open_box(fit: Fit, words: str) -> list[Part]:
    """A cardboard box without a lid, its flaps hanging outside."""
    x, y, z = fit.half
    walls = [
        cuboid((x, BOARD / 2, z)).moved([0, y - BOARD / 2, 0]),
        cuboid((x, BOARD / 2, z)).moved([0, -y + BOARD / 2, 0]),
        cuboid((BOARD / 2, y - BOARD, z)).moved([x - BOARD / 2, 0, 0]),
        cuboid((BOARD / 2, y - BOARD, z)).moved([-x + BOARD / 2, 0, 0]),
    ]
    floor = cuboid((x, y, BOARD / 2)).moved([0, 0, -z + BOARD / 2])
    red, green, blue = (INSIDE * value for value in fit.colour)
    # A flap at either end in x, folded outwards.
    far, low = x + 0.55 * y, z - 0.45 * y
    flaps = [
        quad([[x, -y, z], [far, -y, low], [far, y, low], [x, y, z]]),
        quad([[-x, y, z], [-far, y, low], [-far, -y, low], [-x, -y, z]]),
    ]
    return [
        Part(joined(walls), fit.colour, cardboard()),
        Part(floor, (red, green, blue), cardboard()),
        Part(joined(flaps), fit.colour, cardboard()),
        *_front(fit, words),
    ]


def _front(fit: Fit, words: str) -> list[Part]:
    """The words on both wider sides."""
    if not words:
        return []
    x, y, z = fit.half
    w, h, out = 0.62 * x, 0.5 * z, y + 0.0006
    front = quad([[-w, -out, -h], [w, -out, -h], [w, -out, h], [-w, -out, h]])
    back = quad([[w, out, -h], [-w, out, -h], [-w, out, h], [w, out, h]])
    return [Part(joined([front, back]), WHITE, sign(words, (250, 248, 240)), shine=0.1)]


def table(fit: Fit, _: str) -> list[Part]:
    """A wooden top, on a steel frame with four legs down to the floor."""
    top = Part(cuboid(fit.half), fit.colour, wood(), shine=0.2)
    if fit.drop < SHORTEST:
        return [top]
    x, y, z = fit.half - [0.04, 0.04, 0.0]
    sides, apron, leg = (1.0, -1.0), 0.03, fit.drop / 2
    frame = [cuboid((x, LEG / 2, apron)).moved([0, s * (y - LEG), -z - apron]) for s in sides]
    frame += [cuboid((LEG / 2, y, apron)).moved([s * (x - LEG), 0, -z - apron]) for s in sides]
    for sx, sy in product(sides, sides):
        frame.append(cuboid((LEG, LEG, leg)).moved([sx * (x - LEG), sy * (y - LEG), -z - leg]))
    return [top, Part(joined(frame), FRAME, shine=0.4)]
