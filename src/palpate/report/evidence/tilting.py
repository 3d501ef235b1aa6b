"""Charts of a centre of mass along gravity: displacement of the weight's line of action with the
tilt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.estimation.holds import tilted_holds
from palpate.estimation.load.segments import Weighing
from palpate.estimation.windows import mean_pose
from palpate.geometry.pose import Array, Pose
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.report.evidence.holding import held_charts
from palpate.trace.samples import Samples, Trace

LEVEL = np.radians(1.0)
"""rad: a hand that leans by less counts as level."""


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """Part of a tilt.

    Attributes:
        turning: not at rest.
        tool: (3,) the direction out of the hand, world.
        lever: (2,) m, how far from the fingers the weight pulls, along world x and y.
    """

    turning: bool
    tool: Array
    lever: Array


def balanced_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """Charts of level holds, and one per direction of tilt."""
    level = held_charts(measured, trace)
    tilts: dict[float, list[Pull]] = {}
    for recording, found in tilted_holds(trace, measured.estimate.parameter.object):
        pull = _pull(trace, found)
        if pull is not None:
            tilts.setdefault(_turn(trace, recording.start), []).append(pull)
    return (*level, *_charts(list(tilts.values())))


def _turn(trace: Trace, time: float) -> float:
    """s, when the tilt that was under way at a time began."""
    begun = [leaf.start for leaf in trace.leaves if leaf.primitive == "Tilt" and leaf.start <= time]
    return max(begun, default=0.0)


def _charts(tilts: list[list[Pull]]) -> Iterator[Chart]:
    for pulls in tilts:
        leaning = np.array([pull.tool[:2] for pull in pulls])
        steepest = leaning[np.argmax(np.linalg.norm(leaning, axis=1))]
        if len(pulls) > 2 and np.linalg.norm(steepest) > np.sin(LEVEL):
            yield _chart(pulls, steepest / np.linalg.norm(steepest))


def _pull(trace: Trace, found: Weighing) -> Pull | None:
    """Of the load alone: with the object less with the empty hand, turned alike."""
    with_it = [one for one in found.segments if one.loaded]
    without = [one for one in found.segments if not one.loaded]
    if not with_it or not without:
        return None
    (loaded, *_), (empty, *_) = with_it, without
    here = trace.samples.between(loaded.start, loaded.end)
    load = _mean(here) - _mean(trace.samples.between(empty.start, empty.end))
    lever = np.array([-load[4], load[3]]) / load[2]
    hand: Pose = mean_pose(here)
    return Pull(not loaded.at_rest, hand.rotation[:, 2], lever)


def _mean(samples: Samples) -> Array:
    """(6,) the mean wrench."""
    mean: Array = samples.wrench.mean(axis=0)
    return mean


def _chart(pulls: list[Pull], aside: Array) -> Chart:
    """The lever along `aside` (2,), to which the hand leans, over how far it leans: d cos a + h sin a for
    a centre of mass d beside the fingers and h below them."""
    sines = np.array([pull.tool[:2] @ aside for pull in pulls])
    levers = np.array([pull.lever @ aside for pull in pulls])
    cosines = np.sqrt(1.0 - sines**2)
    (beside, below), *_ = np.linalg.lstsq(np.column_stack([cosines, sines]), levers, rcond=None)
    angles = np.degrees(np.arcsin(sines))
    across = span(angles)
    curve = np.radians(np.linspace(*across, 60))
    fit = 1e3 * (beside * np.cos(curve) + below * np.sin(curve))
    sheet = Sheet(across, span(np.concatenate([1e3 * levers, fit]), 0.2))
    sheet.line("fit", np.degrees(curve), fit)
    for pull, angle, lever in zip(pulls, angles.tolist(), (1e3 * levers).tolist(), strict=True):
        sheet.dot("up" if pull.turning else "rest", angle, lever)
    heading = float(np.degrees(np.arctan2(aside[1], aside[0]))) % 360.0
    worst = 1e3 * float(np.abs(levers - beside * cosines - below * sines).max())
    where = "below" if below > 0.0 else "above"
    return sheet.chart(
        f"Tilted towards {heading:.0f}° from world x.",
        "Held level, a load says nothing of its height. As the hand leans, a centre of mass below the fingers "
        "moves aside, and its weight pulls there: these bits alone put it "
        f"{1e3 * abs(below):.1f} mm {where} the fingers, and the curve leaves at most {worst:.1f} mm of a bit. "
        "The estimate weighs all tilts and holds by their noise, and allows for how the load droops in the pads.",
        ("how far the hand leans (°)", "moment over weight (mm)"),
        (("up", "while it turns"), ("rest", "at rest"), ("fit", "one centre of mass")),
    )
