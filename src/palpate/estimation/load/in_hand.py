"""Rows of a trace with an object in the hand, and with an empty hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.estimation.motion import Mask
from palpate.trace.samples import Trace


@dataclass(frozen=True, slots=True, eq=False)
class LoadRows:
    """Rows of a trace with the object in the hand and with an empty hand; rows while the fingers move are
    in neither. `grasps`: s, when the content of the hand changed to or from the object."""

    loaded: Mask
    empty: Mask
    grasps: tuple[float, ...]


def load_rows(trace: Trace, name: str | None) -> LoadRows:
    """Rows in which `name` was held, from the symbolic contexts of the leaves."""
    t = trace.samples.t
    loaded, empty = np.zeros(len(t), dtype=bool), np.ones(len(t), dtype=bool)
    held: str | None = None
    grasps: list[float] = []
    for leaf in sorted(trace.leaves, key=lambda run: run.end):
        if leaf.context is None or leaf.context.holding == held:
            continue
        if name in (held, leaf.context.holding):
            grasps.append(leaf.end if leaf.context.holding else leaf.start)
        held = leaf.context.holding
        loaded[t >= leaf.start] = empty[t >= leaf.start] = False
        loaded[t > leaf.end] = held == name and held is not None
        empty[t > leaf.end] = held is None
    return LoadRows(loaded, empty, tuple(grasps))
