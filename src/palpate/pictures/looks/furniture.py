"""Looks of furniture and of the room."""

from __future__ import annotations

from palpate.pictures.looks.mesh import Mesh, cuboid, joined
from palpate.pictures.looks.part import Colour, Fit, Part
from palpate.pictures.looks.prints import wood

FRAME: Colour = (0.20, 0.21, 0.23)
LEG = 0.022
"""m: half the width of a leg."""
SHORTEST = 0.15
"""m: lower things need no legs."""


def table(fit: Fit, _: str) -> list[Part]:
    """A wooden top of planks, on a steel frame with four legs down to the floor."""
    fit = fit.main or fit
    top = Part(cuboid(fit.half).moved(fit.centre), fit.colour, wood(), shine=0.2)
    if fit.drop < SHORTEST:
        return [top]
    return [top, Part(_frame(fit), FRAME, shine=0.4)]


def _frame(fit: Fit) -> Mesh:
    x, y, z = fit.half - [0.04, 0.04, 0.0]
    apron = 0.03
    below = -z - apron
    rails = [
        cuboid((x, LEG / 2, apron)).moved([0, side * (y - LEG), below]) for side in (1.0, -1.0)
    ]
    rails += [
        cuboid((LEG / 2, y, apron)).moved([side * (x - LEG), 0, below]) for side in (1.0, -1.0)
    ]
    half = fit.drop / 2
    legs = [
        cuboid((LEG, LEG, half)).moved([sx * (x - LEG), sy * (y - LEG), -z - half])
        for sx in (1.0, -1.0)
        for sy in (1.0, -1.0)
    ]
    return joined([*rails, *legs]).moved(fit.centre)
