"""Visual shapes of objects: boxes, bottles, tins, mugs and others."""

from __future__ import annotations

from itertools import product

import numpy as np

from palpate.common.pose import Array
from palpate.perception.meshes import (
    STEEL,
    WHITE,
    Colour,
    LookBox,
    LookPart,
    Mesh,
    cuboid,
    join_meshes,
    lathe,
    level_quad,
    quad,
    revolve,
    superellipsoid,
    surface,
    tube,
)
from palpate.perception.prints import cardboard, fabric, label, noise, scale, sign, wood
from palpate.perception.prints import carton as printed

TAPE: Colour = (0.80, 0.69, 0.48)
INSIDE = 0.62
"""Ratio. Brightness of the inside of an open box."""
BOARD = 0.0022
"""m. Thickness of drawn cardboard."""
FRAME: Colour = (0.20, 0.21, 0.23)
LEG = 0.022
"""m. Half the width of a table leg."""
SHORTEST = 0.15
"""m. Height below which a table is drawn without legs."""


def carton(fit: LookBox, words: str) -> list[LookPart]:
    """Printed carton."""
    return [LookPart(cuboid(fit.half, whole=False), WHITE, printed(words, fit.ink), shine=0.2)]


def block(fit: LookBox, words: str) -> list[LookPart]:
    """Painted block with rounded edges and the text on its top."""
    parts = [LookPart(superellipsoid(fit.half, 0.12), fit.colour, shine=0.35)]
    if words:
        lid = level_quad(0.8 * fit.half[0], 0.8 * fit.half[1], fit.half[2] + 0.0004)
        parts.append(LookPart(lid, WHITE, sign(words, fit.ink), shine=0.1))
    return parts


def board(fit: LookBox, _: str) -> list[LookPart]:
    """Wooden body in its own colour."""
    return [LookPart(cuboid(fit.half), fit.colour, wood(), shine=0.2)]


def shut(fit: LookBox, words: str) -> list[LookPart]:
    """Cardboard box with closed and taped flaps; the text is on its front."""
    x, y, z = fit.half
    raised, tape, out = z + 0.0005, min(0.22 * y, 0.02), x + 0.0005
    # Tape along the top and down both ends.
    strips = [
        level_quad(x, tape, raised),
        quad([[out, -tape, 0.5 * z], [out, tape, 0.5 * z], [out, tape, z], [out, -tape, z]]),
        quad([[-out, -tape, z], [-out, tape, z], [-out, tape, 0.5 * z], [-out, -tape, 0.5 * z]]),
    ]
    body = LookPart(cuboid(fit.half), fit.colour, cardboard())
    return [body, LookPart(join_meshes(strips), TAPE, shine=0.7), *_front(fit, words)]


def open_box(fit: LookBox, words: str) -> list[LookPart]:
    """Cardboard box without a lid, its flaps folded outside."""
    x, y, z = fit.half
    # Four thin walls on a darker floor.
    walls = [
        cuboid((x, BOARD / 2, z)).moved([0, y - BOARD / 2, 0]),
        cuboid((x, BOARD / 2, z)).moved([0, -y + BOARD / 2, 0]),
        cuboid((BOARD / 2, y - BOARD, z)).moved([x - BOARD / 2, 0, 0]),
        cuboid((BOARD / 2, y - BOARD, z)).moved([-x + BOARD / 2, 0, 0]),
    ]
    floor = cuboid((x, y, BOARD / 2)).moved([0, 0, -z + BOARD / 2])
    red, green, blue = (INSIDE * value for value in fit.colour)
    # One flap at either end in x, folded outwards.
    far, low = x + 0.55 * y, z - 0.45 * y
    flaps = [
        quad([[x, -y, z], [far, -y, low], [far, y, low], [x, y, z]]),
        quad([[-x, y, z], [-far, y, low], [-far, -y, low], [-x, -y, z]]),
    ]
    return [
        LookPart(join_meshes(walls), fit.colour, cardboard()),
        LookPart(floor, (red, green, blue), cardboard()),
        LookPart(join_meshes(flaps), fit.colour, cardboard()),
        *_front(fit, words),
    ]


def _front(fit: LookBox, words: str) -> list[LookPart]:
    """Text on both wider sides."""
    if not words:
        return []
    x, y, z = fit.half
    w, h, out = 0.62 * x, 0.5 * z, y + 0.0006
    front = quad([[-w, -out, -h], [w, -out, -h], [w, -out, h], [-w, -out, h]])
    back = quad([[w, out, -h], [-w, out, -h], [-w, out, h], [w, out, h]])
    return [LookPart(join_meshes([front, back]), WHITE, sign(words, (250, 248, 240)), shine=0.1)]


def table(fit: LookBox, _: str) -> list[LookPart]:
    """Wooden top on a steel frame with four legs down to the floor."""
    top = LookPart(cuboid(fit.half), fit.colour, wood(), shine=0.2)
    if fit.drop < SHORTEST:
        return [top]
    x, y, z = fit.half - [0.04, 0.04, 0.0]
    # Frame below the top: two beams in each direction and four legs.
    sides, apron, leg = (1.0, -1.0), 0.03, fit.drop / 2
    frame = [cuboid((x, LEG / 2, apron)).moved([0, s * (y - LEG), -z - apron]) for s in sides]
    frame += [cuboid((LEG / 2, y, apron)).moved([s * (x - LEG), 0, -z - apron]) for s in sides]
    for sx, sy in product(sides, sides):
        frame.append(cuboid((LEG, LEG, leg)).moved([sx * (x - LEG), sy * (y - LEG), -z - leg]))
    return [top, LookPart(join_meshes(frame), FRAME, shine=0.4)]


# Round and soft objects. Profiles of vessels are in units of radius and half height.


ASH: Colour = (0.80, 0.60, 0.36)
RUBBER: Colour = (0.16, 0.17, 0.19)
DARK_STEEL: Colour = (0.36, 0.38, 0.42)
CONTENTS: dict[str, Colour] = {
    "water": (0.62, 0.80, 0.90),
    "coffee": (0.20, 0.11, 0.06),
    "milk": (0.97, 0.96, 0.92),
    "tea": (0.62, 0.30, 0.08),
    "juice": (0.95, 0.60, 0.12),
}
CAP: Colour = (0.93, 0.93, 0.94)


def bottle(fit: LookBox, words: str) -> list[LookPart]:
    """Bottle with shoulders, neck, cap, and a label with the text."""
    r, h = fit.radius, fit.half[2]
    # Profiles of the body up to the neck, and of the cap with its ring.
    body = [(0.0, -1.0), (0.80, -1.0), (0.95, -0.975), (1.0, -0.93), (1.0, 0.26), (0.97, 0.36)]
    neck = [(0.86, 0.47), (0.66, 0.58), (0.48, 0.67), (0.40, 0.74), (0.38, 0.84), (0.0, 0.84)]
    cap = [(0.42, 0.82), (0.44, 0.84), (0.44, 0.98), (0.40, 1.0), (0.0, 1.0)]
    ring = [(0.39, 0.76), (0.46, 0.77), (0.46, 0.80), (0.39, 0.81)]
    # The label is slightly larger than the glass, so that they do not overlap.
    paper = lathe([(1.012 * r, -0.62 * h), (1.012 * r, 0.12 * h)])
    return [
        LookPart(revolve(fit, [*body, *neck]), fit.colour, shine=0.9),
        LookPart(revolve(fit, cap), CAP, shine=0.4),
        LookPart(revolve(fit, ring), CAP, shine=0.4),
        LookPart(paper, WHITE, label(words, fit.ink), shine=0.1),
    ]


def tin(fit: LookBox, words: str) -> list[LookPart]:
    """Tin with rims, and a paper sleeve with the text."""
    r, h = fit.radius, fit.half[2]
    # Profile of the metal with both rims; the sleeve covers the wall between them.
    foot = [(0.0, -1.0), (0.96, -1.0), (1.0, -0.985), (1.0, -0.95), (0.965, -0.93), (0.965, 0.93)]
    rim = [(1.0, 0.95), (1.0, 0.985), (0.96, 1.0), (0.92, 0.96)]
    lid = [(0.55, 0.96), (0.54, 0.972), (0.0, 0.972)]
    sleeve = lathe([(0.985 * r, -0.91 * h), (0.985 * r, 0.91 * h)])
    return [
        LookPart(revolve(fit, [*foot, *rim, *lid]), STEEL, shine=0.8),
        LookPart(sleeve, WHITE, label(words, fit.ink), shine=0.25),
    ]


def cup(fit: LookBox, words: str) -> list[LookPart]:
    """Open cup with the content that the text names."""
    # Profile up the outside and down the inside, with the liquid at `level`.
    outside = [(0.0, -1.0), (0.70, -1.0), (0.76, -0.96), (0.90, -0.2), (1.0, 0.97), (0.985, 1.0)]
    wall, level = 0.10, 0.62
    inside = [(1.0 - wall, 0.97), (0.90 - wall, -0.2), (0.70 - wall, -0.86), (0.0, -0.88)]
    vessel = LookPart(revolve(fit, [*outside, *inside]), fit.colour, shine=0.6)
    # The wall is inclined: its inner radius grows by 0.10 over a height of 1.17.
    return [vessel, *_content(fit, words, 0.90 - wall + 0.10 * (level + 0.2) / 1.17)]


def mug(fit: LookBox, words: str) -> list[LookPart]:
    """Straight mug with a handle at its far side and the content that the text names."""
    r, h = fit.radius, fit.half[2]
    outside = [(0.0, -1.0), (0.88, -1.0), (0.97, -0.96), (1.0, -0.88), (1.0, 0.95), (0.96, 1.0)]
    inside = [(0.89, 0.95), (0.89, -0.82), (0.0, -0.86)]
    # The handle is a tube along a half ellipse.
    bend = np.linspace(-np.pi / 2, np.pi / 2, 15)
    x, z = 0.94 * r + 0.72 * r * np.cos(bend), 0.02 * h + 0.52 * h * np.sin(bend)
    handle = tube(np.stack([x, np.zeros_like(bend), z], axis=1), np.full(15, 0.13 * r))
    return [
        LookPart(revolve(fit, [*outside, *inside]), fit.colour, shine=0.7),
        LookPart(handle, fit.colour, shine=0.7),
        *_content(fit, words, 0.89),
    ]


def _content(fit: LookBox, words: str, radius: float) -> list[LookPart]:
    """Surface of a liquid, if the text names one."""
    if words not in CONTENTS:
        return []
    return [LookPart(revolve(fit, [(radius, 0.62), (0.0, 0.62)]), CONTENTS[words], shine=0.9)]


def bowl(fit: LookBox, _: str) -> list[LookPart]:
    """Round bowl on a foot."""
    foot = [(0.0, -1.0), (0.45, -1.0), (0.48, -0.90), (0.70, -0.62)]
    outside = [(0.88, -0.15), (0.97, 0.5), (1.0, 0.98), (0.98, 1.0)]
    inside = [(0.93, 0.96), (0.88, 0.4), (0.78, -0.15), (0.58, -0.62), (0.35, -0.82), (0.0, -0.85)]
    return [LookPart(revolve(fit, [*foot, *outside, *inside]), fit.colour, shine=0.6)]


def hammer(fit: LookBox, _: str) -> list[LookPart]:
    """Claw hammer along x: handle at the near end, head at the far end, claw towards -y."""
    x, y, z = map(float, fit.half)
    # The handle is a tube of varying thickness, with a rubber grip on its lower part.
    thick = min(z, 0.26 * y)
    head = x - 0.15 * y - thick
    share = np.linspace(0, 1, 24)
    swell = thick * (0.62 + 0.14 * np.cos(2 * np.pi * share) + 0.08 * np.cos(5 * np.pi * share))
    axis = np.zeros((24, 3))
    axis[:, 0] = np.linspace(-x, head, 24)
    grip = slice(1, 11)

    # Profile of the head in units of its thickness and of its reach in y: eye, then face.
    eye = [(0.0, -0.20), (0.74, -0.20), (0.78, 0.25), (0.62, 0.36), (0.62, 0.62)]
    face = [(1.0, 0.72), (1.0, 0.95), (0.90, 1.0), (0.0, 1.0)]
    poll = lathe([(r * thick, along * y) for r, along in [*eye, *face]])
    # The lathe rotates about z, but the head lies along y.
    lying = poll.vertices[:, [0, 2, 1]] * [1, 1, -1]
    metal = [Mesh(lying, poll.faces, poll.uv).moved([head, 0, 0])]
    for side in (1, -1):
        metal.append(_prong(head, thick, y, side))
    return [
        LookPart(tube(axis, swell, flat=0.9), ASH, wood(), shine=0.3),
        LookPart(tube(axis[grip], swell[grip] * 1.09, flat=0.9), RUBBER, shine=0.15),
        LookPart(join_meshes(metal), DARK_STEEL, shine=0.8),
    ]


def _prong(head: float, thick: float, reach: float, side: int) -> Mesh:
    """Half of a claw at x = `head`, towards -y and bent towards the handle."""
    share = np.linspace(0, 1, 14)
    x = head - 0.42 * reach * share**2.2
    y = -0.12 * reach - 0.86 * reach * share
    z = side * thick * (0.30 + 0.22 * share)
    return tube(np.stack([x, y, z], axis=1), thick * (0.50 - 0.36 * share), flat=0.75)


def thermometer(fit: LookBox, _: str) -> list[LookPart]:
    """Glass rod with a scale, a red column and a metal tip."""
    rod = [(1.0, -0.72), (1.0, 0.90)]
    tip = [(0.0, -1.0), (0.5, -0.97), (0.8, -0.90), (1.0, -0.72)]
    knob = [(1.0, 0.90), (1.35, 0.91), (1.35, 0.99), (1.1, 1.0), (0.0, 1.0)]
    return [
        LookPart(revolve(fit, rod, 0.72), WHITE, scale(), shine=0.6),
        LookPart(revolve(fit, tip, 0.72), STEEL, shine=0.9),
        LookPart(revolve(fit, knob, 0.72), (0.78, 0.13, 0.14), shine=0.5),
    ]


def soap(fit: LookBox, words: str) -> list[LookPart]:
    """Rounded bar of soap with the text pressed into it."""
    parts = [LookPart(superellipsoid(fit.half, 0.42), fit.colour, shine=0.6)]
    if words:
        x, y, z = fit.half
        face = level_quad(0.55 * x, 0.5 * y, 0.995 * z + 0.0004)
        parts.append(LookPart(face, WHITE, sign(words, fit.ink), shine=0.6))
    return parts


def cloth(fit: LookBox, _: str) -> list[LookPart]:
    """Crumpled cloth: folds that meet in its middle, with the rim on the ground."""
    x, y, z = map(float, fit.half)
    random = np.random.default_rng(13)
    n = 34
    # Polar coordinates of the grid: radial folds, disturbed by noise.
    share = np.linspace(-1, 1, n)
    u, v = np.meshgrid(share, share)
    angle, away = np.arctan2(v, u), np.hypot(u, v)
    folds = 0.5 + 0.5 * np.sin(5 * angle + 6 * away + 0.8 * noise(random, (4, 4), n))
    # A hill that falls to the rim, with folds on it, normalised to the height of the box.
    hill = np.clip(1 - away**1.5 / 1.5, 0, 1)
    height = hill * (0.35 + 0.65 * folds) + 0.06 * noise(random, (7, 7), n) * hill
    height = (height - height.min()) / (height.max() - height.min())
    # Uneven rim.
    rim: Array = np.clip(1 + 0.06 * noise(random, (5, 5), n), 0.85, 1.0)
    across, along = np.meshgrid(np.linspace(-x, x, n), np.linspace(-y, y, n))
    points = np.stack([across * rim, along * rim, z * (2 * height - 1)], axis=-1)
    edge = np.linspace(0, 1, n)
    return [LookPart(surface(points, edge, edge), fit.colour, fabric(), shine=0.0)]


def ball(fit: LookBox, _: str) -> list[LookPart]:
    """Ellipsoid."""
    return [LookPart(superellipsoid(fit.half, 1.0), fit.colour, shine=0.6)]


def candle(fit: LookBox, _: str) -> list[LookPart]:
    """Thick candle with a slightly molten rim and a wick."""
    r, h = fit.radius, fit.half[2]
    wax = [(0.0, -1.0), (1.0, -1.0), (1.0, 0.90), (0.93, 0.95), (0.8, 0.90), (0.0, 0.86)]
    wick = tube(np.array([[0, 0, 0.8 * h], [0, 0, 0.95 * h], [0.06 * r, 0, h]]), [0.0014] * 3)
    return [LookPart(revolve(fit, wax), fit.colour, shine=0.4), LookPart(wick, (0.13, 0.12, 0.11))]
