"""Driver interface: makes the cells of one kind of real robot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell
from palpate.cells.teach import GuidedHand

if TYPE_CHECKING:
    from palpate.robots.description import RobotDescription
    from palpate.scene.scene import Scene

Finding = tuple[bool, str, str]
"""Result of one diagnostic check: passed, name of the check, and its value or the remedy."""


@dataclass(frozen=True, slots=True)
class Driver:
    """Factory of the cells of one kind of robot: public in a module that an entry point of the
    group `palpate.cells` names.

    Attributes:
        scheme: of the robot's URLs, e.g. `franky` for `franky://HOST`.
        connect: makes the cell at a URL, for a scene. Without a scene (a plan is made of a picture
            alone) the cell is asked for that picture and for nothing else.
        examine: what `palpate doctor --robot` tells of the robot at a URL that is described so; the
            last argument asks whether it may hold itself for some seconds. None where nobody can say.
        guided: the hand of the robot at a URL, to be led by a person; None where it cannot be.
    """

    scheme: str
    connect: Callable[[str, Scene | None], Cell]
    examine: Callable[[str, RobotDescription, Callable[[], bool]], Iterator[Finding]] | None = None
    guided: Callable[[str, Scene], GuidedHand] | None = None
