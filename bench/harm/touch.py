"""How hard a thing was touched, from what a `Witness` saw of the contacts, and how hard it may be.

Sources of the figures: 65 N is ISO/TS 15066's quasi-static limit for the face, its lowest; the
others are this project's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.harm.witness import Pair, Witness
from palpate.geometry.pose import Array
from palpate.trace.samples import STANDARD_GRAVITY

OVER = 65.0
"""N: how long a force is above it is counted."""
TAIL = 0.1
"""s after the first contact from which on what still presses is the tail."""
APART = 0.05
"""s without a contact: the next one is another."""
LIGHT = 1.5
"""kg up to which an object gives way sideways; a heavier one counts as fixed."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Most that a contact may reach, N.

    Attributes:
        mean10, mean20: of running means over 10 and 20 ms.
        tail: of a 10 ms mean from 100 ms after the first contact on, None for no limit.
        sideways: 10 ms mean on light, free objects.
    """

    mean10: float = 65.0
    mean20: float = 45.0
    tail: float | None = None
    sideways: float = 25.0


SHOWN = Figures()
"""For what the scene shows."""
UNSEEN = Figures(mean10=180.0, mean20=150.0, tail=25.0, sideways=180.0)
"""For what no scene shows."""
CAUTIOUS = Figures(tail=25.0)
"""For what no scene shows, met by a cautious arm: what holds for shown things, and the tail."""
CAUTIOUS_RIGID = Figures(mean10=80.0, tail=25.0)
"""Likewise, where the contact has a stiffness of 10⁶ N/m or more."""


@dataclass(frozen=True, slots=True)
class Touch:
    """One thing that was touched, by the robot or by what it held; forces in N, times in s.

    Attributes:
        part: the body that pressed hardest.
        load: it was the held object.
        light: the thing is an object that gives way.
        first: when.
        seconds: how long in all.
        peak, mean10, mean20: magnitudes, of one physics step and of running means.
        tail: see `Figures`.
        over: s above 65 N.
        sideways: greatest horizontal 10 ms mean while nothing held the thing from the other side.
        vertical: the greatest force was more vertical than horizontal.
    """

    thing: str
    part: str
    load: bool
    light: bool
    first: float
    seconds: float
    peak: float
    mean10: float
    mean20: float
    tail: float
    over: float
    sideways: float
    vertical: bool

    def beyond(self, figures: Figures) -> Iterator[str]:
        """Every figure that is exceeded, in words."""
        who = f"{self.part} on {self.thing}"
        if self.mean10 > figures.mean10:
            yield f"{who}: {self.mean10:.0f} N over 10 ms"
        if self.mean20 > figures.mean20:
            yield f"{who}: {self.mean20:.0f} N over 20 ms"
        if figures.tail is not None and self.tail > figures.tail:
            yield f"{who}: {self.tail:.0f} N after 100 ms"
        if self.light and self.sideways > figures.sideways:
            yield f"{who}: {self.sideways:.0f} N sideways over 10 ms"


def touches(witness: Witness) -> tuple[Touch, ...]:
    """Everything that was touched, the hardest first."""
    pairs: dict[str, list[Pair]] = {}
    for pair in witness.forces:
        pairs.setdefault(pair.thing, []).append(pair)
    found = [_touch(witness, thing, of_thing) for thing, of_thing in pairs.items()]
    return tuple(sorted(found, key=lambda touch: -touch.mean10))


def _touch(witness: Witness, thing: str, pairs: list[Pair]) -> Touch:
    """All pairs with one thing as one contact: magnitudes of different parts add up."""
    magnitude, sideways = np.zeros(witness.steps + 1), np.zeros(witness.steps + 1)
    hardest, strongest, upright = pairs[0], -1.0, True
    for pair in pairs:
        steps, vectors = witness.forces[pair].rows()
        if pair.load:
            vectors = _without_weight(vectors, _weight(witness, pair.part))
        size, horizontal = np.linalg.norm(vectors, axis=1), np.hypot(vectors[:, 0], vectors[:, 1])
        magnitude[steps] += size
        free = ~np.isin(steps, list(witness.forces[pair].blocked))
        sideways[steps[free]] += horizontal[free]
        if size.max() > strongest:
            worst = int(size.argmax())
            hardest, strongest = pair, float(size[worst])
            upright = bool(abs(vectors[worst, 2]) > horizontal[worst])
    touching = np.flatnonzero(magnitude)
    dt = witness.period
    mean10 = _running(magnitude, 0.010, dt)
    return Touch(
        thing,
        hardest.part,
        hardest.load,
        _is_light(witness, thing),
        float(touching[0] * dt) if len(touching) else 0.0,
        float(len(touching) * dt),
        float(magnitude.max()),
        float(mean10.max()),
        float(_running(magnitude, 0.020, dt).max()),
        _tail(magnitude, mean10, dt),
        float((magnitude > OVER).sum() * dt),
        float(_running(sideways, 0.010, dt).max()),
        upright,
    )


def _weight(witness: Witness, name: str) -> float:
    return STANDARD_GRAVITY * witness.masses[witness.objects.index(name)]


def _without_weight(vectors: Array, weight: float) -> Array:
    """Forces (n, 3) without what the object presses by merely standing there."""
    pressed = vectors.copy()
    pressed[:, 2] = np.minimum(pressed[:, 2] + weight, np.maximum(pressed[:, 2], 0.0))
    return pressed


def _is_light(witness: Witness, thing: str) -> bool:
    if thing not in witness.objects:
        return False
    return witness.masses[witness.objects.index(thing)] <= LIGHT


def _running(values: Array, window: float, dt: float) -> Array:
    """Means over every `window` s, by where the window begins."""
    width = round(window / dt)
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([values, np.zeros(width)]))])
    return (sums[width:] - sums[:-width]) / width


def _tail(magnitude: Array, mean10: Array, dt: float) -> float:
    """The greatest 10 ms mean that begins 100 ms or more after the first touch of a contact."""
    touching = np.flatnonzero(magnitude)
    if not len(touching):
        return 0.0
    breaks = np.flatnonzero(np.diff(touching) * dt > APART)
    starts = np.concatenate([touching[:1], touching[breaks + 1]])
    ends = np.concatenate([touching[breaks], touching[-1:]])
    worst = 0.0
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        late = mean10[start + round(TAIL / dt) : end + 1]
        worst = max(worst, float(late.max(initial=0.0)))
    return worst
