"""Measured values of a fit against its predictions, for charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.estimation import tuning
from palpate.geometry.pose import Array
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitView:
    """Points of one fit: measured values, the fit's predictions and standard deviations.

    Attributes:
        name: title.
        note: how to read it, one or two sentences.
        axes: labels of `x` and of the values, each with its unit.
        x: (n,) abscissa.
        measured, predicted: (n,) in one unit; NaN in `measured` breaks a curve.
        std: (n,) of `measured` about `predicted`, or one for all; 0 where it is not stated.
        used: (n,) rows that the fit rests on; None for all.
        groups: (n,) words for the legend, at most three different ones, or one for all.
        slopes: (n, p) change of `predicted` with each of the p components of the estimate, for its
            interval and the truth; None where the estimate does not determine `predicted`.
    """

    name: str
    note: str
    axes: tuple[str, str]
    x: Array
    measured: Array
    predicted: Array
    std: Array | float = 0.0
    used: Mask | None = None
    groups: Sequence[str] | str = "measured"
    slopes: Array | None = None


def constant(value: float, like: ArrayLike) -> Array:
    """(n,) the same prediction for every point of `like`."""
    return np.full(len(np.atleast_1d(like)), value)


def unit_slopes(like: ArrayLike, component: int = 0, of: int = 1, scale: float = 1.0) -> Array:
    """(n, of) slopes of predictions that are a component of the estimate, times `scale`."""
    return np.tile(scale * np.eye(of)[component], (len(np.atleast_1d(like)), 1))


def closing_samples(trace: Trace, recording: Recording) -> Samples | None:
    """Samples from shortly before the fingers closed to the end of a recording of a held object;
    None where they never closed."""
    closed = [leaf for leaf in trace.leaf_runs("CloseGripper") if leaf.end <= recording.start]
    if recording.context.holding is None or not closed:
        return None
    return trace.samples.between(closed[-1].start - tuning.VIEW_CLOSING, recording.end)
