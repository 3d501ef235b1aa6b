"""Prediction of the joint torques by an object in a motion, from its estimates, against the
measured ones.

Loaded rests and passes y, of which the motion consists, are predicted from those of the empty hand
along the same path, y_0, and the load's wrench w = (F, M_x, M_y):

    y = X w + E[bias | y_0] + error,   S = cov(bias | y_0) + X cov(w) X^T + gains

The bias of the arm (friction, drift, noise) has the covariance that a weighing has for it
(`estimation.load.equations`), and what the empty hand showed of it is taken off (conditional normal
distribution, e.g. Bishop, Pattern Recognition and Machine Learning, section 2.3.1). A gain error is
in the belief and in the motion alike: it counts with its difference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.load.equations import FORCE_Z, SIDEWAYS, TORQUE_X, TORQUE_Y, Rows, equations
from palpate.estimation.load.observation import gain_root
from palpate.estimation.load.segments import Segment, Weighing
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

LOAD = (FORCE_Z, TORQUE_X, TORQUE_Y)
"""Columns of a wrench that a weight has."""
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """Believed wrench of a load on the hand.

    Attributes:
        value: (3,) F in N, M_x and M_y about the TCP in N m, world axes.
        covariance: (3, 3) of it, without the gains.
        gains: (3, m) what one standard deviation of the gain of each of m signals did to it.
    """

    value: Array
    covariance: Array
    gains: Array


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """A motion in n rows, signal by signal and in each of the m signals k bins.

    Attributes:
        t: (k,) s.
        felt: (m, k) what the load made of the signals, by the empty hand.
        expected: (m, k) by the belief.
        left: (n,) felt less expected.
        covariance: (n, n) of it.
        design: (n, 3) what unit wrenches make of the rows.
        freedom: degrees of freedom of the noise.
    """

    t: Array
    felt: Array
    expected: Array
    left: Array
    covariance: Array
    design: Array
    freedom: float

    @property
    def misfit(self) -> float:
        """Sum of as many squares of unit variance as there are rows."""
        return float(self.left @ np.linalg.solve(self.covariance, self.left))

    def beyond(self) -> tuple[Array, Array]:
        """(3,) the wrench that the belief lacks, and its covariance (3, 3)."""
        information = self.design.T @ np.linalg.solve(self.covariance, self.design)
        covariance: Array = np.linalg.inv(information).astype(np.float64)
        return covariance @ self.design.T @ np.linalg.solve(self.covariance, self.left), covariance

    def instead(self, wrench: Array) -> Predicted:
        """The same motion, had the belief been another `wrench` (3,), as sure."""
        expected = self.design @ wrench
        return replace(
            self,
            expected=expected.reshape(self.felt.shape),
            left=self.felt.ravel() - expected,
        )


def predicted(
    weighing: Weighing, motion: Sequence[Segment], wrench: Wrench, gravity: float, hand: Hand
) -> Predicted | None:
    """The segments of `motion` by the empty ones of `weighing`; None without either of them.

    Where the arm changes its speed it is its own inertia that is judged, and left out.
    """
    empty = [segment for segment in weighing.segments if not segment.loaded]
    if not motion or not empty:
        return None
    segments = [*motion, *empty]
    rows = equations(replace(weighing, segments=segments), gravity)
    signals = int(rows.signal.max()) + 1
    loaded = _each(segments, lambda s: np.full(len(s.t), s.loaded))
    steady = np.abs(_each(segments, lambda s: s.acceleration)) < tuning.STEADY
    told = np.tile(loaded & steady, signals)
    other = np.tile(~loaded, signals)
    if not told.any():
        return None

    bias = _bias(rows, wrench, hand, signals)
    carried, left = _conditional(bias, told, other)
    felt = rows.observed[told] - carried @ rows.observed[other]
    design = rows.wrench[:, LOAD][told]
    shape = (signals, -1)
    expected = design @ wrench.value
    return Predicted(
        _each(segments, lambda s: s.t)[loaded & steady],
        felt.reshape(shape),
        expected.reshape(shape),
        felt - expected,
        left + design @ wrench.covariance @ design.T,
        design,
        rows.freedom,
    )


def _bias(rows: Rows, wrench: Wrench, hand: Hand, signals: int) -> Array:
    """(n, n) covariance of what the arm adds to each of n rows: noise and drift, friction, gains, and
    what it is pushed aside by."""
    design = rows.wrench[:, LOAD]
    tilt = tuning.TILT * abs(float(wrench.value[0])) + tuning.FLOOR
    aside = rows.wrench[:, SIDEWAYS] * np.array([tilt, tilt, tilt * tuning.TORQUE_LEVER])
    borne = (design @ wrench.value)[:, None] * gain_root(hand, signals)[rows.signal]
    gained = borne - design @ wrench.gains
    rubbed = tuning.JOINT_LEVEL * rows.dahl
    stuck = hand.force_repeatability * rows.stiction.stuck
    bias = rows.root @ rows.root.T
    for causes in (aside, gained, rubbed, stuck):
        bias += causes @ causes.T
    return bias


def _conditional(bias: Array, told: Mask, other: Mask) -> tuple[Array, Array]:
    """Conditional of the rows `told` on the rows `other`: gain (t, o), and remaining covariance (t,
    t); Bishop, equations 2.81 and 2.82."""
    solved: Array = np.linalg.solve(bias[np.ix_(other, other)], bias[np.ix_(other, told)]).astype(
        np.float64
    )
    carried = solved.T
    return carried, bias[np.ix_(told, told)] - carried @ bias[np.ix_(other, told)]


def _each(segments: Sequence[Segment], of: Callable[[Segment], NDArray[Any]]) -> NDArray[Any]:
    """Something of each bin, in all segments."""
    return np.concatenate([of(segment) for segment in segments])
