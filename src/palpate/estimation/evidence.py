"""Evidence in a trace: the valid part, the part that concerns one object, and a cache of derived signals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, Protocol, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from palpate.trace.recording import Conversion, LeafRun, Recording
from palpate.trace.samples import Trace

K = TypeVar("K")
P = ParamSpec("P")
T = TypeVar("T")


def once(find: Callable[Concatenate[K, P], T]) -> Callable[Concatenate[K, P], T]:
    """Cache the results of `find` during the lifetime of its first argument: samples, a trace or similar.

    A result must not refer to that argument, which would then live for ever. The other arguments are
    hashable. A cached array is shared by all callers and therefore read-only.
    """
    known: WeakKeyDictionary[Any, dict[Hashable, T]] = WeakKeyDictionary()

    @wraps(find)
    def compute_once(of: K, *args: P.args, **named: P.kwargs) -> T:
        # Results are kept per first argument, by the other arguments.
        results = known.setdefault(of, {})
        key = (args, *sorted(named.items()))
        if key not in results:
            result = find(of, *args, **named)
            if isinstance(result, np.ndarray):
                result.flags.writeable = False
            results[key] = result
        return results[key]

    return compute_once


# Valid part of a trace: without the samples of failed actions, of parallel actions, and of all later
# actions until the plan was resumed.


# Prefix of a leaf's path in the plan of a later attempt or round; empty in the first.
ATTEMPT = re.compile(r"((replan|repeat)\[\d+\]\.)*")


class SpoiledSpan(NamedTuple):
    """Stretch of robot time, s, without evidence, and the action that spoiled it."""

    start: float
    end: float
    spoiled_by: LeafRun

    def touches(self, start: float, end: float) -> bool:
        """Test if the interval from `start` to `end` overlaps with it."""
        return end > self.start and start < self.end


def spoiled_spans(trace: Trace) -> tuple[SpoiledSpan, ...]:
    """Find the spans without evidence, one for each attempt that was broken off.

    A span extends from the first failed action to the start of the next attempt.
    """
    # Group the leaves by attempt, which ends where the next attempt starts.
    attempts: dict[str, list[LeafRun]] = {}
    for leaf in trace.leaves:
        prefix = ATTEMPT.match(leaf.node)
        attempts.setdefault(prefix.group() if prefix else "", []).append(leaf)
    starts = [min(leaf.start for leaf in leaves) for leaves in attempts.values()]
    ends = [*starts, math.inf][1:]
    found: list[SpoiledSpan] = []
    # The first failed action of an attempt spoils the rest of it.
    for leaves, end in zip(attempts.values(), ends, strict=True):
        failed = [leaf for leaf in leaves if leaf.status != "SUCCESS"]
        if failed:
            first = min(failed, key=lambda leaf: leaf.start)
            found.append(SpoiledSpan(parallel_start(first, leaves), end, first))
    return tuple(found)


def parallel_start(failed: LeafRun, leaves: Sequence[LeafRun]) -> float:
    """Return the start, s, of a leaf, or of the first leaf in parallel with it, transitively."""
    start = failed.start
    # Backwards in time: each overlapping leaf may move the start earlier.
    for leaf in sorted(leaves, key=lambda leaf: leaf.end, reverse=True):
        if leaf.end > start and leaf.start < failed.end:
            start = min(start, leaf.start)
    return start


def remove_spoiled(trace: Trace) -> Trace:
    """Return the part of a trace that is evidence; the trace itself if nothing was broken off."""
    spans = spoiled_spans(trace)
    if not spans:
        return trace

    def is_kept(start: float, end: float) -> bool:
        return not any(span.touches(start, end) for span in spans)

    # Keep the rows outside of all spans, and the recordings that overlap with none.
    t = trace.samples.t
    rows = np.all([(t <= span.start) | (t >= span.end) for span in spans], axis=0)
    part = trace.part(trace.samples.where(rows), lambda one: is_kept(one.start, one.end))
    # A conversion is kept with its recording, unless it was made in the failed part itself.
    return replace(
        part,
        leaves=tuple(leaf for leaf in trace.leaves if is_kept(leaf.start, leaf.end)),
        conversions=tuple(c for c in part.conversions if is_kept(c.time, c.time)),
    )


# Part of a long trace that is evidence of one object.


AROUND = 20.0
"""s before and after an object was in the hand. It is longer than the time around it from which an estimate takes the
empty hand's motions (`estimation.load_blocks.WHOLE_AROUND`). Sensitive: rms z of 30 masses
0.54, from all of their runs 0.59."""


class Recorded(Protocol):
    """Leaves, recordings and conversions of a trace, complete or growing."""

    @property
    def leaves(self) -> Sequence[LeafRun]: ...
    @property
    def recordings(self) -> Sequence[Recording]: ...
    @property
    def conversions(self) -> Sequence[Conversion]: ...


def find_evidence_span(of: Recorded, name: str) -> tuple[float, float] | None:
    """Find the first and last robot time, s, of the evidence of the object `name`.

    The evidence covers `AROUND` the time in which the object was in the hand, and the adjacent recordings
    of the empty hand. None if the object was never in the hand: any part may be evidence then.
    """
    # Leaves with the object in the hand, and recordings for its quantities.
    held = [leaf for leaf in of.leaves if leaf.context is not None and leaf.context.holding == name]
    if not held:
        return None
    used: list[Recording] = [one.recording for one in of.conversions if one.object == name]
    for nearby in (of.recordings, of.recordings[::-1]):
        # Approach the object's own recordings from both sides; a recording of another object restarts the collection.
        empty: list[Recording] = []
        for recording in nearby:
            holding = recording.context.holding
            empty = [*empty, recording] if holding in (None, name) else []
            if holding == name:
                used, empty = [*used, *empty], []
    # The span of all evidence, with a margin on both sides.
    first = min(one.start for one in (*held, *used))
    return first - AROUND, max(one.end for one in (*held, *used)) + AROUND


_during = once(Trace.during)


def select_evidence(trace: Trace, name: str) -> Trace:
    """Return the part of a trace that is evidence of the object `name`. Parts are cached, the whole trace is not."""
    # The whole trace if the evidence covers it.
    reached = find_evidence_span(trace, name)
    if reached is None or not len(trace.t):
        return trace
    first, last = reached
    whole = first <= float(trace.t[0]) and float(trace.t[-1]) <= last
    return trace if whole else _during(trace, first, last)
