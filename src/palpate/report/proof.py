"""Proof of the twin on the page: for each task a line through the goal, with prior, twin and promise on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.twin.tasks.proof import Proof, Proved, typical

MARGIN = 0.1
"""Share of the half line that stays free at its ends."""


@dataclass(frozen=True, slots=True)
class Line:
    """A task as a drawing: positions in per cent of a line whose middle is the goal; None for what cannot
    be drawn, as a fall.

    Attributes:
        prior, twin: positions.
        band: start and width of the twin's promise.
        said: what came of prior and twin, in words.
    """

    title: str
    says: str
    prior: float | None
    twin: float | None
    band: tuple[float, float] | None
    said: tuple[str, str, str]


def lines(proof: Proof | None) -> list[Line]:
    """Drawings of the tasks on which what was measured has an effect."""
    if proof is None:
        return []
    return [_line(row) for row in proof.rows if row.depends]


def _line(row: Proved) -> Line:
    prior, twin = (typical(errors) for errors in (row.prior, row.twin))
    low, high = row.promise
    reach = max(abs(error) for error in (prior, twin, low, high, 1e-9) if np.isfinite(error))
    start, end = _place(low / reach), _place(high / reach)
    band = None if start is None or end is None else (start, round(max(end - start, 0.3), 1))
    goal, prior_said, twin_said, promise = row.cells()[2:]
    return Line(
        f"{row.object}: {row.task}, {goal}",
        row.says,
        _place(prior / reach),
        _place(twin / reach),
        band,
        (prior_said, twin_said, promise),
    )


def _place(share: float) -> float | None:
    """Per cent of the line, for a share of its half."""
    return round(50 + 50 * (1 - MARGIN) * share, 1) if np.isfinite(share) else None


def indifferent(proof: Proof | None) -> Iterator[str]:
    """Tasks without a line, in words."""
    if proof is None:
        return
    for row in proof.rows:
        if not row.depends:
            yield f"{row.object}: nothing that was measured matters for this task: {row.task}"
    yield from proof.left_out
