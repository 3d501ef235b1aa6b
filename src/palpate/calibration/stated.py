"""Parser of a reference value with tolerance: `0.5kg±0.1g`, `50mm+-0.01mm`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from palpate.errors import InputError

MASS: Mapping[str, float] = {"kg": 1.0, "g": 1e-3, "mg": 1e-6}
LENGTH: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_NUMBER = r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-zµ]*)\s*"
_STATED = re.compile(rf"{_NUMBER}(?:(?:±|\+-|\+/-){_NUMBER})?")


@dataclass(frozen=True, slots=True)
class Stated:
    """A value within limits, in SI units.

    Attributes:
        value: the nominal value.
        limit: how far it may be off at most, as on a weight's or a gauge block's certificate.
        text: as it was written.
    """

    value: float
    limit: float
    text: str

    @property
    def std(self) -> float:
        """Of a uniform distribution within the limits (GUM, JCGM 100:2008, 4.3.7)."""
        return self.limit / math.sqrt(3.0)


def stated(text: str, units: Mapping[str, float], what: str) -> Stated:
    """Parse `text`; a number without a unit is in SI units, without a tolerance it is
    exact.

    Raises:
        InputError: not of that form; the message says what `what` looks like.
    """
    found = _STATED.fullmatch(text)
    if found is None:
        raise _not_stated(text, units, what)
    value, unit, limit, limit_unit = found.groups()
    for name in (unit, limit_unit):
        if name and name not in units:
            raise _not_stated(text, units, what)
    try:
        size = float(value) * units.get(unit, 1.0)
        off = float(limit) * units.get(limit_unit or unit, 1.0) if limit else 0.0
    except ValueError:
        raise _not_stated(text, units, what) from None
    if not (0.0 < size < math.inf and off < size):
        raise _not_stated(text, units, what)
    return Stated(size, off, text.strip())


def _not_stated(text: str, units: Mapping[str, float], what: str) -> InputError:
    example = "0.5kg±0.1g" if "kg" in units else "50mm±0.01mm"
    return InputError(
        f"{what} '{text}' is no size with a unit: give e.g. {example}, in {', '.join(units)}"
    )


@dataclass(frozen=True, slots=True)
class Known:
    """Something in the scene that somebody knows: `[NAME=]SIZE`.

    Attributes:
        size: what is known of it.
        name: what the scene calls it; None where that is clear.
    """

    size: Stated
    name: str | None = None

    @classmethod
    def of(cls, text: str, units: Mapping[str, float], what: str) -> Known:
        """Raises InputError as `stated` does."""
        name, found, size = text.rpartition("=")
        return cls(stated(size, units, what), name.strip() if found else None)
