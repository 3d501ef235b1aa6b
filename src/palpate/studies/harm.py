"""What a run did to its world, against what it may do: forces, falls and shoves, from a `Witness`.

Sources of the figures: 65 N is ISO/TS 15066's quasi-static limit for the face, its lowest; the
others are this project's own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.geometry.pose import Array
from palpate.studies.witness import LOOK, Mask, Witness

OVER = 65.0
"""N: how long a force is above it is counted."""
TAIL = 0.1
"""s after the first contact from which on what still presses is the tail."""
APART = 0.05
"""s without a contact: the next one is another."""
FALLEN = 0.013
"""m of free fall: 0.5 m/s."""
FALLING = 0.5
"""m/s downwards, unsupported."""
TIPPED = np.deg2rad(15)
"""rad from an object's first attitude, about any horizontal axis."""
MOVED = 0.005
"""m that something which the plan does not name may be moved."""
PUSHED = 0.025
"""m that anything may be pushed while it is not held."""
LEFT = 0.05
"""m below where it stood: an object is no longer on what carried it."""
STANDARD_GRAVITY = 9.81
"""m/s^2."""
LIGHT = 1.5
"""kg up to which an object gives way sideways; a heavier one counts as fixed."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Most that a contact may reach, N.

    Attributes:
        mean10, mean20: of running means over 10 and 20 ms. tail: of a 10 ms mean from 100 ms after
            the first contact on, None for no limit. sideways: 10 ms mean on light, free objects.
    """

    mean10: float = 65.0
    mean20: float = 45.0
    tail: float | None = None
    sideways: float = 25.0


SHOWN = Figures()
"""For what the scene shows."""
UNSEEN = Figures(mean10=180.0, mean20=150.0, tail=25.0, sideways=180.0)
"""For what no scene shows."""


@dataclass(frozen=True, slots=True)
class Touch:
    """One thing that was touched, by the robot or by what it held; forces in N, times in s.

    Attributes:
        part: the body that pressed hardest. load: it was the held object. light: the thing is an
            object that gives way.
        first: when. seconds: how long in all. peak, mean10, mean20: magnitudes, of one physics step
            and of running means. tail: see `Figures`. over: s above 65 N.
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


@dataclass(frozen=True, slots=True)
class Harm:
    """What became of the world.

    Attributes:
        touches: the hardest first. dropped, tipped, left: names of objects. moved: m that objects
            went which nobody named. pushed: m that objects went while not held.
        turned: rad that objects turned in the hand. beyond: everything that is worse than the
            figures allow, in words; empty is harmless.
    """

    touches: tuple[Touch, ...]
    dropped: tuple[str, ...]
    tipped: tuple[str, ...]
    left: tuple[str, ...]
    moved: dict[str, float]
    pushed: dict[str, float]
    turned: dict[str, float]
    beyond: tuple[str, ...]


def harm(
    witness: Witness,
    named: Collection[str] = (),
    unseen: Collection[str] = (),
    shown: Figures = SHOWN,
    hidden: Figures = UNSEEN,
) -> Harm:
    """The judgement of everything that a witness saw.

    Args:
        named: objects that the plan names, which may be moved.
        unseen: things that no scene shows, for which the figures `hidden` hold, not `shown`; what
            becomes of an unseen object is not judged.
    """
    found = [_touch(witness, thing) for thing in _things(witness)]
    touches = tuple(sorted(found, key=lambda t: -t.mean10))
    tracks = [_Track(witness, i) for i in range(len(witness.objects))]
    known = [track for track in tracks if track.name not in unseen]
    dropped = tuple(t.name for t in known if t.fell)
    tipped = tuple(t.name for t in known if t.tilt > TIPPED)
    left = tuple(t.name for t in known if t.has_left)
    moved = {t.name: t.moved for t in known if t.name not in named and t.moved > MOVED}
    pushed = {t.name: t.pushed for t in known if t.pushed > PUSHED}
    turned = {t.name: t.turned for t in tracks if t.turned > 0}
    beyond: list[str] = []
    for touch in touches:
        beyond += touch.beyond(hidden if touch.thing in unseen else shown)
    beyond += [f"{name} dropped" for name in dropped]
    beyond += [f"{name} tipped" for name in tipped]
    beyond += [f"{name} left its place" for name in left if name not in dropped]
    beyond += [f"{name} moved by {1e3 * way:.0f} mm, unnamed" for name, way in moved.items()]
    beyond += [f"{name} pushed by {1e3 * way:.0f} mm" for name, way in pushed.items()]
    return Harm(touches, dropped, tipped, left, moved, pushed, turned, tuple(beyond))


def _things(witness: Witness) -> list[str]:
    return list(dict.fromkeys(pair.thing for pair in witness.forces))


def _touch(witness: Witness, thing: str) -> Touch:
    """All pairs with one thing as one contact: magnitudes of different parts add up."""
    pairs = [pair for pair in witness.forces if pair.thing == thing]
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


class _Track:
    """One object's way through a run.

    Attributes:
        fell, has_left: what became of it. tilt: rad, the most while it was not held.
        moved: m from its first place, the most. pushed: m from where it was let go, the most
            while it was not held. turned: rad in the hand, the most.
    """

    def __init__(self, witness: Witness, index: int) -> None:
        self.name = witness.objects[index]
        looks = witness.looks
        poses = np.array([look.poses[index] for look in looks])
        held = np.array([look.held == index for look in looks])
        touched = np.array([look.touched[index] for look in looks])
        period = LOOK * witness.period
        at, up = poses[:, :3], _up(poses[:, 3:])
        tilt = np.arccos(np.clip(up @ up[0], -1, 1))
        self.tilt = float(tilt[~held].max(initial=0.0))
        self.fell = _fell(at[:, 2], held, touched, period)
        self.has_left = bool(at[-1, 2] < at[0, 2] - LEFT and not held[-1])
        self.moved = float(np.linalg.norm(at - at[0], axis=1).max())
        self.pushed = _pushed(at, held)
        self.turned = _turned(poses[:, 3:], np.array([look.hand for look in looks]), held)


def _up(quaternions: Array) -> Array:
    """(n, 3) the world's vertical in the bodies' axes: a turn about it changes nothing."""
    w, x, y, z = quaternions.T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)


def _fell(z: Array, held: Mask, touched: Mask, period: float) -> bool:
    """Whether something sank freely by 13 mm, or faster than 0.5 m/s, out of the hand."""
    falling = -np.diff(z) / period > FALLING
    if np.any(falling & ~held[1:]):
        return True
    sunk = 0.0
    for before, now, supported in zip(z[:-1], z[1:], touched[1:] | held[1:], strict=True):
        sunk = 0.0 if supported else sunk + before - now
        if sunk > FALLEN:
            return True
    return False


def _pushed(at: Array, held: Mask) -> float:
    """m, the most that an object went from its first place, or from where it was let go."""
    released = np.flatnonzero(held[:-1] & ~held[1:]) + 1
    bounds = [0, *released.tolist(), len(at)]
    worst = 0.0
    for start, end in pairwise(bounds):
        loose = ~held[start:end]
        way = np.linalg.norm(at[start:end, :2] - at[start, :2], axis=1)
        worst = max(worst, float(way[loose].max(initial=0.0)))
    return worst


def _turned(quaternions: Array, hands: Array, held: Mask) -> float:
    """rad, the most that an object turned in the hand since it was taken."""
    worst = 0.0
    reference: Array | None = None
    for mine, hand, holding in zip(quaternions, hands, held, strict=True):
        if not holding:
            reference = None
            continue
        relative = _product(_conjugate(hand), mine)
        if reference is None:
            reference = relative
        cosine = abs(float(reference @ relative))
        worst = max(worst, 2 * float(np.arccos(min(1.0, cosine))))
    return worst


def _conjugate(q: Array) -> Array:
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def _product(a: Array, b: Array) -> Array:
    w, v = a[0], a[1:]
    return np.concatenate([[w * b[0] - v @ b[1:]], w * b[1:] + b[0] * v + np.cross(v, b[1:])])
