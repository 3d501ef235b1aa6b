"""Requested half widths of 95 % intervals, and their fulfilment.

`--within mass=1g` asks for a 95 % interval of every mass that reaches 1 g to either side. Repeating a
measurement narrows what is noise; what other measurements share, such as a sensor's gain, is a floor
that no repetition goes below.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.estimation.estimate import Z95, Estimate
from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue

UNITS: Mapping[str, Mapping[str, float]] = {
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "N/m": {"N/m": 1.0, "kN/m": 1e3},
    "1": {"": 1.0},
}
"""In which a width may be given, by SI unit."""
NEAR_FLOOR = 1.1
"""An interval that is wider than what no repetition narrows by no more than this factor is at its
floor: all further work together would narrow it by a tenth."""
SPARE = 0.9
"""Part of the noise that may be left, at which work aims: what is foreseen is not quite what comes."""
JOINT = re.compile(r"joint \d+$")
CURES = {
    "arm": "; calibrate the arm to go below",
    "scene": "; the scene would have to say more to go below",
}
NUMBER = re.compile(r"([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(.*)")

Outcome = Literal["reached", "floor", "rounds used up"]


@dataclass(frozen=True, slots=True)
class Precision:
    """Requested and reached precision of an estimate.

    Attributes:
        asked, reached, floor: half widths of the 95 % interval in the estimate's unit: as asked, as
            it is (infinite without a value), and what would be left after any number of
            repetitions.
        cause: what sets the floor most, in words; empty where nothing does.
        of: whose it is, the `arm`'s or the `scene`'s.
    """

    asked: float
    reached: float
    floor: float
    cause: str = ""
    of: str = ""

    @property
    def outcome(self) -> Outcome:
        """`reached`; `floor`, where repetition would not narrow it further; else `rounds used
        up`."""
        if self.reached <= self.asked:
            return "reached"
        if self.reached <= NEAR_FLOOR * self.floor:
            return "floor"
        return "rounds used up"

    def in_words(self, unit: str) -> str:
        """A sentence for people."""
        asked, reached = shown(self.asked, unit), shown(self.reached, unit)
        if self.outcome == "reached":
            return f"Within {asked} was asked: {reached} is reached."
        if self.outcome == "floor":
            cure = CURES.get(self.of, "")
            floor = shown(self.floor, unit)
            return (
                f"Within {asked} was asked: {reached} is reached, at the floor of {floor} "
                f"({self.cause}){cure}."
            )
        return f"Within {asked} was asked: {reached} is reached, and more work would narrow it."

    @property
    def further_std(self) -> float:
        """1 sigma that the noise of further work alone may leave, so that with what there is the
        interval becomes as narrow as asked, or as it can be."""
        present, wanted = self._noise, self._wanted
        if wanted >= present:
            return present
        return 1.0 / math.sqrt(wanted**-2 - present**-2)

    def further(self, times: int) -> int:
        """Number of further repetitions after `times`, at least one: the std of a mean falls with
        the root of their number."""
        return max(1, math.ceil(times * ((self._noise / self._wanted) ** 2 - 1.0)))

    @property
    def _noise(self) -> float:
        """1 sigma of what repetition narrows, as it is."""
        return math.sqrt(max(self.reached**2 - self.floor**2, 0.0)) / Z95

    @property
    def _wanted(self) -> float:
        """1 sigma of it, as it is to be."""
        return noise_std(self.asked, self.floor / Z95)


@dataclass(frozen=True, slots=True)
class Within:
    """Half widths of 95 % intervals, in SI units, by quantity or by parameter."""

    widths: tuple[tuple[str, float], ...] = ()

    @classmethod
    def read(cls, asked: Mapping[str, str | float]) -> Within:
        """From `{"mass": "1g", "bottle.height": 0.001}`.

        Raises:
            InputError: no such quantity or unit, or no positive number; the message lists the valid
                ones.
        """
        return cls(tuple((name, _width(name, value)) for name, value in asked.items()))

    def __bool__(self) -> bool:
        return bool(self.widths)

    def __iter__(self) -> Iterator[tuple[str, float]]:
        return iter(self.widths)

    def of(self, parameter: Parameter) -> float | None:
        """Requested half width of a parameter, by its own name before that of its quantity; None if
        there is none."""
        widths = dict(self.widths)
        return widths.get(str(parameter), widths.get(parameter.quantity))

    def check(self, names: Collection[str]) -> None:
        """Look whether what it names is there.

        Raises:
            InputError: an object that is none of `names`; the message lists them.
        """
        for name, _ in self.widths:
            object = name.rpartition(".")[0]
            if object and object not in names:
                raise unknown_name("object in within=", object, names)

    def precision(self, estimate: Estimate) -> Precision | None:
        """Precision of the widest component; None without a request.

        A component that no recording says anything of is no matter of width: nobody can narrow it.
        """
        asked = self.of(estimate.parameter)
        if asked is None:
            return None
        if not estimate.has_value:
            return Precision(asked, math.inf, 0.0)
        half = (estimate.intervals[:, 1] - estimate.intervals[:, 0]) / 2.0
        narrowable = np.delete(np.arange(len(half)), estimate.unseen)
        candidates = narrowable if len(narrowable) else np.arange(len(half))
        widest = int(candidates[half[candidates].argmax()])
        floor = Z95 * float(estimate.shared_std[widest])
        return Precision(asked, float(half[widest]), floor, *_cause(estimate, widest))

    def told(self, estimate: Estimate) -> Estimate:
        """The estimate; where something was asked of it, its method says what came of that."""
        precision = self.precision(estimate)
        if precision is None or not estimate.has_value:
            return estimate
        return replace(estimate, method=f"{estimate.method} {precision.in_words(estimate.unit)}")


def noise_std(width: float, floor: float) -> float:
    """1 sigma that noise may leave beside a `floor` (1 sigma), so that a 95 % interval reaches no
    farther than `width` to either side, or is at its floor."""
    aim = max(width / Z95, NEAR_FLOOR * floor)
    return SPARE * math.sqrt(aim**2 - floor**2)


def _cause(estimate: Estimate, component: int) -> tuple[str, str]:
    """Main cause of a component's floor, and its owner; causes that differ only in the joint are
    added."""
    squares: dict[tuple[str, str], float] = {}
    for shared in estimate.shared:
        kind = JOINT.sub("the joints", shared.cause), shared.of
        squares[kind] = squares.get(kind, 0.0) + shared.effect[component] ** 2
    return max(squares, key=lambda kind: squares[kind], default=("", ""))


def shown(width: float, unit: str) -> str:
    """A width for people, in a unit that suits it: `0.0009` kg is `0.9 g`."""
    if not math.isfinite(width):
        return "any"
    scales = sorted(UNITS.get(unit, {unit: 1.0}).items(), key=lambda scale: scale[1])
    name, size = next((scale for scale in reversed(scales) if width >= 0.1 * scale[1]), scales[0])
    return f"{width / size:.2g} {name}".rstrip()


def _width(name: str, value: str | float) -> float:
    """SI, of what is asked of `name`, a quantity or a parameter."""
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
