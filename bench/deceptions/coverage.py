"""How honest intervals are: how often they hold what is true, over all identified values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from bench.campaign.ledger import Row

HALF = NormalDist().inv_cdf(0.75)
"""Half width of the central 50 % interval of a normal distribution, in standard deviations."""
TINY = 1e-12
"""Lest values without any error divide by zero."""
FAR, FARTHEST = 4.0, 5.0
"""Stated standard deviations beyond which a value is counted as far off."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Of `values` identified values of a quantity, or of all.

    Attributes:
        covered95, covered50: parts of them whose central interval holds the truth.
        stated: root mean square of the errors in stated standard deviations, turned over: 1 where
            they are as large as stated, more where they are smaller.
        far, farthest: how many are beyond 4 and 5 stated standard deviations.
        worst: the most.
    """

    quantity: str
    values: int
    covered95: float
    covered50: float
    stated: float
    far: int
    farthest: int
    worst: float


def coverage(rows: Iterable[Row]) -> list[Coverage]:
    """Pooled, then quantity by quantity; of all worlds in which the answer is judged."""
    found: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        if row.figures.get("kind") == "not observable":
            continue
        for score in row.figures.get("scores", ()):
            if score["verdict"] == "identified":
                quantity = score["parameter"].rpartition(".")[2]
                found.setdefault(quantity, []).append(score)
    everything = [score for scores in found.values() for score in scores]
    if not everything:
        return []
    return [_coverage("all", everything), *_each(found)]


def _each(found: dict[str, list[dict[str, Any]]]) -> Iterator[Coverage]:
    for quantity, scores in sorted(found.items()):
        yield _coverage(quantity, scores)


def _coverage(quantity: str, scores: Sequence[dict[str, Any]]) -> Coverage:
    z = np.array([score["z"] for score in scores])
    return Coverage(
        quantity,
        len(z),
        float(np.mean([score["covered"] for score in scores])),
        float(np.mean(z < HALF)),
        float(1.0 / np.sqrt(max(float(np.mean(z**2)), TINY))),
        int(np.sum(z > FAR)),
        int(np.sum(z > FARTHEST)),
        float(z.max()),
    )
