"""Measured values of a fit against its predictions, for charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitView:
    """Points of one fit: measured values, the fit's predictions and standard deviations.

    Attributes:
        name: title.
        note: how to read it, one or two sentences.
        axes: labels of `x` and of the values, each with its unit.
        x: (n,) abscissa.
        measured, predicted: (n,) in one unit.
        std: (n,) of `measured` about `predicted`; 0 where it is not stated.
        groups: (n,) words for the legend, at most three different ones.
        component: component of the estimate that `predicted` is, in the estimate's unit times
            `scale`; None where it is something else.
        scale: what the estimate's unit is multiplied with.
        windows: (start, end) in `x` of the samples used; empty where the points show that.
    """

    name: str
    note: str
    axes: tuple[str, str]
    x: Array
    measured: Array
    predicted: Array
    std: Array
    groups: Sequence[str]
    component: int | None = None
    scale: float = 1.0
    windows: Sequence[tuple[float, float]] = ()


def constant(value: float, like: ArrayLike) -> Array:
    """(n,) the same prediction for every point of `like`."""
    return np.full(len(np.atleast_1d(like)), value)
