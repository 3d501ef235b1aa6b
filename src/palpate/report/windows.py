"""Measured windows: the parameters that each recording is evidence of, its situation and its reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation.contact.descent import tip_height
from palpate.estimation.estimate import Estimate, rounded
from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

FINEST = 1e-5
"""N or m: least spread of a recording that is shown."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Measured window: situation, time and reading."""

    what: str
    when: str
    reading: str


def quantity_label(id: str) -> str:
    """The quantity's name in words; its id if the catalogue lacks it."""
    return catalogue()[id].label if id in catalogue() else id


def windows(trace: Trace, estimates: Sequence[Estimate]) -> dict[Recording, str]:
    """Name of each recording: the parameters whose estimates or conversions use it, else its
    situation."""
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
    """Describe one measured window."""
    context = recording.context
    words: list[str] = [context.activity]
    if context.holding:
        words.append(f"holding {context.holding}")
    if context.support:
        words.append(f"on {context.support}")
    if context.at:
        words.append(f"at {context.at}")
    when = f"{recording.start:.2f}–{recording.end:.2f} s"
    return Evidence(", ".join(words), when, reading_text(recording, trace))


def reading_text(recording: Recording, trace: Trace) -> str:
    """Mean ± standard deviation of the recording's main signal, and the number of samples."""
    samples = trace.of(recording)
    if recording.reading:
        name, unit, values = "reading", "", np.array(recording.reading)
    elif recording.buffer == FORCES:
        name, unit, values = "Fz", " N", samples.wrench[:, 2]
    else:
        name, unit, values = "fingertips z", " m", tip_height(samples, trace.hand)
    count = len(values)
    if not count:
        return "no samples"
    mean, std = rounded(float(values.mean()), max(float(values.std()), FINEST))
    return f"{name} = {mean} ± {std}{unit}, {'1 sample' if count == 1 else f'{count} samples'}"
