"""Registry of robot drivers: a URL's scheme selects the driver that makes the cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell, Driver
from palpate.cells.franky import driver as franky
from palpate.errors import Unavailable
from palpate.extensions import extensions, public

if TYPE_CHECKING:
    from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Drivers:
    """Known drivers, by scheme."""

    known: Mapping[str, Driver]

    def connect(self, url: str, scene: Scene | None) -> Cell:
        """The cell at `url`.

        Raises:
            Unavailable: no driver for its scheme, or no answer at the URL.
        """
        return self.of(url).connect(url, scene)

    def of(self, url: str) -> Driver:
        """The driver for a URL.

        Raises:
            Unavailable: there is none for its scheme.
        """
        scheme = url.partition("://")[0]
        if scheme not in self.known:
            have = ", ".join(sorted(self.known)) or "none"
            raise Unavailable(
                f"no driver for '{url}': leave robot= out to use the embedded one; drivers: {have}"
            )
        return self.known[scheme]


@cache
def drivers() -> Drivers:
    """palpate's own drivers, and those of the entry-point group `palpate.cells`.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """
    found = {franky.scheme: franky}
    for module in extensions("palpate.cells"):
        for thing in public(module):
            if isinstance(thing, Driver):
                found.setdefault(thing.scheme, thing)  # no package replaces palpate's own driver
    return Drivers(found)
