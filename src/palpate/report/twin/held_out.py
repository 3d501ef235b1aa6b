"""Motions that were held out: what was predicted of them and what was felt, in words and as small
plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.estimation.estimate import rounded
from palpate.geometry.pose import Array
from palpate.runs.figures import significant
from palpate.twin.held_out.judged import Curve, HeldOut, Motion

SHOWN = 3
"""Panels a motion: the signals that feel most of the object."""
GAP = 0.4
"""s between two bins of a signal from which no line joins them."""
WIDTH, HEIGHT, EDGE = 300.0, 130.0, 8.0
"""Of a panel, and how much of it stays free at its edges."""


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
        panels = tuple(_panels(motion.curve))
        found.append(Prediction(title, motion.agrees, _said(motion), motion.disagreement, panels))
    return found


def _said(motion: Motion) -> str:
    way = "more" if motion.weight > 0 else "less"
    weight, std = rounded(1e3 * abs(motion.weight), 1e3 * motion.weight_std)
    return (
        f"The joint torques were predicted to {significant(1e3 * motion.rms, 2)} mN·m (root mean square), where "
        f"the scene as given would have been {significant(1e3 * motion.rms_template, 3)} mN·m off. Against what noise "
        f"and uncertainty allow, χ² is {motion.chi2:.0f} at {motion.dof} degrees of freedom (p = {motion.p:.2g}), and "
        f"{motion.chi2_template:.0f} for the scene as given. The {motion.object} weighed {weight} ± {std} g "
        f"{way} than predicted."
    )


def _panels(curve: Curve) -> list[Panel]:
    felt = np.abs(np.array(curve.twin)).max(axis=1)
    most = np.argsort(-felt, kind="stable")[:SHOWN]
    return [_panel(curve, int(i)) for i in sorted(most.tolist())]


def _panel(curve: Curve, i: int) -> Panel:
    t, twin, guess = np.array(curve.t), np.array(curve.twin[i]), np.array(curve.template[i])
    felt, std = np.array(curve.measured[i]), np.array(curve.std[i])
    spread = np.concatenate([twin, guess, felt - std, felt + std])
    low, high = float(spread.min()), float(spread.max())

    def across(values: Array) -> Array:
        share: Array = (values - t[0]) / max(float(t[-1] - t[0]), 1e-9)
        return np.asarray(np.round(EDGE + (WIDTH - 2 * EDGE) * share, 1), dtype=np.float64)

    def up(values: Array) -> Array:
        share: Array = (values - low) / max(high - low, 1e-9)
        return np.asarray(
            np.round(HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * share, 1), dtype=np.float64
        )

    x = across(t)
    columns = (x, up(felt), up(felt - std), up(felt + std))
    points = tuple(Point(*row) for row in np.column_stack(columns).tolist())
    lines = [tuple(_line(x, up(values), part) for part in _parts(t)) for values in (twin, guess)]
    unit = "N" if curve.signals[i].startswith("F") else "N·m"
    ends = (f"{low:.3g}", f"{high:.3g}", f"{t[0]:.1f}", f"{t[-1]:.1f}")
    return Panel(_name(curve.signals[i]), unit, *ends, points, *lines)


def _name(signal: str) -> str:
    """`joint 4` of `fr3_joint4`."""
    _, found, number = signal.rpartition("joint")
    return f"joint {number.strip('_')}" if found else signal


def _parts(t: Array) -> Sequence[slice]:
    """Rows that a line joins."""
    breaks: list[int] = (np.flatnonzero(np.diff(t) > GAP) + 1).tolist()
    return [slice(first, last) for first, last in pairwise([0, *breaks, len(t)])]


def _line(x: Array, y: Array, rows: slice) -> str:
    points = list(zip(x[rows].tolist(), y[rows].tolist(), strict=True))
    if len(points) == 1:
        middle, height = points[0]
        points = [(middle - EDGE, height), (middle + EDGE, height)]
    return " ".join(f"{a:g},{b:g}" for a, b in points)
