"""Generalised least squares for the load on the hand.

A signal (a joint's torque; `estimation.load.observation`), averaged over bin b of a rest or a pass along the
path of a lift, is modelled as

    y_b = L_b (1 + a_b / g) (J_b^T W + gain errors) + f s_b + c_kind(x_b) + i m_b + d(t_b) + e + n_b

    W       the wrench of the load, which is sought: (0, 0, F, M_x, M_y, 0) of what hangs free;
            L_b is 1 with the load in the hand and 0 without
    a, g    vertical acceleration and gravity
    m       what moving the arm's links takes (`estimation.load.chain`), which is out of y but for an
            error i of some per cent; where links are not known, the acceleration takes its place
    f, s    friction of a joint, whose state follows its motion (`estimation.joint_friction`)
    c       bias of each kind of segment, a cubic along the path x and a bit of its own in each bin;
            kinds have some or all of it in common
    d       drift and 1/f noise over time t
    e       what an approach leaves in the joints; n white noise

Everything but W has a normal prior, so that W follows by generalised least squares from the covariance of
all the rest (e.g. Bishop, Pattern Recognition and Machine Learning, section 3.3). White and 1/f noise follow
from the scatter of blocks (`estimation.load.noise`), never from the residuals. A gain error is one number a
signal, the same in all weighings; its column is the load itself, so that joints with little load correct
those with much. So is what a sensor reads of the load's torques in the other joints.

Three scales are learned from the recordings. Residual stiction: an approach leaves a torque in the joints
that may persist in motion; the datasheet bounds it, and each rest, and each pass, has an offset of its own,
whose size is averaged over (near zero where rests agree, wide intervals where they do not). Gains: where the
joints disagree on the load, they may be farther off than the datasheet says. Biases of rests, of passes up
and of passes down: they count as one where the evidence for that is very strong (type II maximum likelihood;
Bishop, section 3.5).

The model is one of several, nested in each other: forces to the side, a force that grows with the height (a
spring), one that changes its sign with the direction (something rubs), one at rests alone, and a different
load at every weighing. Each is tested (`Load.tests`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest
from palpate.estimation.load.equations import (
    FORCE_Z,
    LEANING,
    TORQUE_X,
    TORQUE_Y,
    TORQUE_Z,
    Rows,
    each_its_own,
    equations,
    in_each,
)
from palpate.estimation.load.misspecification import tests_of
from palpate.estimation.load.observation import CROSSTALK, GAIN, crosstalk, gain_root
from palpate.estimation.load.segments import Weighing
from palpate.estimation.regression import (
    Cause,
    Posterior,
    Scale,
    SignalNoise,
    fit,
    whitened_model,
)
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

AT_HAND, OFFSETS = ("rests", "passes", "rests and passes"), "offsets"
"""Names of causes: residual stiction."""
LoadModel = tuple[list[Cause], SignalNoise, Array, list[Scale]]
"""Causes, noise, signals and prior scales."""


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """Estimate of one load over n grasps.

    Attributes:
        grasps: s, when.
        value: (1 + 2n,) F in N, then M_x and M_y about the TCP in each grasp in N m, world axes.
        covariance: (1 + 2n, 1 + 2n) of it, with all that the grasps have in common.
        tests: of what else might act on it.
        gains: (1 + 2n, signals) what one standard deviation of each signal's gain does to `value`; of
            gains that were measured together, of as many causes that are independent.
        crosstalk: (1 + 2n, signals) what one standard deviation of each signal's cross-talk does to it.
        weighings, rows, posterior: what was fitted.
    """

    grasps: tuple[float, ...]
    value: Array
    covariance: Array
    tests: tuple[FitTest, ...]
    gains: Array
    crosstalk: Array
    weighings: Sequence[Weighing]
    rows: Sequence[Rows]
    posterior: Posterior

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise."""
        return self.posterior.freedom

    @property
    def agrees(self) -> bool:
        """All tests passed."""
        return all(test.passed for test in self.tests)

    @property
    def force(self) -> float:
        """N."""
        return float(self.value[0])

    @property
    def force_std(self) -> float:
        """N."""
        return float(np.sqrt(self.covariance[0, 0]))


def fit_load(weighings: Sequence[Weighing], gravity: float, hand: Hand) -> Load:
    """Fit the load on the hand in all `weighings`, at g = `gravity` m/s².

    Where they disagree, weighings that contradict themselves are left out of the value, and their failed
    tests are kept.

    Raises:
        ValueError: there is a weighing without a loaded segment.
    """
    if not all(weighing.grasps for weighing in weighings):
        raise ValueError("no recording with the load on the hand")
    together = _fit(weighings, gravity, hand)
    if together.agrees or len(weighings) == 1:
        return together
    alone = {id(weighing): _fit([weighing], gravity, hand) for weighing in weighings}
    sound = [weighing for weighing in weighings if alone[id(weighing)].agrees]
    if not sound or len(sound) == len(weighings):
        return together
    tests = [test for load in alone.values() for test in load.tests if not test.passed]
    rest = _fit(sound, gravity, hand)
    return replace(rest, tests=(*rest.tests, *tests))


def foreseen(weighing: Weighing, weight: float, gravity: float, hand: Hand) -> float:
    """Predict the variance of F, N², for a load of `weight` N from planned rests and passes, whose signals are
    not used: the agreement of the passes follows from typical draws of the noise."""
    rows, about = [equations(weighing, gravity)], np.zeros(1 + 2 * len(weighing.grasps))
    about[0] = weight
    model = whitened_model(*load_model(rows, tuple(weighing.grasps), about, hand))
    random, found = np.random.default_rng(0), 0.0
    for _ in range(tuning.FORESEEN_DRAWS):
        typical = replace(model, y=random.standard_normal(len(model.y)))
        found += float(typical.solve(1)[1][0, 0]) / tuning.FORESEEN_DRAWS
    return found


def untested(weighings: Sequence[Weighing], gravity: float, hand: Hand) -> tuple[float, float]:
    """F and its standard deviation, N, as in `fit_load`, without the tests of misspecification."""
    _, found = _solved(weighings, gravity, hand)
    return float(found.mean[0]), float(np.sqrt(found.covariance[0, 0]))


def _fit(weighings: Sequence[Weighing], gravity: float, hand: Hand) -> Load:
    rows, found = _solved(weighings, gravity, hand)
    grasps = _grasps(weighings)
    tests = tests_of(rows, grasps, found, hand.force_repeatability)
    count = 1 + 2 * len(grasps)
    value = found.mean[:count], found.covariance[:, :count]
    effects = found.effects(GAIN), found.effects(CROSSTALK)
    return Load(grasps, *value, tests, *effects, weighings, rows, found)


def _solved(
    weighings: Sequence[Weighing], gravity: float, hand: Hand
) -> tuple[Sequence[Rows], Posterior]:
    """Equations, and their posterior, linearised at the solution."""
    grasps = _grasps(weighings)
    count = 1 + 2 * len(grasps)
    ways = [
        [equations(weighing, gravity, apart) for weighing in weighings]
        for apart in tuning.KINDS_APART
    ]
    # Effects of gains and tilts are in proportion to the load, which is unknown at first.
    about = fit(*load_model(ways[0], grasps, np.zeros(count), hand), 1).mean[:count]
    rows, found = likeliest(ways, grasps, about, hand)
    for _ in range(tuning.LOAD_ITERATIONS):
        found = fit(*load_model(rows, grasps, about, hand), count)
        about = found.mean[:count]
    return rows, found


def likeliest(
    ways: Sequence[Sequence[Rows]], grasps: Sequence[float], about: Array, hand: Hand
) -> tuple[Sequence[Rows], Posterior]:
    """Of equations with the biases of the kinds of segments from as far `KINDS_APART` as they may be to alike, the
    first, or those for which the evidence is very strong and by which the load is known better; with the posterior."""
    found = [fit(*load_model(rows, grasps, about, hand), 1) for rows in ways]
    evidence = [each.evidence for each in found]
    best = int(np.argmax(evidence))
    # A bias that changes sign with the direction could pass for residual stiction of each approach.
    apart, alike = (found[i].covariance[0, 0] for i in (0, best))
    if evidence[best] <= evidence[0] + tuning.VERY_STRONG or alike >= apart:
        best = 0
    return ways[best], found[best]


def _grasps(weighings: Sequence[Weighing]) -> tuple[float, ...]:
    """Times (s) of the grasps, each once, on however many paths the load was weighed."""
    return tuple(dict.fromkeys(time for weighing in weighings for time in weighing.grasps))


def load_model(
    rows: Sequence[Rows], grasps: Sequence[float], about: Array, hand: Hand
) -> LoadModel:
    """Causes, noise, signals and prior scales of weighings, for `regression.fit`: F and the moments in each grasp,
    tilt of gravity, residual stiction of rests and passes, friction of the joints, gains, and cross-talk; linearised at
    `about` (F, then the moments)."""
    signals = int(rows[0].signal.max()) + 1
    gains = gain_root(hand, signals)
    vertical = [
        np.column_stack([row.wrench[:, FORCE_Z], in_each(row, grasps, (TORQUE_X, TORQUE_Y))])
        for row in rows
    ]
    tilted = [tilted_weight(row, grasps, about) for row in rows]
    tilt = tuning.TILT * abs(float(about[0])) + tuning.FLOOR
    pairs = zip(rows, vertical, strict=True)
    torques = [(row.signal, columns @ about) for row, columns in pairs]
    borne = [torque[:, None] * gains[signal] for signal, torque in torques]
    crossed = [_crossed(hand, signal, torque, signals) for signal, torque in torques]
    friction, left = (
        tuning.JOINT_LEVEL / len(tuning.SLIPS) ** 0.5,
        hand.force_repeatability + tuning.FLOOR,
    )
    stiction = zip(
        (*AT_HAND, OFFSETS), zip(*(row.stiction.columns for row in rows), strict=True), strict=True
    )
    parts: list[tuple[str, Sequence[Array], float]] = [
        ("load", vertical, tuning.LOAD_PRIOR),
        ("tilt", tilted, tilt),
        *((name, each_its_own(blocks), left) for name, blocks in stiction),
        ("joint friction", [row.dahl for row in rows], friction),
        (GAIN, borne, 1.0),
        (CROSSTALK, crossed, 1.0),
    ]
    causes: list[Cause] = []
    for name, blocks, prior in parts:
        columns = np.concatenate(blocks)
        causes.append(Cause(name, columns, np.full(int(columns.shape[1]), prior)))
    shares = tuning.LEFT_SHARES
    even = [1.0 / len(shares)] * len(shares)
    # Shares of the datasheet's figure: left by this arm at all; of that, left in motion.
    scales = [
        Scale((*AT_HAND, OFFSETS), shares, even),
        Scale(AT_HAND, stiction_scales(rows), even),
        Scale((OFFSETS,), shares, even),
        Scale((GAIN,), *tuning.GAINS_OFF),
    ]
    noise = SignalNoise([row.root for row in rows], min(row.freedom for row in rows))
    return causes, noise, np.concatenate([row.observed for row in rows]), scales


def _crossed(hand: Hand, signal: NDArray[np.intp], torque: Array, signals: int) -> Array:
    """(n, signals) cross-talk in rows of each `signal` (n,), of the load's `torque` (n,)."""
    read = crosstalk(hand, torque.reshape(signals, -1).T)
    return read.T.ravel()[:, None] * np.eye(signals)[signal]


def stiction_scales(rows: Sequence[Rows]) -> Sequence[Array]:
    """Scales of the stiction forces at rests, in passes, and common to a rest and its pass, for each of
    `tuning.LEFT_SHARES`."""
    paired = [np.split(row.stiction.paired, [row.stiction.stuck.shape[1]]) for row in rows]
    rests, passes = (np.concatenate([pair[i] for pair in paired]) for i in (0, 1))
    both = sum(row.stiction.carried.shape[1] for row in rows)
    found: list[Array] = []
    for share in tuning.LEFT_SHARES[:-1]:
        parts = [np.ones(len(rests)), np.full(len(passes), share), np.zeros(both)]
        found.append(np.concatenate(parts))
    # A pass that keeps all of it has the force of the rest before it.
    found.append(np.concatenate([~rests, ~passes, np.ones(both)]).astype(np.float64))
    return found


def tilted_weight(row: Rows, grasps: Sequence[float], about: Array) -> Array:
    """(n, 2) signals per newton of horizontal weight along world x and y, where gravity is tilted."""
    leaning = row.wrench[:, LEANING].copy()
    # The weight acts at r = (-M_y, M_x) / F beside the TCP, so that it also turns the hand about the vertical.
    moments = about[1:].reshape(-1, 2) / max(abs(float(about[0])), tuning.FLOOR)
    for grasp, moment in zip(grasps, moments, strict=True):
        turning = row.wrench[:, TORQUE_Z] * (row.grasp == grasp)
        leaning -= turning[:, None] * moment
    return leaning
