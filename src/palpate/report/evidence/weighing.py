"""How heavy: the force with the object in the hand, against that of the empty hand on the same way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from palpate.estimation.estimate import rounded
from palpate.estimation.load.segments import Segment, weighing
from palpate.geometry.pose import Array
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.samples import Trace

AROUND = 0.6
"""s shown before the first segment and after the last."""
HANGING = [2, 3, 4]
"""What a hanging load is felt by, of a wrench: F_z, M_x and M_y."""
KINDS = {"up": "on the way up", "down": "on the way down", "rest": "at rest"}


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """One bin: where on the lift (m), and the mass (kg) that it says, with its standard deviation."""

    kind: str
    path: float
    mass: float
    std: float


def weighed_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """The force over time with all segments, and what each bin of them says the object weighs."""
    recording = trace.converted(measured.estimate.parameter)
    if recording is None:
        return ()
    segments = sorted(weighing(trace, recording).segments, key=lambda segment: segment.start)
    if not segments:
        return ()
    drawn = [_over_time(segments, trace)]
    places = list(_places(segments, trace.gravity))
    if places:
        drawn.append(_by_place(places, measured))
    return tuple(drawn)


def _force(felt: Array, variance: Array, maps: Array) -> tuple[Array, Array]:
    """(k,) F_z of signals (k, m), N, with its standard deviation by white noise: the hanging load that
    explains them best."""
    forces: list[float] = []
    stds: list[float] = []
    for signals, noise, turned in zip(felt, variance, maps[:, :, HANGING], strict=True):
        # Signals without noise weigh alike.
        weights = 1.0 / np.sqrt(noise) if noise.all() else np.ones(len(noise))
        design = turned * weights[:, None]
        normal: Array = design.T @ design
        covariance = np.asarray(np.linalg.pinv(normal), dtype=np.float64)
        forces.append(float((covariance @ design.T @ (signals * weights))[0]))
        stds.append(float(np.sqrt(covariance[0, 0])))
    return np.array(forces), np.array(stds)


def _over_time(segments: Sequence[Segment], trace: Trace) -> Chart:
    t, wrench = trace.samples.t, trace.samples.wrench
    start, end = segments[0].start - AROUND, max(one.end for one in segments) + AROUND
    shown = (t >= start) & (t <= end)
    forces = [_force(one.felt, one.variance, one.maps)[0] for one in segments]
    sheet = Sheet((start, end), span(np.concatenate(forces), 0.25))
    for segment in segments:
        sheet.band("loaded" if segment.loaded else "empty", (segment.start, segment.end))
    sheet.line("felt", t[shown], wrench[shown, 2])
    for segment, force in zip(segments, forces, strict=True):
        kind = "mean loaded" if segment.loaded else "mean"
        if len(force) == 1:
            sheet.level(kind, float(force[0]), (segment.start, segment.end))
        else:
            order = np.argsort(segment.t)
            sheet.line(kind, segment.t[order], force[order])
    for loaded, kind in ((True, "loaded"), (False, "empty")):
        of = [(s, f) for s, f in zip(segments, forces, strict=True) if s.loaded == loaded]
        if of:
            mean = float(np.mean(np.concatenate([force for _, force in of])))
            longest, force = max(of, key=lambda one: one[0].end - one[0].start)
            sheet.note(kind, longest.start, float(force.max()), f"{kind}: {mean:.3f} N")
    return sheet.chart(
        "The force while it was weighed.",
        "Every stretch that is used is shaded; what lies between them (touching, gripping, setting down) is "
        "not used. The thick lines are the force without what the arm's own links took to move.",
        ("robot time (s)", "F_z (N)"),
        (
            ("line", "F_z as felt"),
            ("mean", "of it, without the arm's own motion"),
            ("loaded", "with the object"),
            ("empty", "empty hand"),
        ),
    )


def _places(segments: Sequence[Segment], gravity: float) -> Iterator[Place]:
    """Each bin with the object, less the mean of the empty hand at the same places in the same kind of
    motion; over gravity and what it was accelerated with."""
    along = [segment for segment in segments if not segment.turns]
    for kind, group in groupby(sorted(along, key=_kind), key=_kind):
        of = list(group)
        empty = [segment for segment in of if not segment.loaded]
        for segment in of:
            if not segment.loaded or not empty:
                continue
            beside = np.mean([_at(segment.path, one.path, one.felt) for one in empty], axis=0)
            noise = [_at(segment.path, one.path, one.variance) for one in empty]
            variance = segment.variance + np.mean(noise, axis=0) / len(empty)
            force, std = _force(segment.felt - beside, variance, segment.maps)
            scale = gravity + segment.acceleration
            rows = zip(segment.path, force / scale, std / scale, strict=True)
            for path, mass, unsure in rows:
                yield Place(kind.split()[0], float(path), float(mass), float(unsure))


def _kind(segment: Segment) -> str:
    return segment.kind


def _at(wanted: Array, path: Array, values: Array) -> Array:
    """(k, m) of values at places along the lift."""
    order = np.argsort(path)
    found = np.empty((len(wanted), values.shape[1]))
    for i in range(values.shape[1]):
        found[:, i] = np.interp(wanted, path[order], values[order, i])
    return found


def _by_place(places: Sequence[Place], measured: Measured) -> Chart:
    estimate = measured.estimate
    value, std = float(estimate.value[0]), float(estimate.std[0])
    low, high = estimate.ci95[0].tolist()
    masses = np.array([place.mass for place in places])
    stds = np.array([place.std for place in places])
    weights = stds**-2.0
    mean = float(weights @ masses / weights.sum())
    ends = np.array([*(masses - value), low - value, high - value])
    off = 1e3 * ends
    sheet = Sheet(span(1e3 * np.array([place.path for place in places]), 0.06), span(off, 0.12))
    sheet.band("interval", sheet.x, (1e3 * (low - value), 1e3 * (high - value)))
    sheet.level("fit", 0.0)
    if measured.truth:
        sheet.level("truth", 1e3 * (measured.truth[0] - value))
    for place in places:
        sheet.dot(place.kind, 1e3 * place.path, 1e3 * (place.mass - value), 1e3 * place.std)
    shown, spread = rounded(value, std)
    sheet.note("fit", sheet.x[0], 0.0, f"{shown} ± {spread} kg")
    legend = [("fit", "the estimate"), ("interval", "its 95 % interval")]
    if measured.truth:
        legend.append(("true", "the truth"))
    there = {place.kind for place in places}
    legend += [(kind, words) for kind, words in KINDS.items() if kind in there]
    return sheet.chart(
        "What each place says it weighs, beside the estimate.",
        f"(F_z with the object − F_z of the empty hand) / (g + a), place by place, on the same way in the same "
        f"direction: {len(places)} places, whose mean by their noise is {mean:.4f} kg. The estimate is made of the "
        "same signals at once; it also knows that joints rub, and how slowly errors change.",
        ("along the lift (mm)", "beside the estimate (g)"),
        legend,
    )
