"""Parameter: an unknown quantity of a named object; containers with an entry for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

from palpate.common.errors import InputError, PalpateError

T = TypeVar("T")

_set = object.__setattr__


@dataclass(frozen=True, slots=True, order=True, init=False, repr=False)
class Parameter:
    """Unknown: a quantity of a named object of the scene.

    `Parameter("mug", "mass")` and `Parameter("mug.mass")` are equal. A name is split at its last dot, so
    that an object's name may contain dots itself.
    """

    object: str
    quantity: str

    def __init__(self, object: str, quantity: str | None = None) -> None:
        """Construct from two names, or from one with a dot. Raises InputError: a single name without a quantity."""
        if quantity is None:
            object, quantity = _split(object)
        _set(self, "object", object)
        _set(self, "quantity", quantity)

    def __str__(self) -> str:
        return f"{self.object}.{self.quantity}"

    def __repr__(self) -> str:
        return f"Parameter('{self}')"


class ByParameter(Generic[T]):
    """Container with one entry per parameter: `run["mug.mass"]`, `list(run)`, `len(run)`, `"mug.mass" in run`."""

    __slots__ = ()
    # Predicate for a name without an entry, before the list of names with one.
    _ABSENT: ClassVar[str] = "is in none of the runs; there is"

    def _entries(self) -> Mapping[Parameter, T]:
        raise NotImplementedError

    def __getitem__(self, name: str | Parameter) -> T:
        """Return the entry of a parameter.

        Raises KeyError: there is none; the message lists the parameters that have one.
        """
        wanted = Parameter(name) if isinstance(name, str) else name
        entries = self._entries()
        if wanted not in entries:
            raise KeyError(f"'{wanted}' {self._ABSENT} {', '.join(map(str, entries)) or 'nothing'}")
        return entries[wanted]

    def __iter__(self) -> Iterator[Parameter]:
        """Iterate over the parameters."""
        return iter(self._entries())

    def __len__(self) -> int:
        return len(self._entries())

    def __bool__(self) -> bool:
        """True even without an entry: `if run:` tests for a run."""
        return True

    def __contains__(self, name: object) -> bool:
        return str(name) in map(str, self._entries())


def _split(name: str) -> tuple[str, str]:
    owner, _, quantity = name.rpartition(".")
    if not owner or not quantity:
        raise InputError(f"'{name}' names no parameter: write OBJECT.QUANTITY, e.g. 'mug.mass'")
    return owner, quantity


class PlanRejected(PalpateError):
    """No plan exists for the request, or none passed the check. The text is the explanation.

    Attributes:
        proposal: parameters that the request may ask for, if some of its words were not understood;
            to be confirmed before use.
        not_used: those words.
        within: half widths of intervals that the request states, by quantity, as `1 g`.
    """

    def __init__(
        self,
        explanation: str,
        proposal: tuple[Parameter, ...] = (),
        not_used: tuple[str, ...] = (),
        within: tuple[tuple[str, str], ...] = (),
    ) -> None:
        super().__init__(explanation)
        self.proposal, self.not_used, self.within = proposal, not_used, within
