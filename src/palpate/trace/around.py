"""Part of a long trace that is evidence of one object.

What the arm did long before and after it handled an object says nothing about it. Without that, its estimates take
as long with forty objects as with one, and can be made while the next is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from palpate.trace.recording import Conversion, LeafRun, Recording
from palpate.trace.samples import Trace, once

AROUND = 20.0
"""s before and after an object was in the hand: more than the time around it from which an estimate takes the empty
hand's motions (`tuning.WHOLE_AROUND`). Of 30 masses z is .54 rms; from all of their runs, .59."""


class Recorded(Protocol):
    """What a trace, or a growing one, has recorded."""

    @property
    def leaves(self) -> Sequence[LeafRun]: ...
    @property
    def recordings(self) -> Sequence[Recording]: ...
    @property
    def conversions(self) -> Sequence[Conversion]: ...


def reach(of: Recorded, name: str) -> tuple[float, float] | None:
    """First and last robot time, s, of the evidence of the object `name`: `AROUND` the time in which it was in the
    hand, and the recordings of the empty hand next to its own. None where it was never in the hand: then anything
    may be evidence."""
    held = [leaf for leaf in of.leaves if leaf.context is not None and leaf.context.holding == name]
    if not held:
        return None
    used: list[Recording] = [one.recording for one in of.conversions if one.object == name]
    for nearby in (of.recordings, of.recordings[::-1]):
        # Towards its own from both sides, beginning anew after each of another object.
        empty: list[Recording] = []
        for recording in nearby:
            holding = recording.context.holding
            empty = [*empty, recording] if holding in (None, name) else []
            if holding == name:
                used, empty = [*used, *empty], []
    first = min(one.start for one in (*held, *used))
    return first - AROUND, max(one.end for one in (*held, *used)) + AROUND


_during = once(Trace.during)


def around(trace: Trace, name: str) -> Trace:
    """Return the part of a trace that is evidence of the object `name`; a part is cached, the whole is not."""
    reached = reach(trace, name)
    if reached is None or not len(trace.t):
        return trace
    first, last = reached
    whole = first <= float(trace.t[0]) and float(trace.t[-1]) <= last
    return trace if whole else _during(trace, first, last)
