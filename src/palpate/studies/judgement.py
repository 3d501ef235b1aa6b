"""Did the run acquire exactly what it should? Answered from the execution trace alone, as in the
paper."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether a trial succeeded, and if not, the first reason."""

    success: bool
    reason: str = ""


def judge(
    trace: Trace, expected: Collection[Parameter], may_touch: Collection[str] = ()
) -> Judgement:
    """Success: the right sensing on the right objects, nothing failed or stopped, nothing
    redundant.

    `may_touch` names objects that may be carried out of the way besides those of `expected`.
    """
    failed = [leaf for leaf in trace.leaves if leaf.status != "SUCCESS"]
    if failed:
        return Judgement(False, f"{failed[0].label} failed: {failed[0].message}"[:300])
    acquired = [
        *(Parameter(c.object, c.quantity) for c in trace.conversions),
        *_derived(trace, expected),
    ]
    if missed := sorted(set(expected) - set(acquired)):
        return Judgement(False, f"not acquired: {_listed(missed)}")
    if needless := sorted(set(acquired) - set(expected)):
        return Judgement(False, f"not asked for: {_listed(needless)}")
    if twice := sorted({parameter for parameter in acquired if acquired.count(parameter) > 1}):
        return Judgement(False, f"acquired more than once: {_listed(twice)}")
    if unused := _unused(trace, expected):
        return Judgement(False, f"measured without need at {unused[0]}")
    strangers = sorted(
        _grasped(trace) - {parameter.object for parameter in expected} - set(may_touch)
    )
    return (
        Judgement(False, f"touched needlessly: {', '.join(strangers)}")
        if strangers
        else Judgement(True)
    )


def _derived(trace: Trace, expected: Collection[Parameter]) -> Iterable[Parameter]:
    """The expected derived quantities for which the raw forces were logged."""
    for parameter in expected:
        quantity = catalogue()[parameter.quantity]
        logged = [(r.buffer, r.context) for r in trace.recordings]
        if quantity.derived and quantity.is_evidenced(parameter, logged):
            yield parameter


def _unused(trace: Trace, expected: Collection[Parameter]) -> list[str]:
    """Nodes of recordings that neither a conversion nor an expected derived quantity rests on."""
    converted = {(c.recording.buffer, c.recording.start) for c in trace.conversions}
    unused: list[str] = []
    for recording in trace.recordings:
        is_converted = (recording.buffer, recording.start) in converted
        if not is_converted and not _is_evidence(recording, expected):
            unused.append(recording.node)
    return unused


def _is_evidence(recording: Recording, expected: Collection[Parameter]) -> bool:
    """Whether one of the expected derived quantities rests on a recording."""
    pieces = [catalogue().piece(p, recording.buffer, recording.context) for p in expected]
    return any(piece is not None for piece in pieces)


def _grasped(trace: Trace) -> set[str]:
    return {leaf.context.holding for leaf in trace.leaves if leaf.context and leaf.context.holding}


def _listed(parameters: Iterable[Parameter]) -> str:
    return ", ".join(str(parameter) for parameter in parameters)
