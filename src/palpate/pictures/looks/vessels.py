"""Looks of vessels: bottles, tins, mugs, cups, bowls. Their profiles are in shares of radius and half
height."""

from __future__ import annotations

import numpy as np

from palpate.pictures.looks.mesh import STEEL, WHITE, Colour, Fit, Part, lathe, tube, turned
from palpate.pictures.looks.prints import label

CONTENTS: dict[str, Colour] = {
    "water": (0.62, 0.80, 0.90),
    "coffee": (0.20, 0.11, 0.06),
    "milk": (0.97, 0.96, 0.92),
    "tea": (0.62, 0.30, 0.08),
    "juice": (0.95, 0.60, 0.12),
}
CAP: Colour = (0.93, 0.93, 0.94)


def bottle(fit: Fit, words: str) -> list[Part]:
    """A bottle with shoulders, neck and cap, and a label with the words."""
    r, h = fit.radius, fit.half[2]
    body = [(0.0, -1.0), (0.80, -1.0), (0.95, -0.975), (1.0, -0.93), (1.0, 0.26), (0.97, 0.36)]
    neck = [(0.86, 0.47), (0.66, 0.58), (0.48, 0.67), (0.40, 0.74), (0.38, 0.84), (0.0, 0.84)]
    cap = [(0.42, 0.82), (0.44, 0.84), (0.44, 0.98), (0.40, 1.0), (0.0, 1.0)]
    ring = [(0.39, 0.76), (0.46, 0.77), (0.46, 0.80), (0.39, 0.81)]
    # The label stands off the glass, or the two would be drawn through each other.
    paper = lathe([(1.012 * r, -0.62 * h), (1.012 * r, 0.12 * h)])
    return [
        Part(turned(fit, [*body, *neck]), fit.colour, shine=0.9),
        Part(turned(fit, cap), CAP, shine=0.4),
        Part(turned(fit, ring), CAP, shine=0.4),
        Part(paper, WHITE, label(words, fit.ink), shine=0.1),
    ]


def tin(fit: Fit, words: str) -> list[Part]:
    """A tin with rims, and a paper sleeve with the words."""
    r, h = fit.radius, fit.half[2]
    foot = [(0.0, -1.0), (0.96, -1.0), (1.0, -0.985), (1.0, -0.95), (0.965, -0.93), (0.965, 0.93)]
    rim = [(1.0, 0.95), (1.0, 0.985), (0.96, 1.0), (0.92, 0.96)]
    lid = [(0.55, 0.96), (0.54, 0.972), (0.0, 0.972)]
    sleeve = lathe([(0.985 * r, -0.91 * h), (0.985 * r, 0.91 * h)])
    return [
        Part(turned(fit, [*foot, *rim, *lid]), STEEL, shine=0.8),
        Part(sleeve, WHITE, label(words, fit.ink), shine=0.25),
    ]


def cup(fit: Fit, words: str) -> list[Part]:
    """An open cup, with what the words name in it."""
    outside = [(0.0, -1.0), (0.70, -1.0), (0.76, -0.96), (0.90, -0.2), (1.0, 0.97), (0.985, 1.0)]
    wall, level = 0.10, 0.62
    inside = [(1.0 - wall, 0.97), (0.90 - wall, -0.2), (0.70 - wall, -0.86), (0.0, -0.88)]
    vessel = Part(turned(fit, [*outside, *inside]), fit.colour, shine=0.6)
    # The wall leans: its inner radius grows by 0.10 over a height of 1.17.
    return [vessel, *_content(fit, words, 0.90 - wall + 0.10 * (level + 0.2) / 1.17)]


def mug(fit: Fit, words: str) -> list[Part]:
    """A straight mug with a handle at its far side, with what the words name in it."""
    r, h = fit.radius, fit.half[2]
    outside = [(0.0, -1.0), (0.88, -1.0), (0.97, -0.96), (1.0, -0.88), (1.0, 0.95), (0.96, 1.0)]
    inside = [(0.89, 0.95), (0.89, -0.82), (0.0, -0.86)]
    bend = np.linspace(-np.pi / 2, np.pi / 2, 15)
    x, z = 0.94 * r + 0.72 * r * np.cos(bend), 0.02 * h + 0.52 * h * np.sin(bend)
    handle = tube(np.stack([x, np.zeros_like(bend), z], axis=1), np.full(15, 0.13 * r))
    return [
        Part(turned(fit, [*outside, *inside]), fit.colour, shine=0.7),
        Part(handle, fit.colour, shine=0.7),
        *_content(fit, words, 0.89),
    ]


def _content(fit: Fit, words: str, radius: float) -> list[Part]:
    """The surface of a liquid, if the words name one."""
    if words not in CONTENTS:
        return []
    return [Part(turned(fit, [(radius, 0.62), (0.0, 0.62)]), CONTENTS[words], shine=0.9)]


def bowl(fit: Fit, _: str) -> list[Part]:
    """A round bowl on a foot."""
    foot = [(0.0, -1.0), (0.45, -1.0), (0.48, -0.90), (0.70, -0.62)]
    outside = [(0.88, -0.15), (0.97, 0.5), (1.0, 0.98), (0.98, 1.0)]
    inside = [(0.93, 0.96), (0.88, 0.4), (0.78, -0.15), (0.58, -0.62), (0.35, -0.82), (0.0, -0.85)]
    return [Part(turned(fit, [*foot, *outside, *inside]), fit.colour, shine=0.6)]
