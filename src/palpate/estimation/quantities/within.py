"""Requested half widths of 95 % intervals, and their fulfilment.

`--within mass=1g` requests 95 % intervals of every mass with a half width of 1 g. Repetition narrows the part of
the interval that is noise. The part shared by all measurements, such as a sensor's gain, is a floor.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Z95, Estimate
from palpate.estimation.quantities.catalogue import catalogue

UNITS: Mapping[str, Mapping[str, float]] = {
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "N/m": {"N/m": 1.0, "kN/m": 1e3},
    "1": {"": 1.0},
}
"""Units in which a width may be given, by SI unit."""
NEAR_FLOOR = 1.1
"""Largest ratio of an interval to its floor that counts as at the floor: more work would narrow it by a tenth at
most."""
SPARE = 0.9
"""Fraction of the permitted noise that plans aim at, because predictions are not exact."""
DECISIVE = 3.0
"""Ratio of the one-sided limit's distance from a bound to the requested half width. The bound is then excluded unless
the value is in the lower third."""
JOINT = re.compile(r"joint \d+$")
CURES = {
    "arm": "; calibrate the arm to go below",
    "scene": "; the scene would have to say more to go below",
}
FORM = "give QUANTITY=VALUE, such as mass=1g"
NUMBER = re.compile(r"([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(.*)")

Outcome = Literal["reached", "floor", "rounds used up"]


@dataclass(frozen=True, slots=True)
class Precision:
    """Requested and reached precision of an estimate."""

    asked: float  # requested half width of the 95 % interval, in the estimate's unit
    reached: float  # present half width; infinite without a value
    floor: float  # half width in the limit of many repetitions
    cause: str = ""  # main cause of the floor, in words; empty without one
    of: str = ""  # owner of that cause, `arm` or `scene`

    @property
    def outcome(self) -> Outcome:
        """`reached`; `floor` if repetition does not narrow it further; else `rounds used up`."""
        if self.reached <= self.asked:
            return "reached"
        if self.reached <= NEAR_FLOOR * self.floor:
            return "floor"
        return "rounds used up"

    def in_words(self, unit: str) -> str:
        """Describe the outcome in one sentence for people."""
        # One sentence for each outcome; at the floor, the cause and its cure.
        asked, reached = format_width(self.asked, unit), format_width(self.reached, unit)
        if self.outcome == "reached":
            return f"Within {asked} was asked: {reached} is reached."
        if self.outcome == "floor":
            cure = CURES.get(self.of, "")
            floor = format_width(self.floor, unit)
            return (
                f"Within {asked} was asked: {reached} is reached, at the floor of {floor} "
                f"({self.cause}){cure}."
            )
        return f"Within {asked} was asked: {reached} is reached, and more work would narrow it."

    @property
    def further_std(self) -> float:
        """1 sigma of noise permitted for further work.

        Combined with the present estimate, the interval then becomes as narrow as requested, or as possible.
        """
        present, wanted = self._noise, noise_std(self.asked, self.floor / Z95)
        if wanted >= present:
            return present
        # Precisions (inverse variances) add.
        return 1.0 / math.sqrt(wanted**-2 - present**-2)

    def further(self, times: int) -> int:
        """Number of further repetitions after `times`, at least one: the std of a mean falls with its square root."""
        wanted = noise_std(self.asked, self.floor / Z95)
        return max(1, math.ceil(times * ((self._noise / wanted) ** 2 - 1.0)))

    @property
    def _noise(self) -> float:
        """1 sigma of the part that repetition narrows."""
        return math.sqrt(max(self.reached**2 - self.floor**2, 0.0)) / Z95


@dataclass(frozen=True, slots=True)
class Within:
    """Half widths of 95 % intervals, in SI units, by quantity or by parameter."""

    widths: tuple[tuple[str, float], ...] = ()

    @classmethod
    def read(cls, asked: Any) -> Within:
        """Parse a request.

        It is a mapping `{"mass": "1g", "bottle.height": 0.001}`, a comma list `"mass=1g, com=2mm"`, or several of
        these.

        Raises:
            InputError: The form is wrong, the quantity or unit is unknown, or the number is not positive; the message
                lists the valid ones.
        """
        # A mapping, or a list of NAME=VALUE entries.
        listed = asked.split(",") if isinstance(asked, str) else asked
        entries: dict[str, Any] = {}
        if isinstance(listed, Mapping):
            entries |= {str(name): value for name, value in cast("Any", listed).items()}
        elif not isinstance(listed, Iterable):
            raise InputError(f"within={asked}: {FORM}")
        else:
            for entry in (part for text in cast("Any", listed) for part in str(text).split(",")):
                name, equals, value = (part.strip() for part in entry.partition("="))
                if not (name and equals and value):
                    raise InputError(f"within={entry.strip()}: {FORM}")
                entries[name] = value
        return cls(tuple((name, parse_width(name, value)) for name, value in entries.items()))

    def __bool__(self) -> bool:
        return bool(self.widths)

    def __iter__(self) -> Iterator[tuple[str, float]]:
        return iter(self.widths)

    def of(self, parameter: Parameter) -> float | None:
        """Requested half width of a parameter, else of its quantity; None if there is none."""
        widths = dict(self.widths)
        return widths.get(str(parameter), widths.get(parameter.quantity))

    def check(self, names: Collection[str]) -> None:
        """Check that all named objects exist.

        Raises InputError: an object is none of `names`; the message lists them.
        """
        for name, _ in self.widths:
            object = name.rpartition(".")[0]
            if object and object not in names:
                raise unknown_name("object in within=", object, names)

    def unused(self, measured: Iterable[Parameter]) -> str:
        """Sentence on the widths that concern no `measured` parameter; empty without any."""
        names = {name for one in measured for name in (str(one), one.quantity)}
        unused = ", ".join(name for name, _ in self.widths if name not in names)
        return (
            f"The width within={unused} has no effect: nothing like that is measured."
            if unused
            else ""
        )

    def precision(self, estimate: Estimate) -> Precision | None:
        """Precision of the widest component; None without a request.

        Components without evidence do not count, because repetition does not narrow them.
        """
        asked = self.of(estimate.parameter)
        if asked is None:
            return None
        if not estimate.has_value:
            return Precision(asked, math.inf, 0.0)
        # Widest component that repetition can narrow, and its floor: the errors shared by all runs.
        half = (estimate.intervals[:, 1] - estimate.intervals[:, 0]) / 2.0
        narrowable = np.delete(np.arange(len(half)), estimate.unseen)
        candidates = narrowable if len(narrowable) else np.arange(len(half))
        widest = int(candidates[half[candidates].argmax()])
        floor = Z95 * float(estimate.shared_std[widest])
        # Find the main cause: squares by cause and owner; causes that differ only in the joint are added.
        squares: dict[tuple[str, str], float] = {}
        for shared in estimate.shared:
            kind = JOINT.sub("the joints", shared.cause), shared.of
            squares[kind] = squares.get(kind, 0.0) + shared.effect[widest] ** 2
        cause, owner = max(squares, key=lambda kind: squares[kind], default=("", ""))
        return Precision(asked, float(half[widest]), floor, cause, owner)

    def told(self, estimate: Estimate) -> Estimate:
        """Add the outcome of a requested width to the method; without a request, add advice."""
        precision = self.precision(estimate)
        if precision is None or not estimate.has_value:
            return advised(estimate)
        return replace(estimate, method=f"{estimate.method} {precision.in_words(estimate.unit)}")


def advised(estimate: Estimate) -> Estimate:
    """Add advice to the reason of an estimate at a bound: the width that would exclude the bound."""
    # Only a scalar at a bound gets advice.
    limit = estimate.limits[0] if len(estimate.values) == 1 else None
    bound = estimate.at_bound[0] if limit is not None else None
    if limit is None or bound is None:
        return estimate
    # Half width that would exclude the bound, against the floor of repetition.
    name, asked = str(estimate.parameter), abs(limit - bound.at) / DECISIVE
    precision = Within(((name, asked),)).precision(estimate)
    assert precision is not None
    width, floor = (
        format_width(one, estimate.unit).replace(" ", "") for one in (asked, precision.floor)
    )
    if precision.floor < asked:
        times = 1 + precision.further(1)
        advice = f"about {times} times the work tells it from there (--within {name}={width})"
    else:
        cure = CURES.get(precision.of, "")
        advice = f"however often it is measured, ± {floor} remain ({precision.cause}){cure}"
    return replace(estimate, reason=f"{estimate.reason}; {advice}")


def noise_std(width: float, floor: float) -> float:
    """1 sigma of permitted noise for a half width `width` of the 95 % interval, with a `floor` (1 sigma).

    If the floor is larger, the noise is that of an interval at its floor.
    """
    aim = max(width / Z95, NEAR_FLOOR * floor)
    return SPARE * math.sqrt(aim**2 - floor**2)


def format_width(width: float, unit: str) -> str:
    """Format a width in a suitable unit: `0.0009` kg is `0.9 g`."""
    if not math.isfinite(width):
        return "any"
    scales = sorted(UNITS.get(unit, {unit: 1.0}).items(), key=lambda scale: scale[1])
    name, size = next((scale for scale in reversed(scales) if width >= 0.1 * scale[1]), scales[0])
    return f"{width / size:.2g} {name}".rstrip()


def parse_width(name: str, value: str | float) -> float:
    """Parse the width requested for `name`, a quantity or a parameter, to SI units."""
    # Quantity of the name, and the units of its width.
    id = name.rpartition(".")[2]
    quantity = catalogue().get(id)
    if quantity is None:
        hint, meant = "Give within=mass=1g", catalogue().meant(id)
        raise unknown_name("quantity in within=", name, catalogue(), hint, meant)
    units = UNITS.get(quantity.unit, {quantity.unit: 1.0})
    found = NUMBER.fullmatch(str(value).strip())
    try:
        number, unit = float(found[1]) if found else math.nan, found[2] if found else ""
    except ValueError:
        number, unit = math.nan, ""
    if not (0.0 < number < math.inf):
        listed = ", ".join(units)
        raise InputError(
            f"within={name}={value}: give a positive number, with a unit of {listed} or in {quantity.unit}"
        )
    if unit and unit not in units:
        raise unknown_name(f"unit of {quantity.id}", unit, units)
    return number * units.get(unit, 1.0)
