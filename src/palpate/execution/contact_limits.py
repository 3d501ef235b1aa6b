"""Contact forces from a `Witness`, and their limits.

Sources of the limits: 65 N is ISO/TS 15066's quasi-static limit for the face, its lowest; the
others are this project's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array
from palpate.execution.witness import Pair, Witness
from palpate.trace.samples import STANDARD_GRAVITY

OVER = 65.0
"""N: the time above this force is counted."""
TAIL = 0.1
"""s after the first contact at which the tail begins."""
APART = 0.05
"""s without touch that separate two contacts."""
LIGHT = 1.5
"""kg: heavier objects count as fixed."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Limits of a contact, N.

    Attributes:
        mean10, mean20: of running means over 10 and 20 ms.
        tail: of 10 ms means from 100 ms after the first contact, None for no limit.
        sideways: 10 ms mean on light, free objects.
    """

    mean10: float = 65.0
    mean20: float = 45.0
    tail: float | None = None
    sideways: float = 25.0


SHOWN = Figures()
"""For things of the scene."""
UNSEEN = Figures(mean10=180.0, mean20=150.0, tail=25.0, sideways=180.0)
"""For things that the scene does not show."""


@dataclass(frozen=True, slots=True)
class ContactRecord:
    """Contact of a thing with the robot or the held object; forces in N, times in s.

    Attributes:
        part: the body with the largest force.
        load: that body is the held object.
        light: the thing is a free object of at most `LIGHT`.
        first: time of the first contact.
        seconds: duration of all contacts.
        peak, mean10, mean20: largest magnitude of one physics step and of running means.
        hardest: s, time of the largest 10 ms mean.
        tail: see `Figures`.
        over: s above 65 N.
        sideways: largest horizontal 10 ms mean while nothing supported the thing from the other side.
        vertical: the largest force was more vertical than horizontal.
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
    hardest: float
    tail: float
    over: float
    sideways: float
    vertical: bool

    def beyond(self, figures: Figures) -> Iterator[str]:
        """Exceeded limits, in words."""
        who = f"{self.part} on {self.thing}"
        if self.mean10 > figures.mean10:
            yield f"{who}: {self.mean10:.0f} N over 10 ms"
        if self.mean20 > figures.mean20:
            yield f"{who}: {self.mean20:.0f} N over 20 ms"
        if figures.tail is not None and self.tail > figures.tail:
            yield f"{who}: {self.tail:.0f} N after 100 ms"
        if self.light and self.sideways > figures.sideways:
            yield f"{who}: {self.sideways:.0f} N sideways over 10 ms"


def touches(witness: Witness) -> tuple[ContactRecord, ...]:
    """All contacts, the largest forces first."""
    pairs: dict[str, list[Pair]] = {}
    for pair in witness.forces:
        pairs.setdefault(pair.thing, []).append(pair)
    found = [_touch(witness, thing, of_thing) for thing, of_thing in pairs.items()]
    return tuple(sorted(found, key=lambda touch: -touch.mean10))


def _touch(witness: Witness, thing: str, pairs: list[Pair]) -> ContactRecord:
    """Combine all pairs with one thing to one contact: magnitudes of different parts add up."""
    magnitude, sideways = np.zeros(witness.steps + 1), np.zeros(witness.steps + 1)
    strongest_pair, strongest, upright = pairs[0], -1.0, True
    for pair in pairs:
        steps, vectors = witness.forces[pair].rows()
        if pair.load:
            mass = witness.masses[witness.objects.index(pair.part)]
            vectors = _without_weight(vectors, STANDARD_GRAVITY * mass)
        size, horizontal = np.linalg.norm(vectors, axis=1), np.hypot(vectors[:, 0], vectors[:, 1])
        magnitude[steps] += size
        free = ~np.isin(steps, list(witness.forces[pair].blocked))
        sideways[steps[free]] += horizontal[free]
        if size.max() > strongest:
            worst = int(size.argmax())
            strongest_pair, strongest = pair, float(size[worst])
            upright = bool(abs(vectors[worst, 2]) > horizontal[worst])
    touching = np.flatnonzero(magnitude)
    dt = witness.period
    mean10 = _running(magnitude, 0.010, dt)
    masses = dict(zip(witness.objects, witness.masses, strict=True))
    return ContactRecord(
        thing,
        strongest_pair.part,
        strongest_pair.load,
        light=masses.get(thing, np.inf) <= LIGHT,
        first=float(touching[0] * dt) if len(touching) else 0.0,
        seconds=float(len(touching) * dt),
        peak=float(magnitude.max()),
        mean10=float(mean10.max()),
        mean20=float(_running(magnitude, 0.020, dt).max()),
        hardest=float(mean10.argmax()) * dt,
        tail=_tail(magnitude, mean10, dt),
        over=float((magnitude > OVER).sum() * dt),
        sideways=float(_running(sideways, 0.010, dt).max()),
        vertical=upright,
    )


def _without_weight(vectors: Array, weight: float) -> Array:
    """Forces (n, 3) without the weight of an object that stands on the thing."""
    pressed = vectors.copy()
    pressed[:, 2] = np.minimum(pressed[:, 2] + weight, np.maximum(pressed[:, 2], 0.0))
    return pressed


def _running(values: Array, window: float, dt: float) -> Array:
    """Running means over `window` s, by the start of the window."""
    width = round(window / dt)
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([values, np.zeros(width)]))])
    return (sums[width:] - sums[:-width]) / width


def _tail(magnitude: Array, mean10: Array, dt: float) -> float:
    """Largest 10 ms mean that starts `TAIL` or more after the beginning of a contact."""
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
