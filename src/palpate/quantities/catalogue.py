"""The catalogue of quantities: palpate's own, then those of installed packages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache

from palpate.errors import unknown_name
from palpate.extensions import extensions, public
from palpate.parameter import Parameter
from palpate.quantities.com import CentreOfMass, CentreOfMassInSpace
from palpate.quantities.friction import Friction
from palpate.quantities.height import Height, Tilt
from palpate.quantities.inertia import Inertia
from palpate.quantities.mass import Mass
from palpate.quantities.motion import Momentum, Velocity
from palpate.quantities.position import Position
from palpate.quantities.quantity import Piece, Quantity
from palpate.quantities.size import Size
from palpate.quantities.stiffness import ContactDamping, Restitution, Stiffness
from palpate.trace.recording import Context

GROUP = "palpate.quantities"
"""Entry-point group of modules; each public `Quantity` in them that has an id is included."""
OWN: tuple[type[Quantity], ...] = (
    Mass,
    Height,
    Friction,
    CentreOfMass,
    CentreOfMassInSpace,
    Inertia,
    Position,
    Velocity,
    Momentum,
    Stiffness,
    ContactDamping,
    Restitution,
    Size,
    Tilt,
)
"""Order of the results, and of the priors: each may use the believed values of those before it."""


class Catalogue(Mapping[str, Quantity]):
    """Quantities by id, in their order."""

    def __init__(self, quantities: Iterable[Quantity]) -> None:
        self._by_id: dict[str, Quantity] = {}
        for quantity in quantities:
            self._by_id.setdefault(quantity.id, quantity)

    def __getitem__(self, id: str) -> Quantity:
        return self._by_id[id]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_id)

    def __len__(self) -> int:
        return len(self._by_id)

    def __repr__(self) -> str:
        return f"<Catalogue: {', '.join(self)}>"

    def named(self, id: str) -> Quantity:
        """Return the quantity with this id.

        Raises:
            InputError: there is none; the message lists the valid ones.
        """
        if id not in self._by_id:
            raise unknown_name("quantity", id, self, meant=self.meant(id))
        return self._by_id[id]

    def meant(self, word: str) -> str | None:
        """Return the id of the quantity that a word means in some language; None for other words."""
        for quantity in self.values():
            if any(word.lower() in words for words in quantity.words.values()):
                return quantity.id
        return None

    def of(self, subject: str) -> list[Quantity]:
        """Return the quantities of a kind of subject."""
        return [quantity for quantity in self.values() if quantity.subject == subject]

    def piece(self, parameter: Parameter, buffer: str, context: Context) -> Piece | None:
        """Return the piece of evidence that a recording is for a derived parameter; None if it is no
        evidence, or if a conversion primitive has to name it."""
        quantity = self.get(parameter.quantity)
        if quantity is None or not quantity.derived:
            return None
        return quantity.piece(parameter, buffer, context)


@cache
def catalogue() -> Catalogue:
    """Catalogue of all installed quantities.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """
    found = list(OWN)
    for module in extensions(GROUP):
        types = [thing for thing in public(module) if isinstance(thing, type)]
        # An abstract base without an id is no quantity.
        found += [t for t in types if issubclass(t, Quantity) and "id" in dir(t)]
    return Catalogue(cls() for cls in found)
