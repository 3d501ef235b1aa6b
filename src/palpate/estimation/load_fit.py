"""Load on the hand, by generalised least squares.

`fit_load` compares rests and passes with and without the load along one path (`load_equations`), and tests for other
forces. `fit_whole` fits all free motion around a weighing. Away from the path of a lift there is no empty pass at the
same place for a contrast. The torques there have few causes, each linear in its unknowns (`joint_causes`), and the
result is more precise. What the model leaves, such as ripple or friction that changes with the place, is learned from
the recording and widens the result (`coloured_residual`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.estimate import FitTest, Shared, chi_squared, map_shared
from palpate.estimation.joint_causes import (
    GAINS_OFF,
    LEFT_SHARES,
    LOAD_PRIOR,
    TILT,
    arm_scales,
    build_free_motion,
    build_gain,
    build_load,
    build_noise,
    by_signal,
    crosstalk_columns,
    fit_blocks,
)
from palpate.estimation.joint_friction import FLOOR, JOINT_LEVEL, SLIP_ANGLES
from palpate.estimation.load_blocks import Blocks, blocks, free_rows
from palpate.estimation.load_equations import (
    FORCE_Z,
    LEANING,
    SIDEWAYS,
    TORQUE_X,
    TORQUE_Y,
    WeighingRows,
    each_its_own,
    equations,
    in_each,
)
from palpate.estimation.load_noise import SignalLevels
from palpate.estimation.regression import (
    Cause,
    Posterior,
    PriorScale,
    SignalNoise,
    fit,
    whitened_model,
)
from palpate.estimation.segments import Weighing
from palpate.estimation.sensed_load import SENSOR_GAIN, SensedGrasps, fit_sensed_grasps
from palpate.estimation.wrench_observation import (
    CROSSTALK,
    GAIN,
    TORQUE_LEVER,
    WrenchObservation,
    gain_root,
    observe,
)
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Trace

PULL_SMALL = 0.05
"""N/m (1 sigma): tolerated growth of a force with the height. Not sensitive."""
PULL_SHARE = 0.03
"""1/m (1 sigma): tolerated growth with the height, as a fraction of the load. Joint lever arms are not known better
along a lift; loads in a perfect world read up to 5 % a metre off. Not sensitive."""
RUB_SHARE = 0.002
"""fraction of the load (1 sigma): tolerated force difference. Friction in a joint grows with its
load by about this much. Not sensitive."""
RUB_SMALL = 0.005
"""N (1 sigma): tolerated force difference between directions, between rest and pass and between
weighings. It is a tenth of the force resolution of such arms. Not sensitive."""
TELLING = 0.1
"""fraction of `LOAD_PRIOR`: a term with a larger std cannot be separated from the load. Not sensitive."""


def tests_of(
    rows: Sequence[WeighingRows], grasps: Sequence[float], found: Posterior, left: float
) -> tuple[FitTest, ...]:
    """Test each extended model of a load.

    Args:
        grasps: s, times of the grasps.
        found: posterior of the load.
        left: N (1 sigma), residual stiction.
    """
    # Tolerated forces: errors of kinematics and friction, with a part in proportion to the load.
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
    """Test for further vertical forces, each added to the model alone.

    There are four kinds: in proportion to the height, opposite up and down, at rest only, and a step in time.

    Args:
        rub: N (1 sigma), tolerated.
        pull: N/m (1 sigma), tolerated.
        left: N (1 sigma), tolerated in addition to `rub` at rest and for steps.
    """
    stuck = float(np.hypot(rub, left))
    # One column for each kind of force, and one for each possible start of a step.
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
        # The step with the largest statistic counts.
        *[("before against after", stuck)] * since[0].shape[1],
    ]
    found: dict[str, FitTest] = {}
    for kind, force, variance in zip(kinds, forces.tolist(), variances.tolist(), strict=True):
        name, small = kind
        # Squared force over its variance, the tolerated force included.
        statistic = force**2 / (variance + small**2)
        # Skip a force that cannot be separated from the load.
        separable = variance < (TELLING * LOAD_PRIOR) ** 2
        if separable and (name not in found or statistic > found[name].statistic):
            # The tolerated variance is known exactly, which adds degrees of freedom (Welch and
            # Satterthwaite; GUM, annex G.4).
            freedom = posterior.freedom * (1.0 + small**2 / variance) ** 2
            found[name] = chi_squared(name, statistic, 1, _finding(name, force), freedom)
    return list(found.values())


def _finding(name: str, force: float) -> str:
    """Describe a failed test of a vertical force of `force` N or N/m."""
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
    """Test for a horizontal force, or a moment about the vertical, in any grasp.

    Args:
        small: N (1 sigma), tolerated.
    """
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
    cause = Cause.build("sideways", columns, LOAD_PRIOR)
    return posterior.test(cause, tolerated, finding)


def weighings_test(
    rows: Sequence[WeighingRows], grasps: Sequence[float], posterior: Posterior, small: float
) -> FitTest:
    """Test that the force is the same in every grasp; `small` N (1 sigma) is tolerated."""
    count = len(grasps) - 1

    def finding(mean: Array) -> str:
        forces = ", ".join(f"{mean[count] + part:.3g}" for part in [0.0, *mean[:count].tolist()])
        return f"The weighings disagree: {forces} N."

    columns = np.concatenate([in_each(row, grasps[1:], (FORCE_Z,)) for row in rows])
    cause = Cause.build("weighing against weighing", columns, LOAD_PRIOR)
    return posterior.test(cause, np.full(count, small), finding)


# Fit of the load on the hand.


LOAD_ITERATIONS = 3
"""number of solutions after the first. They are needed as the effects of gains and tilt are in
proportion to the load. Not sensitive."""
FORESEEN_DRAWS = 2
"""number of noise draws for the prediction of planned passes. Not sensitive; only the planned effort depends on it."""

AT_HAND, OFFSETS = ("rests", "passes", "rests and passes"), "offsets"
"""Names of the causes of residual stiction."""
LoadModel = tuple[list[Cause], SignalNoise, Array, list[PriorScale]]
"""Causes, noise, signals and prior scales."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedLoad:
    """Load over n grasps: its weight, and k numbers of its lever in each grasp."""

    grasps: tuple[float, ...]  # s, times at which the hand had closed on it
    value: Array  # (1 + k n,) weight F in N, then the levers in N m
    covariance: Array  # (1 + k n, 1 + k n) of `value`, with the errors that all grasps share
    # Errors of the arm in common with other runs, with their effects on `value`.
    shared: tuple[Shared, ...]
    posterior: Posterior  # of all unknowns

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise."""
        return self.posterior.freedom

    @property
    def has_sensor(self) -> bool:
        """True if the readings of a six-axis sensor are a part of the fit."""
        return any(shared.cause == SENSOR_GAIN for shared in self.shared)

    @property
    def force(self) -> float:
        """N, weight F of the load."""
        return float(self.value[0])

    @property
    def force_std(self) -> float:
        """N, standard deviation of F."""
        return float(np.sqrt(self.covariance[0, 0]))


@dataclass(frozen=True, slots=True, eq=False)
class LoadEstimate(FittedLoad):
    """Load by rests and passes. Its levers are the moments M_x and M_y about the TCP, in world axes."""

    tests: tuple[FitTest, ...]  # for other forces on the load
    weighings: Sequence[Weighing]  # the segments that were fitted
    rows: Sequence[WeighingRows]  # their equations

    @property
    def agrees(self) -> bool:
        """True if all tests passed."""
        return all(test.passed for test in self.tests)


def fit_load(weighings: Sequence[Weighing], gravity: float, hand: NominalHand) -> LoadEstimate:
    """Fit the load on the hand in all `weighings`, at g = `gravity` m/s².

    Where weighings disagree, those that contradict themselves are left out of the value. Their failed tests are kept.
    Raises ValueError: a weighing has no loaded segment.
    """
    if not all(weighing.grasps for weighing in weighings):
        raise ValueError("no recording with the load on the hand")
    together = _fit(weighings, gravity, hand)
    if together.agrees or len(weighings) == 1:
        return together
    # Fit each weighing alone, and keep those that pass their own tests.
    alone = {id(weighing): _fit([weighing], gravity, hand) for weighing in weighings}
    sound = [weighing for weighing in weighings if alone[id(weighing)].agrees]
    if not sound or len(sound) == len(weighings):
        return together
    tests = [test for load in alone.values() for test in load.tests if not test.passed]
    rest = _fit(sound, gravity, hand)
    return replace(rest, tests=(*rest.tests, *tests))


def foreseen(weighing: Weighing, weight: float, gravity: float, hand: NominalHand) -> float:
    """Predict the variance of F, N², for a load of `weight` N from planned rests and passes.

    Their signals are not used. The variance depends on the signals only through the scales of the
    priors, which follow from random draws of the noise.
    """
    rows, about = [equations(weighing, gravity)], np.zeros(1 + 2 * len(weighing.grasps))
    about[0] = weight
    model = whitened_model(*load_model(rows, tuple(weighing.grasps), about, hand))
    # Average the variance over draws of whitened noise.
    random, found = np.random.default_rng(0), 0.0
    for _ in range(FORESEEN_DRAWS):
        typical = replace(model, y=random.standard_normal(len(model.y)))
        found += float(typical.solve(1)[1][0, 0]) / FORESEEN_DRAWS
    return found


def _fit(weighings: Sequence[Weighing], gravity: float, hand: NominalHand) -> LoadEstimate:
    """Fit the load and test it."""
    rows, found = _solve_equations(weighings, gravity, hand)
    grasps = _grasps(weighings)
    tests = tests_of(rows, grasps, found, hand.force_repeatability)
    count = 1 + 2 * len(grasps)
    value = found.mean[:count], found.covariance[:, :count]
    return LoadEstimate(grasps, *value, found.shared(slice(count)), found, tests, weighings, rows)


def _solve_equations(
    weighings: Sequence[Weighing], gravity: float, hand: NominalHand
) -> tuple[Sequence[WeighingRows], Posterior]:
    """Set up the equations and solve for their posterior, linearised at the solution."""
    grasps = _grasps(weighings)
    about = np.zeros(1 + 2 * len(grasps))
    rows = [equations(weighing, gravity) for weighing in weighings]
    # Gains and tilt act in proportion to the load: start from no load, and iterate.
    found = fit(*load_model(rows, grasps, about, hand), len(about))
    for _ in range(LOAD_ITERATIONS):
        about = found.mean[: len(about)]
        found = fit(*load_model(rows, grasps, about, hand), len(about))
    return rows, found


def _grasps(weighings: Sequence[Weighing]) -> tuple[float, ...]:
    """List the times of the grasps, s, once each."""
    return tuple(dict.fromkeys(time for weighing in weighings for time in weighing.grasps))


def load_model(
    rows: Sequence[WeighingRows], grasps: Sequence[float], about: Array, hand: NominalHand
) -> LoadModel:
    """Set up causes, noise, signals and prior scales of weighings for `regression.fit`.

    The causes are F and the moments in each grasp, tilt of gravity, residual stiction of rests and
    passes, joint friction, gains and cross-talk.

    Args:
        about: F, N, and the moments, N m, at which the model is linearised.
    """
    signals = int(rows[0].signal.max()) + 1
    gains = gain_root(hand, signals)
    # Load: the vertical force, and two horizontal moments in each grasp.
    vertical = [
        np.column_stack([row.wrench[:, FORCE_Z], in_each(row, grasps, (TORQUE_X, TORQUE_Y))])
        for row in rows
    ]
    # Tilt of gravity: a horizontal part of the weight.
    tilted = [row.wrench[:, LEANING] for row in rows]
    tilt = TILT * abs(float(about[0])) + FLOOR
    # Gains and cross-talk act on the torques of the load.
    torques = [columns @ about for columns in vertical]
    pairs = list(zip(rows, torques, strict=True))
    borne = np.concatenate([torque[:, None] * gains[row.signal] for row, torque in pairs])
    crossed = np.concatenate([crosstalk_columns(hand, torque, signals) for torque in torques])
    # Joint friction is a sum of independent elements; residual stiction has the force repeatability.
    friction, left = (JOINT_LEVEL / len(SLIP_ANGLES) ** 0.5, hand.force_repeatability + FLOOR)
    stiction = zip(
        (*AT_HAND, OFFSETS), zip(*(row.stiction.columns for row in rows), strict=True), strict=True
    )
    parts: list[tuple[str, Sequence[Array], float]] = [
        ("load", vertical, LOAD_PRIOR),
        ("tilt", tilted, tilt),
        *((name, each_its_own(blocks), left) for name, blocks in stiction),
        ("joint friction", [row.dahl for row in rows], friction),
    ]
    # Stack the weighings of each cause.
    causes: list[Cause] = []
    for name, each, prior in parts:
        causes.append(Cause.build(name, np.concatenate(each), prior))
    causes += [build_gain(borne), build_gain(crossed, CROSSTALK)]
    shares = LEFT_SHARES
    even = [1.0 / len(shares)] * len(shares)
    # Learned scales of stiction: the share of the datasheet's figure that this arm shows, and the
    # share of it that remains in motion.
    scales = [
        PriorScale((*AT_HAND, OFFSETS), shares, even),
        PriorScale(AT_HAND, stiction_scales(rows), even),
        PriorScale((OFFSETS,), shares, even),
        PriorScale((GAIN,), *GAINS_OFF),
    ]
    noise = SignalNoise([row.root for row in rows], min(row.freedom for row in rows))
    return causes, noise, np.concatenate([row.observed for row in rows]), scales


def stiction_scales(rows: Sequence[WeighingRows]) -> Sequence[Array]:
    """List the scales of the stiction forces at rests, in passes, and common to a rest and its
    pass, for each of `LEFT_SHARES`."""
    # Columns of rests and of passes that belong to a pair of both.
    paired = [np.split(row.stiction.paired, [row.stiction.stuck.shape[1]]) for row in rows]
    rests, passes = (np.concatenate([pair[i] for pair in paired]) for i in (0, 1))
    both = sum(row.stiction.carried.shape[1] for row in rows)
    found: list[Array] = []
    # The pass keeps a share of the force, independent of the rest.
    for share in LEFT_SHARES[:-1]:
        parts = [np.ones(len(rests)), np.full(len(passes), share), np.zeros(both)]
        found.append(np.concatenate(parts))
    # With a share of 1 the pass has the same force as the rest before it.
    found.append(np.concatenate([~rests, ~passes, np.ones(both)]).astype(np.float64))
    return found


# Load from all free motion around a weighing


@dataclass(frozen=True, slots=True, eq=False)
class WholeLoad(FittedLoad):
    """Load from all free motion (`fit_whole`). Its levers are first moments of the weight along the hand's axes."""

    seen: Blocks  # block means that were fitted

    def at(self, grasps: Sequence[float], tools: Sequence[Array]) -> Array | None:
        """Build the matrix (1 + 2n, 1 + 3n) from `value` to force and moments as in
        `LoadEstimate.value`.

        None where the load did not hang free in one of the grasps.

        Args:
            grasps: s, n of them.
            tools: (3, 3) each, axes of the hand in the world at each grasp.
        """
        if not set(grasps) <= set(self.grasps):
            return None
        turned = np.zeros((1 + 2 * len(grasps), len(self.value)))
        turned[0, 0] = 1.0
        # Moments of a weight about world x and y: lever y times F, and minus lever x times F.
        for i, (grasp, tool) in enumerate(zip(grasps, tools, strict=True)):
            first = 1 + 3 * self.grasps.index(grasp)
            turned[1 + 2 * i, first : first + 3] = tool[1]
            turned[2 + 2 * i, first : first + 3] = -tool[0]
        return turned


def fit_whole(trace: Trace, name: str, noise: SignalLevels, about_force: float) -> WholeLoad | None:
    """Fit the load `name` to all the time it hung on the hand, linearised at `about_force` N.

    Two sets of rows are tried: all free motion, and only motion that certainly is free. Certainly free motion is high
    enough that the far end of a tilted object has left its support. It is close to where the load hung, and settled at
    rests or well away from them. The residual of the model widens each result, and the narrower counts.

    None where the arm's links are unknown, or the load never hung free.
    """
    observed = observe(trace)
    if observed.chain is None or not observed.knows_links:
        return None
    # Fit all free motion, and the certainly free motion alone.
    found: list[WholeLoad] = []
    for surely in (False, True):
        if free := free_rows(trace, name, surely):
            seen = blocks(trace, observed, name, free, surely)
            found.append(_fit_whole(trace, observed, seen, noise, about_force))
    best = min(found, key=lambda whole: whole.force_std, default=None)
    sensed = None if best is None else fit_sensed_grasps(trace, name)
    return best if best is None or sensed is None else _with_sensor(best, sensed)


def _with_sensor(whole: WholeLoad, sensed: SensedGrasps) -> WholeLoad:
    """Combine the load by the joint torques with that by a six-axis sensor.

    Both sets of rows have only the load in common. Their joint posterior is the product of both normal densities.
    """
    if len(whole.value) != len(sensed.value):
        return whole
    # Weight of the sensor's result, in the form of a Kalman gain.
    both = whole.covariance + sensed.covariance
    gain = np.linalg.solve(both, whole.covariance).T
    rest = np.eye(len(gain)) - gain
    own = Shared(SENSOR_GAIN, "arm", tuple((gain @ sensed.gain).tolist()))
    return replace(
        whole,
        value=whole.value + gain @ (sensed.value - whole.value),
        covariance=rest @ whole.covariance,
        shared=(*map_shared(whole.shared, rest), own),
    )


def _fit_whole(
    trace: Trace, observed: WrenchObservation, seen: Blocks, noise: SignalLevels, about_force: float
) -> WholeLoad:
    """Fit the load to block means: iterate the linearisation, then learn the residual of the model."""
    load = list(build_load(seen, seen.pull))
    columns = np.concatenate([cause.columns for cause in load], axis=1)
    about = np.zeros(columns.shape[1])
    about[0] = about_force

    def causes() -> list[Cause]:
        """Build all causes, with the effects of gains and tilt at the load `about` (1 + 3n,)."""
        lifted = about[0] * seen.pull[:, 2]
        return build_free_motion(trace, observed, seen, load, lifted, columns @ about)

    # Gains act in proportion to the moments, which are unknown at first: solve twice.
    first = causes()
    sensors, count = build_noise(seen, noise), len(about)
    about = fit(first, sensors, by_signal(seen.observed), arm_scales(first)).mean[:count]
    found = fit_blocks(causes(), seen, noise)
    value = found.mean[:count], found.covariance[:count, :count]
    return WholeLoad(seen.grasps, *value, found.shared(slice(count)), found, seen)
