"""Harm of a run, judged from a `Witness`: contact forces, falls, and objects that were moved."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from palpate.common.pose import Array
from palpate.execution.witness import LOOK, Mask, Pair, Witness
from palpate.trace.samples import STANDARD_GRAVITY

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


# Contact forces and their limits. 65 N is the quasi-static limit for the face in ISO/TS 15066, its lowest
# one. The other limits are this project's own.


LIGHT = 1.5  # kg, largest mass of a light object; heavier ones count as fixed


@dataclass(frozen=True)
class Figures:
    """Limits of a contact, N."""

    # mean10, mean20: limits of running means over 10 and 20 ms.
    mean10: float = 65.0
    mean20: float = 45.0
    sideways: float = 25.0  # limit of horizontal 10 ms means on light free objects


SHOWN = Figures()  # Limits for bodies of the scene


@dataclass(frozen=True, slots=True, eq=False)
class ContactRecord:
    """Contact of a body with the robot or the held object; forces in N, times in s."""

    thing: str  # name of the touched body
    part: str  # body of the robot, or held object, with the largest force
    load: bool  # `part` is the held object
    light: bool  # the touched body is a free object of at most `LIGHT`
    magnitude: Array  # (n,) sum of the magnitudes of all contacts in each physics step
    # mean10, mean20: largest running means of the magnitude over 10 and 20 ms.
    mean10: float
    mean20: float
    hardest: float  # s, time of the largest 10 ms mean
    sideways: float  # largest horizontal 10 ms mean without a support from the other side
    vertical: bool  # the largest force was more vertical than horizontal

    def beyond(self, figures: Figures) -> Iterator[str]:
        """Exceeded limits, as text."""
        who = f"{self.part} on {self.thing}"
        if self.mean10 > figures.mean10:
            yield f"{who}: {self.mean10:.0f} N over 10 ms"
        if self.mean20 > figures.mean20:
            yield f"{who}: {self.mean20:.0f} N over 20 ms"
        if self.light and self.sideways > figures.sideways:
            yield f"{who}: {self.sideways:.0f} N sideways over 10 ms"


def touches(witness: Witness) -> tuple[ContactRecord, ...]:
    """All contacts, the largest forces first."""
    # Group the pairs by the touched body.
    pairs: dict[str, list[Pair]] = {}
    for pair in witness.forces:
        pairs.setdefault(pair.thing, []).append(pair)
    found = [_touch(witness, thing, of_thing) for thing, of_thing in pairs.items()]
    return tuple(sorted(found, key=lambda touch: -touch.mean10))


def _touch(witness: Witness, thing: str, pairs: list[Pair]) -> ContactRecord:
    """Combine all pairs with one body into one contact; magnitudes of different parts add up."""
    magnitude, sideways = np.zeros(witness.steps + 1), np.zeros(witness.steps + 1)
    strongest_pair, strongest, upright = pairs[0], -1.0, True
    for pair in pairs:
        steps, vectors = witness.forces[pair].rows()
        # The weight of a held object on its support is no contact force of the robot.
        if pair.load:
            mass = witness.masses[witness.objects.index(pair.part)]
            vectors = _without_weight(vectors, STANDARD_GRAVITY * mass)
        size, horizontal = np.linalg.norm(vectors, axis=1), np.hypot(vectors[:, 0], vectors[:, 1])
        magnitude[steps] += size
        # Sideways pushes count only while no other body supports the touched one.
        free = ~np.isin(steps, list(witness.forces[pair].blocked))
        sideways[steps[free]] += horizontal[free]
        # Pair and direction of the largest force.
        if size.max() > strongest:
            worst = int(size.argmax())
            strongest_pair, strongest = pair, float(size[worst])
            upright = bool(abs(vectors[worst, 2]) > horizontal[worst])
    # Figures over all contacts of the body.
    dt = witness.period
    mean10 = running_mean(magnitude, 0.010, dt)
    masses = dict(zip(witness.objects, witness.masses, strict=True))
    return ContactRecord(
        thing,
        strongest_pair.part,
        strongest_pair.load,
        light=masses.get(thing, np.inf) <= LIGHT,
        magnitude=magnitude,
        mean10=float(mean10.max()),
        mean20=float(running_mean(magnitude, 0.020, dt).max()),
        hardest=float(mean10.argmax()) * dt,
        sideways=float(running_mean(sideways, 0.010, dt).max()),
        vertical=upright,
    )


def _without_weight(vectors: Array, weight: float) -> Array:
    """Forces (n, 3), N, of a load on its support, without the load's weight.

    Only downward forces are reduced, to zero at most.
    """
    pressed = vectors.copy()
    pressed[:, 2] = np.minimum(pressed[:, 2] + weight, np.maximum(pressed[:, 2], 0.0))
    return pressed


def running_mean(values: Array, window: float, dt: float) -> Array:
    """Compute running means over `window` s, indexed by the start of the window."""
    # By differences of cumulative sums, padded with zeros at the end.
    width = round(window / dt)
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([values, np.zeros(width)]))])
    return (sums[width:] - sums[:-width]) / width


# Falls, and objects that were moved.


TIPPED = np.deg2rad(15)  # rad, largest allowed tilt from the first attitude
MOVED = 0.005  # m, largest allowed displacement of an object that the plan does not name
PUSHED = 0.025  # m, largest allowed displacement of an object that is not held

DROPPED, TOPPLED, GONE = FALLS = ("dropped", "tipped", "left its place")
FALLEN = 0.013  # m of free fall, after which the speed is 0.5 m/s
FALLING = 0.5  # m/s, speed downwards outside the hand that counts as a fall
LEFT = 0.05  # m below its first height at which an object has left its support
UP = (0.0, 0.0, 1.0)


class Track:
    """Motion of an object during a run.

    Attributes:
        name: name of the object.
        fell: s, time of a fall out of the hand or off its support; None without one.
        has_left: it ends lower than at first, and is not held.
        tilt: rad, largest tilt while it was not held. Rolling of a ball, or of a log about its axis, is
            no tilt.
        moved: m, largest distance from its first position.
        pushed: m, largest distance from the place of its release, while it was not held.
        tipped_at, moved_at, pushed_at: s, first time beyond each limit.
    """

    def __init__(self, witness: Witness, index: int) -> None:
        from scipy.spatial.transform import Rotation  # takes longer to load than most plans to make

        self.name = witness.objects[index]
        looks = witness.looks
        # Pose, grasp and contact of the object at every look.
        poses = np.array([look.poses[index] for look in looks])
        held = np.array([look.held == index for look in looks])
        touched = np.array([look.touched[index] for look in looks])
        # Tilt and falls: harm that needs no plan to judge.
        at, attitude = poses[:, :3], Rotation.from_quat(poses[:, 3:], scalar_first=True)
        period = LOOK * witness.period
        tilt = np.where(held, 0.0, _tilt(attitude, witness.axes[index]))
        self.tilt, self.tipped_at = float(tilt.max()), _first(tilt > TIPPED, period)
        fell = _fell(at[:, 2], held, touched, period)
        self.fell = None if fell is None else fell * period
        self.has_left = bool(at[-1, 2] < at[0, 2] - LEFT and not held[-1])
        # Displacements: from the first position, and from the latest release.
        moved = np.linalg.norm(at - at[0], axis=1)
        self.moved, self.moved_at = float(moved.max()), _first(moved > MOVED, period)
        pushed = _push_distance(at, held)
        self.pushed, self.pushed_at = float(pushed.max()), _first(pushed > PUSHED, period)


def tracks(witness: Witness) -> list[Track]:
    """Tracks of all objects."""
    return [Track(witness, index) for index in range(len(witness.objects))]


def _tilt(attitude: Rotation, axis: Array | None) -> Array:
    """Tilt from the first attitude, (n,) rad.

    A rotation about the vertical, or about an `axis` of revolution (3,), is no tilt.
    """
    # The world's vertical in the object's frame. With an axis, only its elevation counts.
    vertical = attitude.inv().apply(UP)
    if axis is not None:
        rise = np.arcsin(np.clip(vertical @ axis, -1, 1))
        return np.abs(rise - rise[0])
    return np.arccos(np.clip(vertical @ vertical[0], -1, 1))


def _first(beyond: Mask, period: float) -> float:
    """Time (s) of the first row that is true, 0 without one."""
    return float(np.argmax(beyond)) * period


def _fell(z: Array, held: Mask, touched: Mask, period: float) -> int | None:
    """Row of a fall; None without one.

    A fall is 13 mm downwards without support, or more than 0.5 m/s downwards outside the hand.
    """
    falling = (-np.diff(z) / period > FALLING) & ~held[1:]
    fast = int(np.argmax(falling)) if falling.any() else None
    # Sum of the descent since the last support.
    sunk = 0.0
    supports = touched[1:] | held[1:]
    for row, (before, now, supported) in enumerate(zip(z[:-1], z[1:], supports, strict=True)):
        sunk = 0.0 if supported else sunk + before - now
        if sunk > FALLEN or row == fast:
            return row
    return None


def untouched_spells(held: Mask) -> list[tuple[int, int]]:
    """Return the ranges of rows from each release, or the beginning, to the next one, or the end."""
    released = np.flatnonzero(held[:-1] & ~held[1:]) + 1
    return list(pairwise([0, *released.tolist(), len(held)]))


def _push_distance(at: Array, held: Mask) -> Array:
    """(n,) m, horizontal distance from the first position or the latest release; 0 while held."""
    ways = np.zeros(len(held))
    for start, end in untouched_spells(held):
        ways[start:end] = np.linalg.norm(at[start:end, :2] - at[start, :2], axis=1)
    return np.where(held, 0.0, ways)


@dataclass(frozen=True, slots=True)
class HarmedObject:
    """Harm to an object."""

    name: str
    what: str  # one of `FALLS`, or `moved` (the plan does not name it), or `pushed`
    way: float = 0.0  # m, distance that it was moved or pushed
    # s, time of the harm; inf for harm that shows only at the end.
    t: float = field(default=np.inf, compare=False)

    def __str__(self) -> str:
        text = f"{self.name} {self.what}"
        return f"{text} by {1e3 * self.way:.0f} mm" if self.way else text


def first_harm(witness: Witness, named: Collection[str] = ()) -> tuple[float, str] | None:
    """Return time, s, and description of the earliest harm of a run; None for a harmless run.

    The plan may move the objects that it has `named`.
    """
    # Contact forces beyond their limits, with the time of the largest 10 ms mean.
    forces = [(touch.hardest, text) for touch in touches(witness) for text in touch.beyond(SHOWN)]
    found = [one for track in tracks(witness) for one in harms(track, named)]
    # A falling object has moved before: state the fall, at the time of the first motion.
    falls = {one.name: str(one) for one in found if one.what in FALLS}
    events = [(one.t, falls.get(one.name, str(one))) for one in found]
    return min((*forces, *events), default=None)


def harms(track: Track, named: Collection[str]) -> list[HarmedObject]:
    """List the harm to one object."""
    found: list[HarmedObject] = []
    # From the most specific to the least; one object may have several.
    if track.fell is not None:
        found.append(HarmedObject(track.name, DROPPED, t=track.fell))
    if track.tilt > TIPPED:
        found.append(HarmedObject(track.name, TOPPLED, t=track.tipped_at))
    if track.has_left and track.fell is None:
        found.append(HarmedObject(track.name, GONE))
    if track.name not in named and track.moved > MOVED:
        found.append(HarmedObject(track.name, "moved", track.moved, track.moved_at))
    if track.pushed > PUSHED:
        found.append(HarmedObject(track.name, "pushed", track.pushed, track.pushed_at))
    return found
