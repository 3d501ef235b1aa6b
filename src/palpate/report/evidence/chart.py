"""A small chart: everything in per cent of its area, so that a page can draw it at any width."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.geometry.pose import Array
from palpate.report.numbers import Axis

POINTS = 400
"""Of a line: its shape on a wide screen."""
TICKS = 5
"""Numbers beside an axis, about."""


@dataclass(frozen=True, slots=True)
class Tick:
    at: float
    text: str


@dataclass(frozen=True, slots=True)
class Band:
    """A shaded box; `kind` says what it stands for, as that of the others does."""

    kind: str
    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Line:
    kind: str
    points: str


@dataclass(frozen=True, slots=True)
class Dot:
    """With one standard deviation to either side."""

    kind: str
    x: float
    y: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Note:
    """Words at a place."""

    kind: str
    x: float
    y: float
    text: str


@dataclass(frozen=True, slots=True)
class Chart:
    """Chart with its caption; `legend` maps kinds to words."""

    title: str
    said: str
    x_label: str
    y_label: str
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    bands: tuple[Band, ...]
    lines: tuple[Line, ...]
    dots: tuple[Dot, ...]
    notes: tuple[Note, ...]
    legend: tuple[tuple[str, str], ...]


@dataclass(slots=True)
class Sheet:
    """A chart in the making, in its own units: `x` and `y` are the ends of its axes."""

    x: tuple[float, float]
    y: tuple[float, float]
    bands: list[Band] = field(default_factory=list[Band])
    lines: list[Line] = field(default_factory=list[Line])
    dots: list[Dot] = field(default_factory=list[Dot])
    notes: list[Note] = field(default_factory=list[Note])

    def band(self, kind: str, x: tuple[float, float], y: tuple[float, float] | None = None) -> None:
        """A box, of the whole height unless `y` is given."""
        low, high = y or self.y
        left, right = (self._across(end) for end in x)
        top, bottom = (min(max(self._down(end), 0.0), 100.0) for end in (high, low))
        self.bands.append(Band(kind, left, top, round(right - left, 2), round(bottom - top, 2)))

    def line(self, kind: str, x: Array, y: Array) -> None:
        """A curve, with the means of blocks where it has many points."""
        blocks = np.array_split(np.arange(len(x)), min(len(x), POINTS))
        pairs = [(float(x[rows].mean()), float(y[rows].mean())) for rows in blocks if len(rows)]
        points = " ".join(f"{self._across(a):g},{self._down(b):g}" for a, b in pairs)
        self.lines.append(Line(kind, points))

    def level(self, kind: str, y: float, x: tuple[float, float] | None = None) -> None:
        """A horizontal line."""
        ends = np.array(x or self.x)
        self.line(kind, ends, np.array([y, y]))

    def dot(self, kind: str, x: float, y: float, std: float = 0.0) -> None:
        places = (self._down(y), self._down(y - std), self._down(y + std))
        self.dots.append(Dot(kind, self._across(x), *places))

    def note(self, kind: str, x: float, y: float, text: str) -> None:
        down = min(max(self._down(y), 8.0), 100.0)
        self.notes.append(Note(kind, self._across(x), down, text))

    def chart(
        self, title: str, said: str, axes: tuple[str, str], legend: Sequence[tuple[str, str]]
    ) -> Chart:
        """The finished chart; `axes` names them."""
        return Chart(
            title,
            said,
            *axes,
            tuple(Tick(self._across(at), text) for at, text in _ticks(*self.x)),
            tuple(Tick(self._down(at), text) for at, text in _ticks(*self.y)),
            tuple(self.bands),
            tuple(self.lines),
            tuple(self.dots),
            tuple(self.notes),
            tuple(legend),
        )

    def _across(self, value: float) -> float:
        return Axis(*self.x).per_cent(value)

    def _down(self, value: float) -> float:
        low, high = self.y
        # Far outside is as good as outside, and browsers dislike huge numbers.
        return min(max(Axis(high, low).per_cent(value), -1e4), 1e4)


def span(values: Array, air: float = 0.12) -> tuple[float, float]:
    """Ends of an axis that holds all `values`, with some air."""
    axis = Axis.around(values, air)
    return axis.low, axis.high


def _ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Round numbers between two ends."""
    raw = (high - low) / TICKS
    base = 10.0 ** math.floor(math.log10(raw))
    step = next(base * factor for factor in (1, 2, 5, 10) if base * factor >= raw)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    numbers = [step * i for i in range(first, last + 1)]
    return [(number, f"{number:.{decimals}f}".replace("-", "−")) for number in numbers]
