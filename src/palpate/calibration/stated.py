"""Reference values with their tolerance, parsed from text: `0.5kg±0.1g`, `50mm+-0.01mm`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from palpate.errors import InputError

MASS: Mapping[str, float] = {"kg": 1.0, "g": 1e-3, "mg": 1e-6}
LENGTH: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
NUMBER = r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-zµ]*)\s*"
STATED = re.compile(rf"{NUMBER}(?:(?:±|\+-|\+/-){NUMBER})?")


@dataclass(frozen=True, slots=True)
class Stated:
    """Value within limits, in SI units.

    Attributes:
        value: nominal value.
        limit: largest deviation from it, as on the certificate of a weight or a gauge block.
        text: as written.
    """

    value: float
    limit: float
    text: str

    @property
    def std(self) -> float:
        """Standard deviation of a uniform distribution within the limits (GUM, JCGM 100:2008, 4.3.7)."""
        return self.limit / math.sqrt(3.0)


def stated(text: str, units: Mapping[str, float], what: str) -> Stated:
    """Parse `text`. Without a unit a number is in SI units, without a tolerance it is exact.

    Raises:
        InputError: not of that form; the message names `what` and gives an example.
    """
    example = "0.5kg±0.1g" if "kg" in units else "50mm±0.01mm"
    refusal = InputError(
        f"{what} '{text}' is no size with a unit: give e.g. {example}, in {', '.join(units)}"
    )
    found = STATED.fullmatch(text)
    if found is None:
        raise refusal
    value, unit, limit, limit_unit = found.groups()
    if any(name and name not in units for name in (unit, limit_unit)):
        raise refusal
    try:
        size = float(value) * units.get(unit, 1.0)
        # A tolerance without a unit is in the unit of the value.
        off = float(limit) * units.get(limit_unit or unit, 1.0) if limit else 0.0
    except ValueError:
        raise refusal from None
    if not (0.0 < size < math.inf and off < size):
        raise refusal
    return Stated(size, off, text.strip())


@dataclass(frozen=True, slots=True)
class Known:
    """Reference in the scene: `[NAME=]SIZE`.

    Attributes:
        size: its known mass or height.
        name: its name in the scene; None where there is only one candidate.
    """

    size: Stated
    name: str | None = None

    @classmethod
    def of(cls, text: str, units: Mapping[str, float], what: str) -> Known:
        """Parse a reference; raises InputError as `stated` does."""
        name, found, size = text.rpartition("=")
        return cls(stated(size, units, what), name.strip() if found else None)
