"""Recordings behind the estimates: names for the timeline, and the reading of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation.estimate import Estimate, rounded
from palpate.estimation.motion import tip_height
from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

FINEST = 1e-5
"""N or m: least standard deviation of a recording that is shown."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Recording as the report lists it: situation, time and reading."""

    what: str
    when: str
    reading: str


def quantity_label(id: str) -> str:
    """Label of a quantity, or the id itself where it is not in the catalogue."""
    return catalogue()[id].label if id in catalogue() else id


def windows(trace: Trace, estimates: Sequence[Estimate]) -> dict[Recording, str]:
    """Every recording with the names of the parameters that it is evidence of, by the estimates and the
    conversions; with its situation where it is evidence of none."""
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
            context = recording.context
            about = context.holding or context.support or ""
            claimed.append(f"{context.activity} {about}".strip())
    return {recording: ", ".join(claimed) for recording, claimed in names.items()}


def evidence(recording: Recording, trace: Trace) -> Evidence:
    """Situation, time and reading of a recording."""
    context = recording.context
    words: list[str] = [context.activity]
    if context.holding:
        words.append(f"holding {context.holding}")
    if context.support:
        words.append(f"on {context.support}")
    if context.at:
        words.append(f"at {context.at}")
    when = f"{recording.start:.2f}–{recording.end:.2f} s"
    return Evidence(", ".join(words), when, _reading(recording, trace))


def _reading(recording: Recording, trace: Trace) -> str:
    """Mean, standard deviation and number of samples of the signal that a recording is about."""
    if recording.reading:
        name, unit, values = "reading", "", np.array(recording.reading)
    else:
        samples = trace.of(recording)
        name, unit, values = "fingertips z", " m", tip_height(samples, trace.hand)
        if recording.buffer == FORCES:
            name, unit, values = "Fz", " N", samples.wrench[:, 2]
    if not len(values):
        return "no samples"
    std = max(float(values.std()), FINEST)
    mean, spread = rounded(float(values.mean()), std)
    number = "1 sample" if len(values) == 1 else f"{len(values)} samples"
    return f"{name} = {mean} ± {spread}{unit}, {number}"
