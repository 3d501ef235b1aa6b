"""Did the run acquire exactly what it should? Answered from the execution trace alone, as in the
paper."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
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
    objection = next(_objections(trace, expected, may_touch), None)
    return Judgement(objection is None, objection or "")


def _objections(
    trace: Trace, expected: Collection[Parameter], may_touch: Collection[str]
) -> Iterator[str]:
    """What speaks against a success, the gravest first."""
    for leaf in trace.leaves:
        if leaf.status != "SUCCESS":
            yield f"{leaf.label} failed: {leaf.message}"[:300]
    acquired = Counter(_acquired(trace, expected))
    if missed := set(expected) - set(acquired):
        yield f"not acquired: {_listed(missed)}"
    if needless := set(acquired) - set(expected):
        yield f"not asked for: {_listed(needless)}"
    if twice := [parameter for parameter, count in acquired.items() if count > 1]:
        yield f"acquired more than once: {_listed(twice)}"
    for node in _unused(trace, expected):
        yield f"measured without need at {node}"
    wanted = {parameter.object for parameter in expected}
    if strangers := _grasped(trace) - wanted - set(may_touch):
        yield f"touched needlessly: {', '.join(sorted(strangers))}"


def _acquired(trace: Trace, expected: Collection[Parameter]) -> Iterator[Parameter]:
    """What was converted, and the expected derived quantities for which the raw forces were
    logged."""
    for conversion in trace.conversions:
        yield Parameter(conversion.object, conversion.quantity)
    logged = [(r.buffer, r.context) for r in trace.recordings]
    for parameter in expected:
        quantity = catalogue()[parameter.quantity]
        if quantity.derived and quantity.is_evidenced(parameter, logged):
            yield parameter


def _unused(trace: Trace, expected: Collection[Parameter]) -> Iterator[str]:
    """Nodes of recordings that neither a conversion nor an expected derived quantity rests on."""
    converted = {(c.recording.buffer, c.recording.start) for c in trace.conversions}
    for recording in trace.recordings:
        is_converted = (recording.buffer, recording.start) in converted
        if not is_converted and not _is_evidence(recording, expected):
            yield recording.node


def _is_evidence(recording: Recording, expected: Collection[Parameter]) -> bool:
    """Whether one of the expected derived quantities rests on a recording."""
    pieces = [catalogue().piece(p, recording.buffer, recording.context) for p in expected]
    return any(piece is not None for piece in pieces)


def _grasped(trace: Trace) -> set[str]:
    """Every object that was ever held."""
    held: set[str] = set()
    for leaf in trace.leaves:
        if leaf.context and leaf.context.holding:
            held.add(leaf.context.holding)
    return held


def _listed(parameters: Iterable[Parameter]) -> str:
    return ", ".join(str(parameter) for parameter in sorted(parameters))
