"""Held-out part of a trace: the last lift of an object, or the way back down."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from palpate.estimation.load.segments import load_rows
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

IN_THE_AIR = ("still", "swinging")
"""Activities of recordings that such an estimate rests on."""


@dataclass(frozen=True, slots=True)
class Cut:
    """Held-out rows, and the recording along whose path they go."""

    words: str
    start: float
    end: float
    recording: Recording


def lifted(trace: Trace) -> list[str]:
    names = [recording.context.holding for recording in still(trace)]
    return list(dict.fromkeys(name for name in names if name is not None))


def cut_of(trace: Trace, name: str) -> Cut | None:
    """The last lift of several, else the way down after the object was measured."""
    grasps = load_rows(trace, name).grasps
    ends = [*grasps, float(trace.t[-1])]
    lifts: list[Cut] = []
    for start, end in list(pairwise(ends))[::2]:
        measured = [one for one in still(trace, name) if start <= one.start and one.end <= end]
        if measured:
            # Along the way up to where it was measured first: later it may be tilted.
            lifts.append(Cut("", start, end, measured[0]))
    if not lifts:
        return None
    last = lifts[-1]
    if len(lifts) > 1:
        return replace(last, words=f"the last of {len(lifts)} lifts of the {name}")
    words = f"the way down with the {name}, after it was measured"
    # What was recorded of it in the air stays.
    stays = [last.recording.end]
    for one in trace.recordings:
        if one.context.activity in IN_THE_AIR and last.start <= one.start and one.end <= last.end:
            stays.append(one.end)
    return replace(last, words=words, start=float(np.nextafter(max(stays), np.inf)))


def still(trace: Trace, name: str | None = None) -> Iterator[Recording]:
    """Recordings of forces while something, or `name`, was held still in the air."""
    for recording in trace.recordings:
        context = recording.context
        held = context.holding is not None and name in (None, context.holding)
        if held and recording.buffer == FORCES and context.activity == "still":
            yield recording
