"""Held-out validation on the page: predicted and measured joint torques, in words and as small plots."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from palpate.estimation.estimate import rounded
from palpate.geometry.pose import Array
from palpate.runs.figures import significant
from palpate.twin.held_out.judged import Curve, HeldOut, Motion

SHOWN = 3
"""Panels of a motion: the signals that the object acts on most."""
GAP = 0.4
"""s between two bins of a signal from which no line joins them."""
WIDTH, HEIGHT, EDGE = 300.0, 130.0, 8.0
"""Size of a panel, and its margin."""


@dataclass(frozen=True, slots=True)
class Point:
    """A measured mean, and one standard deviation to either side, in the panel."""

    x: float
    y: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Panel:
    """Signal: `low` to `high` in `unit` from bottom to top, from `start` to `end` in s; lines as
    SVG points."""

    name: str
    unit: str
    low: str
    high: str
    start: str
    end: str
    points: tuple[Point, ...]
    twin: tuple[str, ...]
    template: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Prediction:
    """A motion in words, with its panels."""

    title: str
    agrees: bool
    said: str
    disagreement: str
    panels: tuple[Panel, ...]


def predictions(held: HeldOut | None) -> list[Prediction]:
    """Panels of predictions, one per motion."""
    found: list[Prediction] = []
    for motion in held.motions if held is not None else ():
        title = motion.motion[:1].upper() + motion.motion[1:]
        panels = tuple(signal_panels(motion.curve))
        found.append(
            Prediction(title, motion.agrees, prediction_text(motion), motion.disagreement, panels)
        )
    return found


def prediction_text(motion: Motion) -> str:
    way = "more" if motion.weight > 0 else "less"
    weight, std = rounded(1e3 * abs(motion.weight), 1e3 * motion.weight_std)
    return (
        f"The joint torques were predicted to {significant(1e3 * motion.rms, 2)} mN·m (root mean square), where "
        f"the scene as given would have been {significant(1e3 * motion.rms_template, 3)} mN·m off. Against what noise "
        f"and uncertainty allow, χ² is {motion.chi2:.0f} at {motion.dof} degrees of freedom (p = {motion.p:.2g}), and "
        f"{motion.chi2_template:.0f} for the scene as given. The {motion.object} weighed {weight} ± {std} g "
        f"{way} than predicted."
    )


def signal_panels(curve: Curve) -> Iterator[Panel]:
    """Panels of the signals with the largest predicted values, in the curve's order."""
    t = np.array(curve.t)
    peaks = np.abs(np.array(curve.twin)).max(axis=1)
    # Joints on which the object has no lever show noise alone.
    largest: list[int] = np.argsort(-peaks, kind="stable").tolist()
    breaks: list[int] = (np.flatnonzero(np.diff(t) > GAP) + 1).tolist()
    parts = [slice(first, last) for first, last in pairwise([0, *breaks, len(t)])]
    for i in sorted(largest[:SHOWN]):
        twin, guess = np.array(curve.twin[i]), np.array(curve.template[i])
        measured, std = np.array(curve.measured[i]), np.array(curve.std[i])
        spread = np.concatenate([twin, guess, measured - std, measured + std])
        low, high = float(spread.min()), float(spread.max())
        x = scaled_to_pixels(t, (float(t[0]), float(t[-1])), (EDGE, WIDTH - EDGE))
        up = partial(scaled_to_pixels, ends=(low, high), pixels=(HEIGHT - EDGE, EDGE))
        columns = (x, up(measured), up(measured - std), up(measured + std))
        signal = curve.signals[i]
        _, joint, number = signal.rpartition("joint")  # `fr3_joint4` is joint 4
        yield Panel(
            name=f"joint {number.strip('_')}" if joint else signal,
            unit="N" if signal.startswith("F") else "N·m",
            low=f"{low:.3g}",
            high=f"{high:.3g}",
            start=f"{t[0]:.1f}",
            end=f"{t[-1]:.1f}",
            points=tuple(Point(*row) for row in np.column_stack(columns).tolist()),
            twin=tuple(polyline(x[part], up(twin)[part]) for part in parts),
            template=tuple(polyline(x[part], up(guess)[part]) for part in parts),
        )


def scaled_to_pixels(
    values: Array, ends: tuple[float, float], pixels: tuple[float, float]
) -> Array:
    """Map `values` linearly from `ends` to `pixels`, to a tenth of a pixel."""
    share = (values - ends[0]) / max(ends[1] - ends[0], 1e-9)
    return np.asarray(np.round(pixels[0] + (pixels[1] - pixels[0]) * share, 1), dtype=np.float64)


def polyline(x: Array, y: Array) -> str:
    points = list(zip(x.tolist(), y.tolist(), strict=True))
    if len(points) == 1:  # a single point is drawn as a short dash
        middle, height = points[0]
        points = [(middle - EDGE, height), (middle + EDGE, height)]
    return " ".join(f"{a:g},{b:g}" for a, b in points)
