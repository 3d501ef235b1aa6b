"""Looks with corners: printed cartons, painted blocks, open and closed boxes."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.pictures.looks.mesh import cuboid, joined, panel, pillow
from palpate.pictures.looks.part import WHITE, Colour, Fit, Part
from palpate.pictures.looks.prints import cardboard, sign, wood
from palpate.pictures.looks.prints import carton as printed

TAPE: Colour = (0.80, 0.69, 0.48)
INSIDE = 0.62
"""Share of light that reaches the inside of an open box."""
BOARD = 0.0022
"""m: how thick cardboard is drawn."""


def carton(fit: Fit, words: str) -> list[Part]:
    """A printed carton."""
    mesh = cuboid(fit.half, whole=False).moved(fit.centre)
    return [Part(mesh, WHITE, printed(words, fit.ink), shine=0.2)]


def block(fit: Fit, words: str) -> list[Part]:
    """A painted block with rounded edges, the words on its top."""
    parts = [Part(pillow(fit.half, 0.12).moved(fit.centre), fit.colour, shine=0.35)]
    if words:
        x, y, z = 0.8 * fit.half[0], 0.8 * fit.half[1], fit.half[2] + 0.0004
        lid = panel(np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])).moved(fit.centre)
        parts.append(Part(lid, WHITE, sign(words, fit.ink), shine=0.1))
    return parts


def board(fit: Fit, _: str) -> list[Part]:
    """Something made of wood, in its own colour."""
    return [Part(cuboid(fit.half).moved(fit.centre), fit.colour, wood(), shine=0.2)]


def shut(fit: Fit, words: str) -> list[Part]:
    """A cardboard box, its flaps closed and taped; the words on its front."""
    x, y, z = fit.half
    body = Part(cuboid(fit.half).moved(fit.centre), fit.colour, cardboard())
    raised, tape = z + 0.0005, min(0.22 * y, 0.02)
    corners = np.array(
        [[-x, -tape, raised], [x, -tape, raised], [x, tape, raised], [-x, tape, raised]]
    )
    down = np.array([[0, -tape, 0.5 * z], [0, tape, 0.5 * z], [0, tape, z], [0, -tape, z]])
    ends = [down + np.array([x + 0.0005, 0, 0]), down[::-1] - np.array([x + 0.0005, 0, 0])]
    strips = joined([panel(corners), *(panel(end) for end in ends)]).moved(fit.centre)
    return [body, Part(strips, TAPE, shine=0.7), *_front(fit, words)]


def open_box(fit: Fit, words: str) -> list[Part]:
    """A cardboard box without lid: one sees into it. Its flaps hang down outside."""
    x, y, z = fit.half
    walls = [
        cuboid((x, BOARD / 2, z)).moved([0, y - BOARD / 2, 0]),
        cuboid((x, BOARD / 2, z)).moved([0, -y + BOARD / 2, 0]),
        cuboid((BOARD / 2, y - BOARD, z)).moved([x - BOARD / 2, 0, 0]),
        cuboid((BOARD / 2, y - BOARD, z)).moved([-x + BOARD / 2, 0, 0]),
    ]
    floor = cuboid((x, y, BOARD / 2)).moved([0, 0, -z + BOARD / 2])
    dark = _shaded(fit.colour, INSIDE)
    flaps = [_flap(fit.half, side) for side in (1, -1)]
    return [
        Part(joined(walls).moved(fit.centre), fit.colour, cardboard()),
        Part(floor.moved(fit.centre), dark, cardboard()),
        Part(joined([panel(flap) for flap in flaps]).moved(fit.centre), fit.colour, cardboard()),
        *_front(fit, words),
    ]


def _flap(half: Array, side: int) -> Array:
    """(4, 3): a flap at the end in x, folded outwards and hanging."""
    x, y, z = half
    reach, fall = 0.55 * y, 0.45 * y
    near, far = side * x, side * (x + reach)
    corners = np.array([[near, -y, z], [far, -y, z - fall], [far, y, z - fall], [near, y, z]])
    return corners if side > 0 else corners[::-1]


def _front(fit: Fit, words: str) -> list[Part]:
    """The words on both wider sides, where there are any."""
    if not words:
        return []
    x, y, z = fit.half
    w, h, out = 0.62 * x, 0.5 * z, y + 0.0006
    front = np.array([[-w, -out, -h], [w, -out, -h], [w, -out, h], [-w, -out, h]])
    back = np.array([[w, out, -h], [-w, out, -h], [-w, out, h], [w, out, h]])
    mesh = joined([panel(front), panel(back)]).moved(fit.centre)
    return [Part(mesh, WHITE, sign(words, (250, 248, 240)), shine=0.1)]


def _shaded(colour: Colour, factor: float) -> Colour:
    red, green, blue = (factor * value for value in colour)
    return red, green, blue
