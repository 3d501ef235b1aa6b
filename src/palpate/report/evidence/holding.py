"""Charts of a centre of mass: moment over weight, grasp by grasp."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.estimation.load.segments import Segment, weighings
from palpate.geometry.pose import Array
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.samples import Trace

MOMENTS = ("M_x", "M_y")


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """Rest with the object: time (s), lever of its weight from the TCP along world x and y (m),
    place of the TCP when the fingers closed (m), and the weight (N)."""

    time: float
    lever: Array
    fingers: Array
    weight: float


def held_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """The horizontal moments, loaded and empty, and the levers that follow from them."""
    evidence = measured.estimate.evidence
    if not evidence:
        return ()
    rests: list[Segment] = []
    for found in weighings(trace, evidence[0]):
        rests += [segment for segment in found.segments if segment.at_rest]
    levers = list(_levers(rests, trace))
    if not levers:
        return ()
    return _moments(rests, trace), _places(levers, float(measured.estimate.stds[:2].max()))


def _mean(segment: Segment, trace: Trace) -> Array:
    """(6,) the wrench of a rest."""
    mean: Array = trace.samples.between(segment.start, segment.end).wrench.mean(axis=0)
    return mean


def _levers(rests: list[Segment], trace: Trace) -> Iterator[Pull]:
    """Levers of each loaded rest. The hand bears a load at r with the moment r x (0, 0, F)."""
    samples = trace.samples
    for segment in rests:
        empty = [one for one in rests if not one.loaded]
        alike = [one for one in empty if one.kind == segment.kind] or empty
        nearest = sorted(alike, key=lambda one: abs(one.start - segment.start))[:2]
        if not segment.loaded or not nearest:
            continue
        beside = np.mean([_mean(one, trace) for one in nearest], axis=0)
        load = _mean(segment, trace) - beside
        lever = np.array([-load[4], load[3]]) / load[2]
        gripped = min(int(np.searchsorted(samples.t, segment.grasp)), len(samples.t) - 1)
        fingers = samples.pose_world_tcp[gripped, :2]
        yield Pull((segment.start + segment.end) / 2, lever, fingers, float(load[2]))


def _moments(rests: list[Segment], trace: Trace) -> Chart:
    first, last = min(r.start for r in rests) - 0.6, max(r.end for r in rests) + 0.6
    samples = trace.samples.between(first, last)
    means = np.array([_mean(rest, trace)[3:5] for rest in rests])
    axis = 3 + int(np.argmax(np.ptp(means, axis=0)))
    name = MOMENTS[axis - 3]
    sheet = Sheet((first, last), span(means, 0.5))
    for rest in rests:
        sheet.band("loaded" if rest.loaded else "empty", (rest.start, rest.end))
    sheet.line("felt", samples.t, samples.wrench[:, axis])
    for rest in rests:
        kind = "mean loaded" if rest.loaded else "mean"
        level = float(_mean(rest, trace)[axis])
        sheet.level(kind, level, (rest.start, rest.end))
        if rest.loaded:
            sheet.note("loaded", rest.start, level, f"{level:.3f}")
    return sheet.chart(
        "The moment on the fingers.",
        "It is compared where the hand was at rest, with the object and without, at the same place.",
        ("robot time (s)", f"{name} (N·m)"),
        (("line", f"{name} as felt"), ("loaded", "with the object"), ("empty", "empty hand")),
    )


def _places(pulls: list[Pull], std: float) -> Chart:
    centres = np.array([pull.fingers + pull.lever for pull in pulls])
    mean = centres.mean(axis=0)
    off = 1e3 * (centres - mean)
    times = np.array([pull.time for pull in pulls])
    band = 1.96e3 * std
    sheet = Sheet(span(times, 0.12), span(np.append(off.ravel(), [-band, band]), 0.15))
    sheet.band("interval", sheet.x, (-band, band))
    sheet.level("fit", 0.0)
    for pull, beside in zip(pulls, off.tolist(), strict=True):
        sheet.dot("up", pull.time, beside[0])
        sheet.dot("rest", pull.time, beside[1])
        sheet.note("fit", pull.time, beside[0], f"{1e3 * pull.lever[0]:+.1f} mm")
    weights = ", ".join(f"{pull.weight:.2f}" for pull in pulls)
    return sheet.chart(
        "Where each grasp puts the centre of mass.",
        f"Moment over weight ({weights} N) is how far from the fingers it lies (the numbers at the dots, along x); "
        f"added to where the fingers closed, each grasp names the same place in the world: x {mean[0]:.4f} m, "
        f"y {mean[1]:.4f} m. The estimate also knows by how much the object turned in the grip, and carries it "
        "into the frame of the body as the scene has it.",
        ("robot time (s)", "beside their mean (mm)"),
        (
            ("up", "along world x"),
            ("rest", "along world y"),
            ("interval", "95 % interval of the estimate"),
        ),
    )
