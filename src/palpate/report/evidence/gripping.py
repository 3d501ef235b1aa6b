"""Charts of size and position: opening and place of the fingers as they closed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.estimation.windows import mean_pose
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace

BEFORE = 0.4
"""s before the fingers began to close that are shown."""
Closing = tuple[Recording, Samples]
"""Recording of a hold, with the samples from shortly before the fingers closed."""


def gripped_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """The opening of the fingers, for each time that it was held."""
    return tuple(_opening(*one, measured) for one in _closings(measured, trace))


def centred_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """Chart of the hand's position along the closing direction."""
    return tuple(_place(*one, measured) for one in _closings(measured, trace))


def _closings(measured: Measured, trace: Trace) -> Iterator[Closing]:
    for recording in measured.estimate.evidence:
        closed = [leaf for leaf in trace.leaf_runs("CloseGripper") if leaf.end <= recording.start]
        if recording.context.holding is not None and closed:
            yield recording, trace.samples.between(closed[-1].start - BEFORE, recording.end)


def _opening(recording: Recording, samples: Samples, measured: Measured) -> Chart:
    held = 1e3 * float(np.median(samples.between(recording.start, recording.end).width))
    values = 1e3 * measured.estimate.values
    axis = int(np.abs(values - held).argmin())
    value, std = float(values[axis]), 1e3 * float(measured.estimate.stds[axis])
    opening = 1e3 * samples.width
    ends = [held, value - 2.0 * std, value + 2.0 * std]
    sheet = Sheet((float(samples.t[0]), float(samples.t[-1])), span(np.append(opening, ends), 0.1))
    sheet.band("interval", sheet.x, (value - 2.0 * std, value + 2.0 * std))
    sheet.band("loaded", (recording.start, recording.end))
    sheet.line("felt", samples.t, opening)
    sheet.level("fit", value)
    if measured.truth:
        sheet.level("truth", 1e3 * measured.truth[axis])
    sheet.note("fit", float(samples.t[0]), value, f"{value:.2f} mm")
    legend = [
        ("line", "between the fingers"),
        ("loaded", "recorded"),
        ("fit", "the estimate"),
        ("interval", "± 2 std"),
    ]
    if measured.truth:
        legend.append(("true", "the truth"))
    return sheet.chart(
        f"The grasp before {recording.start:.1f} s.",
        f"The fingers stayed {held:.2f} mm apart; what the pads yield as they squeeze is added. It is the extent along "
        f"{'xyz'[axis]} of the object.",
        ("robot time (s)", "opening (mm)"),
        legend,
    )


def _place(recording: Recording, samples: Samples, measured: Measured) -> Chart:
    hand = mean_pose(samples.between(recording.start, recording.end))
    closing = hand.rotation[:2, 1] / np.linalg.norm(hand.rotation[:2, 1])
    std = 1e3 * float(np.linalg.norm(closing * measured.estimate.stds))
    place = 1e3 * ((samples.pose_world_tcp[:, :2] - hand.position[:2]) @ closing)
    ends = [-2.0 * std, 2.0 * std]
    sheet = Sheet((float(samples.t[0]), float(samples.t[-1])), span(np.append(place, ends), 0.2))
    sheet.band("interval", sheet.x, (ends[0], ends[1]))
    sheet.band("loaded", (recording.start, recording.end))
    sheet.line("felt", samples.t, place)
    sheet.level("fit", 0.0)
    heading = float(np.degrees(np.arctan2(closing[1], closing[0])))
    return sheet.chart(
        f"The grasp before {recording.start:.1f} s.",
        f"The fingers close along {heading:.0f}° from world x and centre the object between them: there its middle is "
        "where the hand is. Across that nothing is felt, and it is where the scene has it.",
        ("robot time (s)", "hand, along that (mm)"),
        (("line", "the hand"), ("loaded", "recorded"), ("interval", "± 2 std along that")),
    )
