"""All looks by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from palpate.errors import unknown_name
from palpate.pictures.looks import boxes, furniture, things, vessels
from palpate.pictures.looks.part import Fit, Part

LOOKS: Mapping[str, Callable[[Fit, str], list[Part]]] = {
    "ball": things.ball,
    "block": boxes.block,
    "board": boxes.board,
    "bottle": vessels.bottle,
    "bowl": vessels.bowl,
    "candle": things.candle,
    "carton": boxes.carton,
    "cloth": things.cloth,
    "cup": vessels.cup,
    "hammer": things.hammer,
    "mug": vessels.mug,
    "open_box": boxes.open_box,
    "shut_box": boxes.shut,
    "soap": things.soap,
    "table": furniture.table,
    "thermometer": things.thermometer,
    "tin": vessels.tin,
}


def parts_of(look: str, fit: Fit) -> list[Part]:
    """The parts of a look, fitted: `look` is its name and, after a blank, what is written on it or
    what is in it.

    Raises:
        InputError: there is no such look; the message lists those there are.
    """
    name, _, words = look.partition(" ")
    if name not in LOOKS:
        raise unknown_name("look", name, LOOKS)
    return LOOKS[name](fit, words.strip())
