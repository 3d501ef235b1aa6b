"""Measured windows: what each recording is evidence of, and what it shows at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.estimation.contact.descent import tip_height
from palpate.estimation.estimate import Estimate, rounded
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue
from palpate.trace.recording import Context, Recording
from palpate.trace.samples import FORCES, Trace

FINEST = 1e-5
"""N or m: what a recording's spread is not shown below."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Measured window: situation, time and reading."""

    what: str
    when: str
    reading: str


class _Signal(NamedTuple):
    """Signal of a recording for the overview."""

    name: str
    unit: str
    values: Array


def quantity_label(id: str) -> str:
    """In words, or the id itself where a quantity is not in the catalogue."""
    return catalogue()[id].label if id in catalogue() else id


def windows(trace: Trace, estimates: Sequence[Estimate]) -> dict[Recording, str]:
    """Every recording with the names of what it is evidence of, by an estimate's or a conversion's
    word; with its situation where nobody claims it."""
    names: dict[Recording, list[str]] = {recording: [] for recording in trace.recordings}

    def claim(recording: Recording, parameter: Parameter) -> None:
        name = f"{parameter.object} {quantity_label(parameter.quantity)}"
        if recording in names and name not in names[recording]:
            names[recording].append(name)

    for estimate in estimates:
        for recording in estimate.evidence:
            claim(recording, estimate.parameter)
    for conversion in trace.conversions:
        claim(conversion.recording, Parameter(conversion.object, conversion.quantity))
    for recording, claimed in names.items():
        if not claimed:
            claimed.append(_situation(recording.context))
    return {recording: ", ".join(claimed) for recording, claimed in names.items()}


def _situation(context: Context) -> str:
    about = context.holding or context.support or ""
    return f"{context.activity} {about}".strip()


def evidence(recording: Recording, trace: Trace) -> Evidence:
    """Evidence of one measured window."""
    signal = _signal(recording, trace)
    return Evidence(
        _in_words(recording.context),
        f"{recording.start:.2f}–{recording.end:.2f} s",
        _reading(signal),
    )


def _in_words(context: Context) -> str:
    words: list[str] = [context.activity]
    if context.holding:
        words.append(f"holding {context.holding}")
    if context.support:
        words.append(f"on {context.support}")
    if context.at:
        words.append(f"at {context.at}")
    return ", ".join(words)


def _signal(recording: Recording, trace: Trace) -> _Signal:
    if recording.reading:
        return _Signal("reading", "", np.array(recording.reading))
    samples = trace.of(recording)
    if recording.buffer == FORCES:
        return _Signal("Fz", " N", samples.wrench[:, 2])
    return _Signal("fingertips z", " m", tip_height(samples, trace.hand))


def _reading(signal: _Signal) -> str:
    count = len(signal.values)
    if not count:
        return "no samples"
    std = max(float(signal.values.std()), FINEST)
    mean, std = rounded(float(signal.values.mean()), std)
    samples = "1 sample" if count == 1 else f"{count} samples"
    return f"{signal.name} = {mean} ± {std}{signal.unit}, {samples}"
