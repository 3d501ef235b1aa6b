"""Generalised least squares for the load on the hand, and tests of misspecification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.estimate import FitTest, chi_squared
from palpate.estimation.joint_friction import FLOOR, JOINT_LEVEL, SLIP_ANGLES
from palpate.estimation.load_causes import GAINS_OFF, LEFT_SHARES, LOAD_PRIOR, TILT
from palpate.estimation.load_equations import (
    FORCE_Z,
    LEANING,
    SIDEWAYS,
    TORQUE_X,
    TORQUE_Y,
    TORQUE_Z,
    WeighingRows,
    each_its_own,
    equations,
    in_each,
)
from palpate.estimation.regression import (
    Cause,
    Posterior,
    PriorScale,
    SignalNoise,
    fit,
    whitened_model,
)
from palpate.estimation.segments import Weighing
from palpate.estimation.wrench_observation import (
    CROSSTALK,
    GAIN,
    TORQUE_LEVER,
    crosstalk,
    gain_root,
)
from palpate.trace.recording import NominalHand

PULL_SMALL = 0.05
"""N/m (1 sigma): tolerated growth of a force with the height. Sensitive: no."""
PULL_SHARE = 0.03
"""1/m (1 sigma), part of the load: likewise; levers of joints are not known better along a lift, and loads in a
perfect world read up to 5 % a metre off. Sensitive: no."""
RUB_SHARE = 0.002
"""part of the load (1 sigma), likewise: friction in a joint grows with what it bears by about so much. Sensitive:
no."""
RUB_SMALL = 0.005
"""N (1 sigma): tolerated difference of a load between directions, between rest and pass and between weighings: a
tenth of the force that such arms resolve. Sensitive: no."""
TELLING = 0.1
"""part of `LOAD_PRIOR`: a term with a larger std cannot be separated from the load. Sensitive: no."""


def tests_of(
    rows: Sequence[WeighingRows], grasps: Sequence[float], found: Posterior, left: float
) -> tuple[FitTest, ...]:
    """Test each extended model, for a load with `left` N (1 sigma) of residual stiction."""
    # Tolerated: the uncertainty of kinematics and friction, in proportion to the load.
    force = float(found.mean[0])
    rub = float(np.hypot(RUB_SMALL, RUB_SHARE * force))
    pull = float(np.hypot(PULL_SMALL, PULL_SHARE * force))
    tests = [sideways_test(rows, grasps, found, rub), *vertical_tests(rows, found, rub, pull, left)]
    if len(grasps) > 1:
        tests.append(weighings_test(rows, grasps, found, rub))
    return tuple(tests)


def vertical_tests(
    rows: Sequence[WeighingRows], posterior: Posterior, rub: float, pull: float, left: float
) -> list[FitTest]:
    """Test for vertical forces, one at a time: in proportion to the height, changing sign with the direction,
    at rest only, and a step. `rub` N, `pull` N/m and `left` N (1 sigma) are tolerated."""
    stuck = float(np.hypot(rub, left))
    since = each_its_own([row.since for row in rows])
    columns: list[Array] = []
    for row, later in zip(rows, since, strict=True):
        on_load = np.column_stack([row.height, row.way, row.rest])
        columns.append(np.hstack([row.wrench[:, [FORCE_Z]] * on_load, later]))
    forces, variances = posterior.each_alone(np.concatenate(columns), LOAD_PRIOR)
    kinds = [
        ("along the lift", pull),
        ("up against down", rub),
        ("rest against pass", stuck),
        # One for each possible onset of a step; the worst counts.
        *[("before against after", stuck)] * since[0].shape[1],
    ]
    found: dict[str, FitTest] = {}
    for kind, force, variance in zip(kinds, forces.tolist(), variances.tolist(), strict=True):
        name, small = kind
        statistic = force**2 / (variance + small**2)
        # A force that cannot be separated from the load is not tested.
        separable = variance < (TELLING * LOAD_PRIOR) ** 2
        if separable and (name not in found or statistic > found[name].statistic):
            # The tolerated part is known exactly (Welch and Satterthwaite; GUM, annex G.4).
            freedom = posterior.freedom * (1.0 + small**2 / variance) ** 2
            found[name] = chi_squared(name, statistic, 1, _finding(name, force), freedom)
    return list(found.values())


def _finding(name: str, force: float) -> str:
    size, positive = abs(force), force > 0
    if name == "along the lift":
        return (
            f"The force {'grows' if positive else 'falls'} with the height, by {size:.2g} N/m: something pulls on it "
            "or carries part of it."
        )
    if name == "up against down":
        return (
            f"It is {2 * size:.2g} N heavier on the way {'up' if positive else 'down'} than back: something rubs on "
            "it, or the force jumped."
        )
    if name == "rest against pass":
        return f"At rest it is {size:.2g} N {'heavier' if positive else 'lighter'} than in motion."
    return (
        f"From some moment on {size:.2g} N {'more' if positive else 'less'} are measured, with the object and without: "
        "the sensors' zero jumped, or approaches leave more in the joints than the datasheet says."
    )


def sideways_test(
    rows: Sequence[WeighingRows], grasps: Sequence[float], posterior: Posterior, small: float
) -> FitTest:
    """Test for a sideways force, or a moment about the vertical, in any grasp; `small` N (1 sigma)
    is tolerated."""
    count = len(SIDEWAYS) * len(grasps)

    def finding(mean: Array) -> str:
        forces = mean[:count].reshape(-1, len(SIDEWAYS))[:, :2]
        most = float(np.linalg.norm(forces, axis=1).max())
        return (
            f"It is pushed or pulled sideways with {most:.2g} N, as nothing is that hangs free: "
            "something besides the hand holds it."
        )

    columns = np.concatenate([in_each(row, grasps, SIDEWAYS) for row in rows])
    tolerated = np.tile((small, small, small * TORQUE_LEVER), len(grasps))
    cause = Cause("sideways", columns, np.full(count, LOAD_PRIOR))
    return posterior.test(cause, tolerated, finding)


def weighings_test(
    rows: Sequence[WeighingRows], grasps: Sequence[float], posterior: Posterior, small: float
) -> FitTest:
    """Test for the same force in every grasp."""
    count = len(grasps) - 1

    def finding(mean: Array) -> str:
        forces = ", ".join(f"{mean[count] + part:.3g}" for part in [0.0, *mean[:count].tolist()])
        return f"The weighings disagree: {forces} N."

    columns = np.concatenate([in_each(row, grasps[1:], (FORCE_Z,)) for row in rows])
    cause = Cause("weighing against weighing", columns, np.full(count, LOAD_PRIOR))
    return posterior.test(cause, np.full(count, small), finding)


# Generalised least squares for the load on the hand.


KINDS_APART = (1.0, 1.0 / 8.0, 1.0 / 64.0)
"""parts (1 sigma) of `KIND_BIAS`, `BIN_BIAS` and `REST_FRICTION` that each kind of segment has of its own: from all
of it, unless the evidence against that is very strong, to next to nothing. Sensitive: mass 0.3 σ, std ×0.9–1.0 where
joints hardly rub."""
VERY_STRONG = 5.0
"""logarithm of a Bayes factor from which evidence is very strong (Kass and Raftery, Journal of the American
Statistical Association 90, 1995, section 3.2: 150). Sensitive: no."""
LOAD_ITERATIONS = 3
"""solutions after the first: effects of gains and tilts are in proportion to the load. Sensitive: no."""
FORESEEN_DRAWS = 2
"""draws of noise for the prediction of planned passes. Sensitive: no, it decides on work alone."""

AT_HAND, OFFSETS = ("rests", "passes", "rests and passes"), "offsets"
"""Names of causes: residual stiction."""
LoadModel = tuple[list[Cause], SignalNoise, Array, list[PriorScale]]
"""Causes, noise, signals and prior scales."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadEstimate:
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
    rows: Sequence[WeighingRows]
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


def fit_load(weighings: Sequence[Weighing], gravity: float, hand: NominalHand) -> LoadEstimate:
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


def foreseen(weighing: Weighing, weight: float, gravity: float, hand: NominalHand) -> float:
    """Predict the variance of F, N², for a load of `weight` N from planned rests and passes, whose signals are
    not used: the agreement of the passes follows from typical draws of the noise."""
    rows, about = [equations(weighing, gravity)], np.zeros(1 + 2 * len(weighing.grasps))
    about[0] = weight
    model = whitened_model(*load_model(rows, tuple(weighing.grasps), about, hand))
    random, found = np.random.default_rng(0), 0.0
    for _ in range(FORESEEN_DRAWS):
        typical = replace(model, y=random.standard_normal(len(model.y)))
        found += float(typical.solve(1)[1][0, 0]) / FORESEEN_DRAWS
    return found


def fit_load_without_tests(
    weighings: Sequence[Weighing], gravity: float, hand: NominalHand
) -> tuple[float, float]:
    """F and its standard deviation, N, as in `fit_load`, without the tests of misspecification."""
    _, found = _solve_equations(weighings, gravity, hand)
    return float(found.mean[0]), float(np.sqrt(found.covariance[0, 0]))


def _fit(weighings: Sequence[Weighing], gravity: float, hand: NominalHand) -> LoadEstimate:
    rows, found = _solve_equations(weighings, gravity, hand)
    grasps = _grasps(weighings)
    tests = tests_of(rows, grasps, found, hand.force_repeatability)
    count = 1 + 2 * len(grasps)
    value = found.mean[:count], found.covariance[:, :count]
    effects = found.effects(GAIN), found.effects(CROSSTALK)
    return LoadEstimate(grasps, *value, tests, *effects, weighings, rows, found)


def _solve_equations(
    weighings: Sequence[Weighing], gravity: float, hand: NominalHand
) -> tuple[Sequence[WeighingRows], Posterior]:
    """Equations, and their posterior, linearised at the solution."""
    grasps = _grasps(weighings)
    count = 1 + 2 * len(grasps)
    ways = [
        [equations(weighing, gravity, apart) for weighing in weighings] for apart in KINDS_APART
    ]
    # Effects of gains and tilts are in proportion to the load, which is unknown at first.
    about = fit(*load_model(ways[0], grasps, np.zeros(count), hand), 1).mean[:count]
    rows, found = likeliest(ways, grasps, about, hand)
    for _ in range(LOAD_ITERATIONS):
        found = fit(*load_model(rows, grasps, about, hand), count)
        about = found.mean[:count]
    return rows, found


def likeliest(
    ways: Sequence[Sequence[WeighingRows]], grasps: Sequence[float], about: Array, hand: NominalHand
) -> tuple[Sequence[WeighingRows], Posterior]:
    """Of equations with the biases of the kinds of segments from as far `KINDS_APART` as they may be to alike, the
    first, or those for which the evidence is very strong and by which the load is known better; with the posterior."""
    found = [fit(*load_model(rows, grasps, about, hand), 1) for rows in ways]
    evidence = [each.evidence for each in found]
    best = int(np.argmax(evidence))
    # A bias that changes sign with the direction could pass for residual stiction of each approach.
    apart, alike = (found[i].covariance[0, 0] for i in (0, best))
    if evidence[best] <= evidence[0] + VERY_STRONG or alike >= apart:
        best = 0
    return ways[best], found[best]


def _grasps(weighings: Sequence[Weighing]) -> tuple[float, ...]:
    """Times (s) of the grasps, each once, on however many paths the load was weighed."""
    return tuple(dict.fromkeys(time for weighing in weighings for time in weighing.grasps))


def load_model(
    rows: Sequence[WeighingRows], grasps: Sequence[float], about: Array, hand: NominalHand
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
    tilt = TILT * abs(float(about[0])) + FLOOR
    pairs = zip(rows, vertical, strict=True)
    torques = [(row.signal, columns @ about) for row, columns in pairs]
    borne = [torque[:, None] * gains[signal] for signal, torque in torques]
    crossed = [_crosstalk_of_load(hand, signal, torque, signals) for signal, torque in torques]
    friction, left = (
        JOINT_LEVEL / len(SLIP_ANGLES) ** 0.5,
        hand.force_repeatability + FLOOR,
    )
    stiction = zip(
        (*AT_HAND, OFFSETS), zip(*(row.stiction.columns for row in rows), strict=True), strict=True
    )
    parts: list[tuple[str, Sequence[Array], float]] = [
        ("load", vertical, LOAD_PRIOR),
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
    shares = LEFT_SHARES
    even = [1.0 / len(shares)] * len(shares)
    # Shares of the datasheet's figure: left by this arm at all; of that, left in motion.
    scales = [
        PriorScale((*AT_HAND, OFFSETS), shares, even),
        PriorScale(AT_HAND, stiction_scales(rows), even),
        PriorScale((OFFSETS,), shares, even),
        PriorScale((GAIN,), *GAINS_OFF),
    ]
    noise = SignalNoise([row.root for row in rows], min(row.freedom for row in rows))
    return causes, noise, np.concatenate([row.observed for row in rows]), scales


def _crosstalk_of_load(
    hand: NominalHand, signal: NDArray[np.intp], torque: Array, signals: int
) -> Array:
    """(n, signals) cross-talk in rows of each `signal` (n,), of the load's `torque` (n,)."""
    read = crosstalk(hand, torque.reshape(signals, -1).T)
    return read.T.ravel()[:, None] * np.eye(signals)[signal]


def stiction_scales(rows: Sequence[WeighingRows]) -> Sequence[Array]:
    """Scales of the stiction forces at rests, in passes, and common to a rest and its pass, for each of
    `LEFT_SHARES`."""
    paired = [np.split(row.stiction.paired, [row.stiction.stuck.shape[1]]) for row in rows]
    rests, passes = (np.concatenate([pair[i] for pair in paired]) for i in (0, 1))
    both = sum(row.stiction.carried.shape[1] for row in rows)
    found: list[Array] = []
    for share in LEFT_SHARES[:-1]:
        parts = [np.ones(len(rests)), np.full(len(passes), share), np.zeros(both)]
        found.append(np.concatenate(parts))
    # A pass that keeps all of it has the force of the rest before it.
    found.append(np.concatenate([~rests, ~passes, np.ones(both)]).astype(np.float64))
    return found


def tilted_weight(row: WeighingRows, grasps: Sequence[float], about: Array) -> Array:
    """(n, 2) signals per newton of horizontal weight along world x and y, where gravity is tilted."""
    leaning = row.wrench[:, LEANING].copy()
    # The weight acts at r = (-M_y, M_x) / F beside the TCP, so that it also turns the hand about the vertical.
    moments = about[1:].reshape(-1, 2) / max(abs(float(about[0])), FLOOR)
    for grasp, moment in zip(grasps, moments, strict=True):
        turning = row.wrench[:, TORQUE_Z] * (row.grasp == grasp)
        leaning -= turning[:, None] * moment
    return leaning
