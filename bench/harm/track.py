"""What became of an object, from where a `Witness` saw it every 5 ms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from bench.harm.witness import LOOK, Mask, Witness
from palpate.geometry.pose import Array

FALLEN = 0.013
"""m of free fall: 0.5 m/s."""
FALLING = 0.5
"""m/s downwards, unsupported."""
LEFT = 0.05
"""m below where it stood: an object is no longer on what carried it."""
UP = (0.0, 0.0, 1.0)


class Track:
    """One object's way through a run.

    Attributes:
        name: the object's.
        fell: out of the hand, or off what carried it.
        has_left: it ends lower than it stood, and nobody holds it.
        tilt: rad, the most while it was not held.
        moved: m from its first place, the most.
        pushed: m from where it was let go, the most while it was not held.
        turned: rad in the hand, the most.
    """

    def __init__(self, witness: Witness, index: int) -> None:
        self.name = witness.objects[index]
        looks = witness.looks
        poses = np.array([look.poses[index] for look in looks])
        held = np.array([look.held == index for look in looks])
        touched = np.array([look.touched[index] for look in looks])
        at, attitude = poses[:, :3], Rotation.from_quat(poses[:, 3:], scalar_first=True)
        self.tilt = float(_tilt(attitude)[~held].max(initial=0.0))
        self.fell = _fell(at[:, 2], held, touched, LOOK * witness.period)
        self.has_left = bool(at[-1, 2] < at[0, 2] - LEFT and not held[-1])
        self.moved = float(np.linalg.norm(at - at[0], axis=1).max())
        self.pushed = _pushed(at, held)
        hands = Rotation.from_quat([look.hand for look in looks], scalar_first=True)
        self.turned = _turned(hands.inv() * attitude, held)


def tracks(witness: Witness) -> list[Track]:
    """The ways of all objects."""
    return [Track(witness, index) for index in range(len(witness.objects))]


def _tilt(attitude: Rotation) -> Array:
    """(n,) rad from the first attitude; a turn about the vertical is none."""
    vertical = attitude.inv().apply(UP)
    return np.arccos(np.clip(vertical @ vertical[0], -1, 1))


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


def _spells(held: Mask) -> list[tuple[int, int]]:
    """From the beginning, or where the object was let go, to where it is let go next, or the
    end."""
    released = np.flatnonzero(held[:-1] & ~held[1:]) + 1
    return list(pairwise([0, *released.tolist(), len(held)]))


def _pushed(at: Array, held: Mask) -> float:
    """m, the most that an object went from its first place, or from where it was let go."""
    worst = 0.0
    for start, end in _spells(held):
        loose = ~held[start:end]
        way = np.linalg.norm(at[start:end, :2] - at[start, :2], axis=1)
        worst = max(worst, float(way[loose].max(initial=0.0)))
    return worst


def _turned(in_hand: Rotation, held: Mask) -> float:
    """rad, the most that an object turned in the hand since it was taken."""
    worst = 0.0
    for start, end in _spells(held):
        taken = start + int(np.argmax(held[start:end]))
        if held[taken]:
            turns = in_hand[taken].inv() * in_hand[taken:end]
            worst = max(worst, float(turns.magnitude().max()))
    return worst
