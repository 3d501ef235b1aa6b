"""Catalogue of quantities, and the quantities that each purpose of a simulation needs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

from palpate.common.extensions import Registry, iter_entry_points
from palpate.common.parameter import Parameter
from palpate.estimation.quantities.com import CentreOfMass, CentreOfMassInSpace
from palpate.estimation.quantities.fixture_dynamics import Damping, DryFriction, SpringStiffness
from palpate.estimation.quantities.fixture_range import Range
from palpate.estimation.quantities.friction import Friction
from palpate.estimation.quantities.height import Height, SurfaceTilt
from palpate.estimation.quantities.inertia import Inertia
from palpate.estimation.quantities.mass import Mass
from palpate.estimation.quantities.motion import Momentum, Velocity
from palpate.estimation.quantities.position import Position
from palpate.estimation.quantities.quantity import Piece, Quantity
from palpate.estimation.quantities.size import Size
from palpate.estimation.quantities.stiffness import ContactDamping, Restitution, Stiffness
from palpate.trace.recording import Context

GROUP = "palpate.quantities"
"""Entry-point group of modules; every public `Quantity` in them that has an id is included."""
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
    SurfaceTilt,
    DryFriction,
    Damping,
    SpringStiffness,
    Range,
)
"""Order of the results and of the priors: a prior may use the believed values of earlier quantities."""


class Catalogue(Registry[Quantity]):
    """Quantities by id, in their order."""

    kind = "quantity"

    def __init__(self, quantities: Iterable[Quantity]) -> None:
        super().__init__([(quantity.id, quantity) for quantity in quantities])

    def named(self, name: str, hint: str = "", intended: str | None = None) -> Quantity:
        """Return the quantity with this id; for a synonym the error suggests the id."""
        return super().named(name, hint, intended or self.meant(name))

    def meant(self, word: str) -> str | None:
        """Return the id of the quantity that a word denotes in any language; None for other words."""
        for quantity in self.values():
            if any(word.lower() in words for words in quantity.words.values()):
                return quantity.id
        return None

    def of(self, subject: str) -> list[Quantity]:
        """Return the quantities of one kind of subject."""
        return [quantity for quantity in self.values() if quantity.subject == subject]

    def piece(self, parameter: Parameter, buffer: str, context: Context) -> Piece | None:
        """Return the piece of evidence that a recording is for a derived parameter.

        Returns None if it is no evidence, or if a conversion primitive has to declare it.
        """
        quantity = self.get(parameter.quantity)
        if quantity is None or not quantity.derived:
            return None
        return quantity.piece(parameter, buffer, context)


@cache
def catalogue() -> Catalogue:
    """Catalogue of all installed quantities.

    Raises InputError: the module of an entry point cannot be loaded; the message names it.
    """
    # Abstract bases have no id, and are skipped.
    types = (part for part in iter_entry_points(GROUP) if isinstance(part, type))
    others = (cls for cls in types if issubclass(cls, Quantity) and "id" in dir(cls))
    return Catalogue(cls() for cls in (*OWN, *others))


# Purposes of a simulation and the quantities that each needs: one table for the prompt of a model, the reading
# of requests and the documentation


SHOWN = 3
"""Number of verbs of a purpose in a prompt."""


@dataclass(frozen=True, slots=True)
class Purpose:
    """Purpose of a simulation."""

    verbs: tuple[str, ...]  # English verbs for it, the most common first
    quantities: tuple[str, ...]  # ids of the object's quantities that determine its outcome
    reason: str  # physical reason, for the documentation

    def __str__(self) -> str:
        return f"to {'/'.join(self.verbs[:SHOWN])}: {', '.join(self.quantities)}"


def _purpose(verbs: str, quantities: str, reason: str) -> Purpose:
    return Purpose(tuple(verbs.split()), tuple(quantities.split()), reason)


PURPOSES = (
    _purpose(
        "lift carry grasp grip place raise pick transport hold fetch hoist move put bring hand pass",
        "mass",
        "the weight on the hand",
    ),
    _purpose("slide push drag pull shove", "mass friction", "the resistance of the support"),
    _purpose("roll", "mass friction inertia", "the resistance of the support, and to turning"),
    _purpose("stack pile", "mass friction com", "the load, and where it stands over its support"),
    _purpose(
        "topple tip tilt lean balance stand knock",
        "mass com_3d",
        "the edge over which the weight turns, and how high it is",
    ),
    _purpose("pour", "mass friction com_3d", "the torque on a grip that turns about a level axis"),
    _purpose(
        "throw drop swing toss juggle spin rotate turn flip catch twirl",
        "mass com inertia",
        "the motion of a free body about its centre of mass",
    ),
    _purpose("press squeeze indent", "stiffness", "the yielding under a force"),
)
"""All purposes; each verb occurs in one of them only."""


def quantities_by_verb() -> Mapping[str, tuple[str, ...]]:
    """Quantities of each purpose, by each of its verbs."""
    return {verb: purpose.quantities for purpose in PURPOSES for verb in purpose.verbs}
