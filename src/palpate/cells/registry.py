"""Which real robots can be reached: a URL's scheme names the driver that makes its cell."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell
from palpate.errors import Unavailable
from palpate.extensions import extensions, public

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


@dataclass(frozen=True, slots=True)
class Drivers:
    """The drivers there are, by scheme."""

    known: Mapping[str, Driver]

    def connect(self, url: str, scene: Scene | None) -> Cell:
        """The cell at `url`.

        Raises:
            Unavailable: no driver for its scheme, or no answer at the URL.
        """
        scheme = url.partition("://")[0]
        if scheme not in self.known:
            have = ", ".join(sorted(self.known)) or "none"
            raise Unavailable(
                f"no driver for '{url}': leave robot= out to use the embedded one; drivers: {have}"
            )
        return self.known[scheme].connect(url, scene)


@cache
def drivers() -> Drivers:
    """Everything in the entry-point group `palpate.cells`.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """
    found: dict[str, Driver] = {}
    for module in extensions("palpate.cells"):
        for thing in public(module):
            if isinstance(thing, Driver):
                found.setdefault(thing.scheme, thing)
    return Drivers(found)
