"""Looks of vessels: bottles, tins, mugs, cups, bowls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.pictures.looks.mesh import Mesh, lathe, tube
from palpate.pictures.looks.part import STEEL, Colour, Fit, Part
from palpate.pictures.looks.prints import label

CONTENTS: dict[str, Colour] = {
    "water": (0.62, 0.80, 0.90),
    "coffee": (0.20, 0.11, 0.06),
    "milk": (0.97, 0.96, 0.92),
    "tea": (0.62, 0.30, 0.08),
    "juice": (0.95, 0.60, 0.12),
}
GLAZE: Colour = (0.95, 0.94, 0.91)
CAP: Colour = (0.93, 0.93, 0.94)


def bottle(fit: Fit, words: str) -> list[Part]:
    """A bottle with shoulders, neck and cap, and a label with the words."""
    r, h = fit.radius, fit.half[2]
    glass = _turned(
        fit,
        [
            (0.0, -1.0),
            (0.80, -1.0),
            (0.95, -0.975),
            (1.0, -0.93),
            (1.0, 0.26),
            (0.97, 0.36),
            (0.86, 0.47),
            (0.66, 0.58),
            (0.48, 0.67),
            (0.40, 0.74),
            (0.38, 0.84),
            (0.0, 0.84),
        ],
    )
    cap = _turned(fit, [(0.42, 0.82), (0.44, 0.84), (0.44, 0.98), (0.40, 1.0), (0.0, 1.0)])
    ring = _turned(fit, [(0.39, 0.76), (0.46, 0.77), (0.46, 0.80), (0.39, 0.81)])
    paper = lathe([(1.012 * r, -0.62 * h), (1.012 * r, 0.12 * h)]).moved(fit.centre)
    return [
        Part(glass, fit.colour, shine=0.9),
        Part(cap, CAP, shine=0.4),
        Part(ring, CAP, shine=0.4),
        Part(paper, (1, 1, 1), label(words, fit.ink), shine=0.1),
    ]


def tin(fit: Fit, words: str) -> list[Part]:
    """A tin with rims, and a paper sleeve with the words."""
    r, h = fit.radius, fit.half[2]
    metal = _turned(
        fit,
        [
            (0.0, -1.0),
            (0.96, -1.0),
            (1.0, -0.985),
            (1.0, -0.95),
            (0.965, -0.93),
            (0.965, 0.93),
            (1.0, 0.95),
            (1.0, 0.985),
            (0.96, 1.0),
            (0.92, 0.96),
            (0.55, 0.96),
            (0.54, 0.972),
            (0.0, 0.972),
        ],
    )
    sleeve = lathe([(0.985 * r, -0.91 * h), (0.985 * r, 0.91 * h)]).moved(fit.centre)
    return [
        Part(metal, STEEL, shine=0.8),
        Part(sleeve, (1, 1, 1), label(words, fit.ink), shine=0.25),
    ]


def cup(fit: Fit, words: str) -> list[Part]:
    """An open cup, with what the words name in it."""
    wall = 0.10
    outside = [(0.0, -1.0), (0.70, -1.0), (0.76, -0.96), (0.90, -0.2), (1.0, 0.97), (0.985, 1.0)]
    inside = [(1.0 - wall, 0.97), (0.90 - wall, -0.2), (0.70 - wall, -0.86), (0.0, -0.88)]
    parts = [Part(_turned(fit, [*outside, *inside]), fit.colour, shine=0.6)]
    if words in CONTENTS:
        level = 0.62
        radius = 0.90 - wall + 0.10 * (level + 0.2) / 1.17
        parts.append(
            Part(_turned(fit, [(radius, level), (0.0, level)]), CONTENTS[words], shine=0.9)
        )
    return parts


def mug(fit: Fit, words: str) -> list[Part]:
    """A straight mug with a handle at its far side, with what the words name in it."""
    r, h = fit.radius, fit.half[2]
    outside = [(0.0, -1.0), (0.88, -1.0), (0.97, -0.96), (1.0, -0.88), (1.0, 0.95), (0.96, 1.0)]
    inside = [(0.89, 0.95), (0.89, -0.82), (0.0, -0.86)]
    bend = np.linspace(-np.pi / 2, np.pi / 2, 15)
    path = np.stack(
        [
            0.94 * r + 0.72 * r * np.cos(bend),
            np.zeros_like(bend),
            0.02 * h + 0.52 * h * np.sin(bend),
        ],
        axis=1,
    )
    handle = tube(path, np.full(len(path), 0.13 * r)).moved(fit.centre)
    parts = [
        Part(_turned(fit, [*outside, *inside]), fit.colour, shine=0.7),
        Part(handle, fit.colour, shine=0.7),
    ]
    if words in CONTENTS:
        parts.append(Part(_turned(fit, [(0.89, 0.62), (0.0, 0.62)]), CONTENTS[words], shine=0.9))
    return parts


def bowl(fit: Fit, _: str) -> list[Part]:
    """A round bowl on a foot."""
    outside = [
        (0.0, -1.0),
        (0.45, -1.0),
        (0.48, -0.90),
        (0.70, -0.62),
        (0.88, -0.15),
        (0.97, 0.5),
        (1.0, 0.98),
        (0.98, 1.0),
    ]
    inside = [(0.93, 0.96), (0.88, 0.4), (0.78, -0.15), (0.58, -0.62), (0.35, -0.82), (0.0, -0.85)]
    return [Part(_turned(fit, [*outside, *inside]), fit.colour, shine=0.6)]


def _turned(fit: Fit, profile: Sequence[tuple[float, float]]) -> Mesh:
    """A profile in shares of radius and half height, where the body is."""
    metres = [(fit.radius * r, fit.half[2] * z) for r, z in profile]
    return lathe(metres).moved(fit.centre)
