"""Looks of tools and other objects: hammers, thermometers, soap, cloth, balls."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.pictures.looks.mesh import Mesh, grid, joined, lathe, panel, pillow, tube
from palpate.pictures.looks.part import STEEL, WHITE, Colour, Fit, Part
from palpate.pictures.looks.prints import fabric, noise, scale, sign, wood

ASH: Colour = (0.80, 0.60, 0.36)
RUBBER: Colour = (0.16, 0.17, 0.19)
DARK_STEEL: Colour = (0.36, 0.38, 0.42)


def hammer(fit: Fit, _: str) -> list[Part]:
    """A claw hammer along x: handle from the near end, head at the far one, its claw at -y."""
    x, y, z = map(float, fit.half)
    thick = min(z, 0.26 * y)
    head = x - 0.15 * y - thick
    way = np.linspace(-x, head, 24)
    share = np.linspace(0, 1, 24)
    swell = thick * (0.62 + 0.14 * np.cos(2 * np.pi * share) + 0.08 * np.cos(5 * np.pi * share))
    handle = tube(_along(way), swell, flat=0.9)
    grip = tube(_along(way[1:11]), swell[1:11] * 1.09, flat=0.9)
    poll = lathe(
        [
            (0.0, -0.20 * y),
            (0.74 * thick, -0.20 * y),
            (0.78 * thick, 0.25 * y),
            (0.62 * thick, 0.36 * y),
            (0.62 * thick, 0.62 * y),
            (1.0 * thick, 0.72 * y),
            (1.0 * thick, 0.95 * y),
            (0.90 * thick, 1.0 * y),
            (0.0, 1.0 * y),
        ]
    )
    # The lathe turns about z; the head lies along y.
    lying = poll.vertices[:, [0, 2, 1]] * [1, 1, -1]
    metal = Mesh(lying, poll.faces, poll.uv).moved([head, 0, 0])
    prongs = [_prong(head, thick, y, side) for side in (1, -1)]
    return [
        Part(handle.moved(fit.centre), ASH, wood(), shine=0.3),
        Part(grip.moved(fit.centre), RUBBER, shine=0.15),
        Part(joined([metal, *prongs]).moved(fit.centre), DARK_STEEL, shine=0.8),
    ]


def _along(x: Array) -> Array:
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)


def _prong(head: float, thick: float, reach: float, side: int) -> Mesh:
    """Half of a claw: out to -y and bent towards the handle."""
    share = np.linspace(0, 1, 14)
    path = np.stack(
        [
            head - 0.42 * reach * share**2.2,
            -0.12 * reach - 0.86 * reach * share,
            side * thick * (0.30 + 0.22 * share),
        ],
        axis=1,
    )
    return tube(path, thick * (0.50 - 0.36 * share), flat=0.75)


def thermometer(fit: Fit, _: str) -> list[Part]:
    """A glass rod with a scale around it, a red column in it, and a metal tip."""
    r, h = 0.72 * fit.radius, fit.half[2]
    rod = lathe([(r, -0.72 * h), (r, 0.90 * h)])
    tip = lathe([(0.0, -h), (0.5 * r, -0.97 * h), (0.8 * r, -0.90 * h), (r, -0.72 * h)])
    knob = lathe(
        [(r, 0.90 * h), (1.35 * r, 0.91 * h), (1.35 * r, 0.99 * h), (1.1 * r, h), (0.0, h)]
    )
    return [
        Part(rod.moved(fit.centre), WHITE, scale(), shine=0.6),
        Part(tip.moved(fit.centre), STEEL, shine=0.9),
        Part(knob.moved(fit.centre), (0.78, 0.13, 0.14), shine=0.5),
    ]


def soap(fit: Fit, words: str) -> list[Part]:
    """A bar of soap, worn round, with the words pressed into it."""
    bar = pillow(fit.half, 0.42).moved(fit.centre)
    if not words:
        return [Part(bar, fit.colour, shine=0.6)]
    x, y, z = 0.55 * fit.half[0], 0.5 * fit.half[1], 0.995 * fit.half[2] + 0.0004
    face = panel(np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])).moved(fit.centre)
    return [
        Part(bar, fit.colour, shine=0.6),
        Part(face, WHITE, sign(words, fit.ink), shine=0.6),
    ]


def cloth(fit: Fit, _: str) -> list[Part]:
    """A crumpled cloth: folds that run together in its middle, its rim on the ground."""
    x, y, z = map(float, fit.half)
    random = np.random.default_rng(13)
    n = 34
    u, v = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    angle, away = np.arctan2(v, u), np.hypot(u, v)
    folds = 0.5 + 0.5 * np.sin(5 * angle + 6 * away + 0.8 * noise(random, (4, 4), n))
    hill = np.clip(1 - away**1.5 / 1.5, 0, 1)
    height = hill * (0.35 + 0.65 * folds) + 0.06 * noise(random, (7, 7), n) * hill
    height = (height - height.min()) / (height.max() - height.min())
    wave = 1 + 0.06 * noise(random, (5, 5), n)
    across = np.linspace(-x, x, n)
    along = np.linspace(-y, y, n)
    sheet = grid(across, along, z * (2 * height - 1))
    sheet.vertices[:, :2] *= np.clip(wave.reshape(-1, 1), 0.85, 1.0)
    return [Part(sheet.moved(fit.centre), fit.colour, fabric(), shine=0.0)]


def ball(fit: Fit, _: str) -> list[Part]:
    """Round."""
    return [Part(pillow(fit.half, 1.0).moved(fit.centre), fit.colour, shine=0.6)]


def candle(fit: Fit, _: str) -> list[Part]:
    """A thick candle, its rim a little molten, with a wick."""
    r, h = fit.radius, fit.half[2]
    wax = lathe(
        [
            (0.0, -h),
            (r, -h),
            (r, 0.90 * h),
            (0.93 * r, 0.95 * h),
            (0.8 * r, 0.90 * h),
            (0.0, 0.86 * h),
        ]
    )
    wick = tube(np.array([[0, 0, 0.8 * h], [0, 0, 0.95 * h], [0.06 * r, 0, h]]), [0.0014] * 3)
    return [
        Part(wax.moved(fit.centre), fit.colour, shine=0.4),
        Part(wick.moved(fit.centre), (0.13, 0.12, 0.11)),
    ]
