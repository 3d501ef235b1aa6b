"""Judge the harm of a run from a `Witness`: all contact forces, falls, and objects that were moved.

The rehearsal asks for the earliest harm alone (`palpate.execution.harm.first_harm`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.common.pose import Array
from palpate.execution.harm import (
    FALLS,
    SHOWN,
    ContactRecord,
    Figures,
    HarmedObject,
    harms,
    running_mean,
    touches,
    tracks,
    untouched_spells,
)
from palpate.execution.witness import Mask, Witness

OVER = 65.0
"""N, force for which the time above it is counted."""
TAIL = 0.1
"""s after the first contact until the tail begins."""
APART = 0.05
"""s without contact that separate two contacts."""


@dataclass(frozen=True)
class TailFigures(Figures):
    """Limits of a contact, with the `tail`: 10 ms means from 100 ms after the first contact on, N."""

    tail: float | None = None


UNSEEN = TailFigures(mean10=180.0, mean20=150.0, tail=25.0, sideways=180.0)
"""Limits for bodies that the scene does not show."""


class JudgedContact:
    """A contact with further figures. All attributes of a `ContactRecord` are those of the record."""

    def __init__(self, record: ContactRecord, period: float) -> None:
        self._record, magnitude = record, record.magnitude
        touching = np.flatnonzero(magnitude)
        self.first = float(touching[0] * period) if len(touching) else 0.0
        """s, time of the first contact."""
        self.seconds = float(len(touching) * period)
        """s, duration of all contacts."""
        self.peak = float(magnitude.max())
        """N, largest magnitude of one physics step."""
        self.over = float((magnitude > OVER).sum() * period)
        """s above 65 N."""
        self.tail = _tail(magnitude, period)
        """N, largest 10 ms mean that starts `TAIL` or more after the beginning of a contact."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._record, name)

    def beyond(self, figures: Figures) -> Iterator[str]:
        """Exceeded limits, as text."""
        yield from self._record.beyond(figures)
        most = figures.tail if isinstance(figures, TailFigures) else None
        if most is not None and self.tail > most:
            yield f"{self._record.part} on {self._record.thing}: {self.tail:.0f} N after 100 ms"


def _tail(magnitude: Array, period: float) -> float:
    touching = np.flatnonzero(magnitude)
    if not len(touching):
        return 0.0
    # Contacts are runs of steps with gaps of at most `APART`.
    mean10 = running_mean(magnitude, 0.010, period)
    breaks = np.flatnonzero(np.diff(touching) * period > APART)
    starts = np.concatenate([touching[:1], touching[breaks + 1]])
    ends = np.concatenate([touching[breaks], touching[-1:]])
    worst = 0.0
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        # Transients of the impact are over after `TAIL`.
        late = mean10[start + round(TAIL / period) : end + 1]
        worst = max(worst, float(late.max(initial=0.0)))
    return worst


def judged_contacts(witness: Witness) -> tuple[JudgedContact, ...]:
    """All contacts, the largest forces first."""
    return tuple(JudgedContact(touch, witness.period) for touch in touches(witness))


@dataclass(frozen=True, slots=True)
class Harm:
    """Harm of a run.

    Attributes:
        touches: all contacts, the largest forces first.
        turned: rad, rotation of objects in the hand, by name.
        forces: forces beyond the limits, as text.
        fates: harm to objects of the scene.
        unseen: harm to objects that the scene does not show; it is listed and not judged.
    """

    touches: tuple[JudgedContact, ...]
    turned: dict[str, float]
    forces: tuple[str, ...]
    fates: tuple[HarmedObject, ...]
    unseen: tuple[HarmedObject, ...] = ()

    @property
    def beyond(self) -> tuple[str, ...]:
        """All values beyond the limits, as text; empty for a harmless run."""
        return (*self.forces, *map(str, self.fates))

    @property
    def fallen(self) -> tuple[str, ...]:
        """Names of the scene's objects that were dropped, tipped, or left their place."""
        return tuple(dict.fromkeys(fate.name for fate in self.fates if fate.what in FALLS))


def harm(
    witness: Witness,
    named: Collection[str] = (),
    unseen: Collection[str] = (),
    shown: Figures = SHOWN,
    hidden: Figures = UNSEEN,
) -> Harm:
    """Judge a run.

    Args:
        witness: record of the whole run.
        named: objects that the plan names, which may be moved.
        unseen: bodies that the scene does not show, with the limits `hidden`.
        shown, hidden: limits of contact forces.
    """
    contacts = judged_contacts(witness)
    forces = [
        text
        for touch in contacts
        for text in touch.beyond(hidden if touch.thing in unseen else shown)
    ]
    # Objects that the scene does not show are listed apart.
    found = [fate for track in tracks(witness) for fate in harms(track, named)]
    turned = {
        name: angle
        for index, name in enumerate(witness.objects)
        if (angle := _turn_in_hand(witness, index)) > 0
    }
    return Harm(
        contacts,
        turned,
        forces=tuple(forces),
        fates=tuple(fate for fate in found if fate.name not in unseen),
        unseen=tuple(fate for fate in found if fate.name in unseen),
    )


def _turn_in_hand(witness: Witness, index: int) -> float:
    """Largest rotation of an object in the hand since the grasp, rad."""
    looks = witness.looks
    held: Mask = np.array([look.held == index for look in looks])
    hands = Rotation.from_quat([look.hand for look in looks], scalar_first=True)
    attitude = Rotation.from_quat([look.poses[index][3:] for look in looks], scalar_first=True)
    in_hand, worst = hands.inv() * attitude, 0.0
    for start, end in untouched_spells(held):
        # The grasp is the first row in which the hand holds the object.
        taken = start + int(np.argmax(held[start:end]))
        if held[taken]:
            turns = in_hand[taken].inv() * in_hand[taken:end]
            worst = max(worst, float(turns.magnitude().max()))
    return worst
