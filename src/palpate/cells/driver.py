"""How the cells of one kind of real robot are made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell

if TYPE_CHECKING:
    from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Driver:
    """How the cells of one kind of robot are made: public in a module that an entry point of the
    group `palpate.cells` names.

    Attributes:
        scheme: of the robot's URLs, e.g. `franky` for `franky://HOST`.
        connect: makes the cell at a URL, for a scene. Without a scene (a plan is made of a picture
            alone) the cell is asked for that picture and for nothing else.
    """

    scheme: str
    connect: Callable[[str, Scene | None], Cell]
