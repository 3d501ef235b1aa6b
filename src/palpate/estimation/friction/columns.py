"""Design matrix of the sliding force: friction and all other unknowns, one column each.

A row of a drag in direction w (a unit vector), at the place r of the hand and the speed v, follows

    f_t = mu N                                  friction, which is sought; N is the normal force
        + N (w·θ)                               the support leans by θ
        + N (a cos 2φ + a' sin 2φ)              friction differs between axes; φ is the angle of w
        + N (z·r) + N c log2 v                  ... between places, or with the speed
        + A                                     the object is held, however hard it is pressed
        + w·(b + K r + ∇E3(r))                  a bias, and what pulls with the place: springs, cables
        + Σ_j l_j s_j t_j + h_i                 friction in the arm's joints, and what of it is
                                                another in every drag
        + Σ_j l_j τ_j g_j                       the gains of the joints' sensors

with l_j the force that a joint's torque seems to add to f_t - mu N, s_j which way the joint was
turned last, and τ_j the torque that it feels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.friction.drags import Drag
from palpate.estimation.load.observation import WrenchObservation, gain_root
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

Origin = Literal["arm", "scene"]

MU = 0
WAYS, AXES, PLACES, SPEED = slice(1, 3), slice(3, 5), slice(5, 7), slice(7, 8)
HELD, BIAS, SPRING, CURVE = slice(8, 9), slice(9, 11), slice(11, 14), slice(14, 18)
FIRST = 18
"""Columns of the arm begin here."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Linear unknowns of several drags.

    Attributes:
        of: for each drag (n, p), one row for each of its own.
        levers: for each drag (m,), N that noise of a newton metre in each joint adds to its force,
            or a newton in the wrench.
        expected: (p,) prior means.
        fixed: (p,) prior standard deviations.
        uneven: (p,) what is added to them for each part by which friction is uneven.
        joints, gains: which unknowns are the joints' friction and their gains.
    """

    of: tuple[Array, ...]
    levers: tuple[Array, ...]
    expected: Array
    fixed: Array
    uneven: Array
    joints: slice
    gains: slice

    def prior(self, share: float) -> Array:
        """(p,) standard deviations where friction is so uneven."""
        return self.fixed + share * self.uneven

    def shared(self, covariance: Array) -> Iterator[tuple[str, Origin, float]]:
        """Causes that are the same in other runs, whose they are, and what one standard deviation of
        each does to an unknown, by its `covariance` (p,) with all of them."""
        kinds: tuple[tuple[str, Origin, slice], ...] = (
            ("gain of joint", "arm", self.gains),
            ("friction of joint", "arm", self.joints),
            ("bend of the bias along the way", "arm", CURVE),
            ("lean of support", "scene", WAYS),
            ("what holds the object", "scene", HELD),
            ("what pulls with the place", "scene", SPRING),
        )
        for what, of, which in kinds:
            effects = -covariance[which] / self.fixed[which]
            for i, effect in enumerate(effects.tolist()):
                yield f"{what} {i + 1}", of, effect


def columns(drags: Sequence[Drag], observed: WrenchObservation, hand: Hand, mu: float) -> Columns:
    """All unknowns; the arm's columns and their priors are those at about `mu`."""
    middle, usual = middle_of(drags), usual_speed(drags)
    whole: list[Array] = []
    dahl: list[Array] = []
    for drag, mine in zip(drags, np.eye(len(drags)), strict=True):
        dahl_states, gains = _arm(drag, drags, observed, hand, mu)
        own = np.ones((len(drag.t), 1)) * mine
        whole.append(np.hstack([of_support(drag, middle, usual), dahl_states, own, gains]))
        dahl.append(dahl_states[drag.steady].mean(axis=0))

    # After those of the support: friction of the joints, one for each drag, gains.
    friction, unsure = _friction(drags[0], observed, len(dahl[0]))
    joints = slice(FIRST, FIRST + len(friction))
    each = slice(joints.stop, joints.stop + len(drags))
    gains = slice(each.stop, whole[0].shape[1])
    expected, fixed, uneven = np.zeros((3, gains.stop))
    fixed[MU], fixed[WAYS], fixed[HELD] = tuning.FRICTION_PRIOR, tuning.LEAN, tuning.HELD
    fixed[BIAS], fixed[SPRING], fixed[CURVE] = tuning.REFERRED, tuning.PULL, tuning.CURVE
    uneven[AXES] = uneven[PLACES] = uneven[SPEED] = mu
    expected[joints], fixed[joints] = friction, np.hypot(unsure, tuning.ANOTHER * friction)
    fixed[each] = np.hypot(tuning.DRAG_BIAS, tuning.ANOTHER_DRAG * (np.array(dahl) @ friction))
    fixed[gains] = 1.0
    levers = tuple(_lever(drag.q, drag, observed, mu) for drag in drags)
    return Columns(tuple(whole), levers, expected, fixed, uneven, joints, gains)


def _friction(drag: Drag, observed: WrenchObservation, count: int) -> tuple[Array, Array]:
    """(k,) what is expected of the arm's own friction, and the standard deviation: N m in each joint,
    or N on each line where nothing is known of joints."""
    if observed.chain is None:
        return np.zeros(count), np.full(count, tuning.KIND_BIAS)
    return drag.hanging.friction, drag.hanging.unsure


def middle_of(drags: Sequence[Drag]) -> Array:
    """(2,) m: the middle of all places."""
    places = np.vstack([drag.place[drag.steady] for drag in drags])
    middle: Array = (places.max(axis=0) + places.min(axis=0)) / 2
    return middle


def usual_speed(drags: Sequence[Drag]) -> float:
    """m/s."""
    speeds = np.concatenate([np.log2(drag.speed[drag.steady]) for drag in drags])
    return float(np.exp2(speeds.mean()))


def of_support(drag: Drag, middle: Array, usual: float) -> Array:
    """(n, FIRST) with places from `middle` (2,), m, and a `usual` speed, m/s."""
    x, y = ((drag.place - middle) / tuning.HALF_WAY).T
    wx, wy = drag.way
    normal, ones = drag.pressing[0], np.ones(len(drag.t))
    axes = [wx**2 - wy**2, 2.0 * wx * wy]
    speed = np.log2(drag.speed / usual)
    spring = [wx * x, wy * y, wx * y + wy * x]
    curve = [wx * x**2, wx * x * y + wy * x**2 / 2, wy * x * y + wx * y**2 / 2, wy * y**2]
    return np.column_stack(
        [
            normal,
            *(normal * c for c in (wx, wy, *axes, x, y, speed)),
            ones,
            *(ones * c for c in (wx, wy)),
            *(tuning.HALF_WAY * c for c in spring),
            *curve,
        ]
    )


def _arm(
    drag: Drag, drags: Sequence[Drag], observed: WrenchObservation, hand: Hand, mu: float
) -> tuple[Array, Array]:
    """(n, k) N for each N m of the joints' friction, and (n, m) N for each standard deviation of
    what their gains are off by."""
    if observed.chain is None:
        # Not known joint by joint: both forces carry the gain of the joints that sensed them.
        gain = tuning.GAIN_RATIO * hand.torque_gain * mu * drag.normal
        return _by_line(drag, drags), gain[:, None]
    there, hanging = (
        _lever(drag.q, drag, observed, mu),
        _lever(drag.hanging.q[None], drag, observed, mu),
    )
    friction = there * drag.turned - hanging * drag.hanging.turned
    return friction, (there * drag.torque) @ gain_root(hand, len(there))


def _lever(q: Array, drag: Drag, observed: WrenchObservation, mu: float) -> Array:
    """(m,) what a unit of each signal adds to f_t - mu N of a drag, at the middle of the angles `q`
    (n, 7): the wrench is (J^T)^+ tau."""
    middle: Array = q.mean(axis=0, keepdims=True)
    wrenches: Array = np.linalg.pinv(observed.maps(middle)).astype(np.float64)
    return drag.way @ wrenches[0, :2] + mu * wrenches[0, 2]


def _by_line(drag: Drag, drags: Sequence[Drag]) -> Array:
    """(n, k) ones in the column of the line on which a drag goes, either way: friction of an arm of
    which nothing is known joint by joint."""
    lines: list[Array] = []
    for other in drags:
        if not any(_same(line, other.way) for line in lines):
            lines.append(other.way)
    same = [_same(line, drag.way) for line in lines]
    return np.ones((len(drag.t), 1)) * np.array(same, dtype=float)


def _same(line: Array, way: Array) -> bool:
    return abs(float(line @ way)) > tuning.SAME_LINE
