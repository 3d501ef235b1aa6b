"""Sound part of a trace: without the samples of actions that failed, of those in parallel with them,
and of all that followed until the plan was resumed.

The recordings of an arm that hit an obstacle, lost its grasp or was stopped do not show what their
context says: a slide that ends at the force limit would count the obstacle as friction.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.trace.recording import LeafRun
from palpate.trace.samples import Trace

ATTEMPT = re.compile(r"((replan|repeat)\[\d+\]\.)*")
"""Prefix of a leaf's path in the plan of a later attempt or round; empty in the first."""


class Span(NamedTuple):
    """Stretch of robot time, s, without evidence, and the action that spoiled it."""

    start: float
    end: float
    spoiled_by: LeafRun

    def touches(self, start: float, end: float) -> bool:
        """True if the interval from `start` to `end` overlaps with it."""
        return end > self.start and start < self.end


def spoiled(trace: Trace) -> tuple[Span, ...]:
    """Find the spans without evidence, one for each attempt that was broken off: from the first action
    that failed to the start of the next attempt."""
    attempts: dict[str, list[LeafRun]] = {}
    for leaf in trace.leaves:
        prefix = ATTEMPT.match(leaf.node)
        attempts.setdefault(prefix.group() if prefix else "", []).append(leaf)
    starts = [min(leaf.start for leaf in leaves) for leaves in attempts.values()]
    ends = [*starts, math.inf][1:]
    found: list[Span] = []
    for leaves, end in zip(attempts.values(), ends, strict=True):
        failed = [leaf for leaf in leaves if leaf.status != "SUCCESS"]
        if failed:
            first = min(failed, key=lambda leaf: leaf.start)
            found.append(Span(parallel_start(first, leaves), end, first))
    return tuple(found)


def parallel_start(failed: LeafRun, leaves: Sequence[LeafRun]) -> float:
    """Start of a leaf, or of the first of those that ran in parallel with it, transitively; s."""
    start = failed.start
    for leaf in sorted(leaves, key=lambda leaf: leaf.end, reverse=True):
        if leaf.end > start and leaf.start < failed.end:
            start = min(start, leaf.start)
    return start


def sound(trace: Trace) -> Trace:
    """Return the part of a trace that is evidence; the trace itself if nothing was broken off."""
    spans = spoiled(trace)
    if not spans:
        return trace

    def kept(start: float, end: float) -> bool:
        return not any(span.touches(start, end) for span in spans)

    t = trace.samples.t
    rows = np.all([(t <= span.start) | (t >= span.end) for span in spans], axis=0)
    recordings = tuple(r for r in trace.recordings if kept(r.start, r.end))
    # A conversion is kept with its recording, unless it was made in the failed part itself.
    conversions = [c for c in trace.conversions if c.recording in recordings]
    return replace(
        trace,
        samples=trace.samples.where(rows),
        leaves=tuple(leaf for leaf in trace.leaves if kept(leaf.start, leaf.end)),
        recordings=recordings,
        conversions=tuple(c for c in conversions if kept(c.time, c.time)),
    )
