"""Parameter: an unknown quantity of a named object."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.errors import InputError

_set = object.__setattr__


@dataclass(frozen=True, slots=True, order=True, init=False, repr=False)
class Parameter:
    """Unknown: a quantity of a named object of the scene.

    `Parameter("mug", "mass")` and `Parameter("mug.mass")` are the same; a name is split at its last
    dot, so that an object's name may hold dots itself.
    """

    object: str
    quantity: str

    def __init__(self, object: str, quantity: str | None = None) -> None:
        """Construct from two names, or from one with a dot.

        Raises:
            InputError: a single name without a quantity.
        """
        if quantity is None:
            object, quantity = _split(object)
        _set(self, "object", object)
        _set(self, "quantity", quantity)

    def __str__(self) -> str:
        return f"{self.object}.{self.quantity}"

    def __repr__(self) -> str:
        return f"Parameter('{self}')"


def _split(name: str) -> tuple[str, str]:
    owner, _, quantity = name.rpartition(".")
    if not owner or not quantity:
        raise InputError(f"'{name}' names no parameter: write OBJECT.QUANTITY, e.g. 'mug.mass'")
    return owner, quantity
