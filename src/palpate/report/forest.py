"""Many estimates at a glance: sorted, on one scale for each quantity."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.report.axis import Axis
from palpate.report.cards import Card, Interval

FEW = 4
"""So many cards are read at once; of more, a table stands above them."""
AIR = 0.04
"""Share of a scale that stays free at each end."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Component of an estimate; places in per cent of the scale."""

    name: str
    anchor: str
    value: str
    std: str
    verdict: str
    at: float
    left: float
    width: float
    truth: float | None


@dataclass(frozen=True, slots=True)
class Scale:
    """All estimates of one quantity, the largest first; its ends as text."""

    quantity: str
    unit: str
    low: str
    high: str
    entries: tuple[Entry, ...]
    without: tuple[Card, ...]


def forest(cards: Sequence[Card]) -> list[Scale]:
    """Scales, one per quantity; none where there are few cards."""
    if len(cards) <= FEW:
        return []
    kinds: dict[tuple[str, str], list[Card]] = {}
    for card in cards:
        kinds.setdefault((card.quantity, card.unit), []).append(card)
    return [_scale(quantity, unit, of) for (quantity, unit), of in kinds.items()]


def _scale(quantity: str, unit: str, cards: Sequence[Card]) -> Scale:
    rows: list[tuple[Card, Interval]] = []
    for card in cards:
        rows += [(card, interval) for interval in card.intervals]
    rows.sort(key=lambda row: row[1].number, reverse=True)
    ends = [end for _, interval in rows for end in interval.reach]
    axis = Axis.around(np.array(ends or [0.0, 1.0]), AIR)
    entries: list[Entry] = []
    for card, interval in rows:
        first, last = (axis.per_cent(end) for end in interval.bounds)
        truth = None if interval.truth is None else axis.per_cent(interval.truth.number)
        name = f"{card.object} {interval.axis}".strip()
        told = (name, card.anchor, interval.value, interval.std, interval.verdict)
        at = axis.per_cent(interval.number)
        entries.append(Entry(*told, at, first, round(last - first, 2), truth))
    ends_told = f"{axis.low:.3g}", f"{axis.high:.3g}"
    return Scale(quantity, unit, *ends_told, tuple(entries), tuple(_empty(cards)))


def _empty(cards: Iterable[Card]) -> list[Card]:
    return [card for card in cards if not card.intervals]
