"""Sound part of a trace: nothing recorded in an action that did not end well, beside it, or after
it until the plan was resumed.

An arm that ran into something, slipped or was told to stop did not do what its recordings say it
did: a slide that ends at the limit of force reads as friction what was an obstacle.
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

_ATTEMPT = re.compile(r"((replan|repeat)\[\d+\]\.)*")
"""Prefix of a leaf's path in the plan of a later attempt or round."""


class Span(NamedTuple):
    """A stretch of robot time, s, that holds no evidence, and the action that spoiled it."""

    start: float
    end: float
    spoiled_by: LeafRun

    def touches(self, start: float, end: float) -> bool:
        """True if something that lasted from `start` to `end` reaches into it."""
        return end > self.start and start < self.end


def spoiled(trace: Trace) -> tuple[Span, ...]:
    """The spans without evidence, one an attempt that was broken off."""
    attempts: dict[str, list[LeafRun]] = {}
    for leaf in trace.leaves:
        attempts.setdefault(_attempt(leaf.node), []).append(leaf)
    starts = [min(leaf.start for leaf in leaves) for leaves in attempts.values()]
    ends = [*starts, math.inf][1:]
    found: list[Span] = []
    for leaves, end in zip(attempts.values(), ends, strict=True):
        failed = [leaf for leaf in leaves if leaf.status != "SUCCESS"]
        if failed:
            first = min(failed, key=lambda leaf: leaf.start)
            found.append(Span(_beginning(first, leaves), end, first))
    return tuple(found)


def sound(trace: Trace) -> Trace:
    """The part of a trace that is evidence; all of it when nothing was broken off."""
    spans = spoiled(trace)
    if not spans:
        return trace

    def kept(start: float, end: float) -> bool:
        return not any(span.touches(start, end) for span in spans)

    t = trace.samples.t
    rows = np.ones(len(t), dtype=np.bool_)
    for span in spans:
        rows &= (t <= span.start) | (t >= span.end)
    recordings = tuple(r for r in trace.recordings if kept(r.start, r.end))
    return replace(
        trace,
        samples=trace.samples.where(rows),
        leaves=tuple(leaf for leaf in trace.leaves if kept(leaf.start, leaf.end)),
        recordings=recordings,
        conversions=tuple(
            c for c in trace.conversions if c.recording in recordings and kept(c.time, c.time)
        ),
    )


def _attempt(node: str) -> str:
    found = _ATTEMPT.match(node)
    return found.group() if found else ""


def _beginning(failed: LeafRun, leaves: Sequence[LeafRun]) -> float:
    """Begin of the action, or of the first of those that ran in parallel with it, transitively."""
    start, end = failed.start, failed.end
    for leaf in sorted(leaves, key=lambda leaf: leaf.end, reverse=True):
        if leaf.end > start and leaf.start < end:
            start = min(start, leaf.start)
    return start
