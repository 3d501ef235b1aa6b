"""Gains of the torque sensors, and reference values with tolerance."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.estimation.arm_fit import Bodies
from palpate.estimation.estimate import KNOWN, FitTest, chi_squared
from palpate.estimation.joint_causes import link_deviations
from palpate.estimation.load_equations import equations
from palpate.estimation.load_fit import LOAD_ITERATIONS, LoadModel, fit_load, load_model
from palpate.estimation.regression import Cause, Posterior, SignalNoise, fit
from palpate.estimation.rigid_bodies import regressor
from palpate.estimation.segments import weighings
from palpate.estimation.wrench_observation import CROSSTALK, GAIN, gain_root, observe
from palpate.planning.plan import Node
from palpate.primitives.state import HOME_CONFIG
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.trace.samples import Trace

MASS: Mapping[str, float] = {"kg": 1.0, "g": 1e-3, "mg": 1e-6}
LENGTH: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
NUMBER = r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-zµ]*)\s*"
STATED = re.compile(rf"{NUMBER}(?:(?:±|\+-|\+/-){NUMBER})?")


@dataclass(frozen=True, slots=True)
class StatedSize:
    """Value within limits, in SI units."""

    value: float  # nominal value
    limit: float  # largest deviation from it, as on the certificate of a weight or a gauge block
    text: str  # as written

    @property
    def std(self) -> float:
        """Standard deviation of a uniform distribution within the limits (GUM, JCGM 100:2008, 4.3.7)."""
        return self.limit / math.sqrt(3.0)


def parse_reference(text: str, units: Mapping[str, float], what: str) -> StatedSize:
    """Parse `text`. Without a unit a number is in SI units, without a tolerance it is exact.
    Raises InputError: not of that form; the message names `what` and gives an example."""
    example = "0.5kg±0.1g" if "kg" in units else "50mm±0.01mm"
    refusal = InputError(
        f"{what} '{text}' is no size with a unit: give e.g. {example}, in {', '.join(units)}"
    )
    # Split into value, unit, tolerance and its unit; refuse unknown units.
    match = STATED.fullmatch(text)
    if match is None:
        raise refusal
    value, unit, limit, limit_unit = match.groups()
    if any(name and name not in units for name in (unit, limit_unit)):
        raise refusal
    try:
        size = float(value) * units.get(unit, 1.0)
        # A tolerance without a unit is in the unit of the value.
        off = float(limit) * units.get(limit_unit or unit, 1.0) if limit else 0.0
    except ValueError:
        raise refusal from None
    # A size is positive, and its tolerance smaller than itself.
    if not (0.0 < size < math.inf and off < size):
        raise refusal
    return StatedSize(size, off, text.strip())


@dataclass(frozen=True, slots=True)
class NamedSize:
    """Reference in the scene, written `[NAME=]SIZE`."""

    size: StatedSize  # its known mass or height
    name: str | None = None  # its name in the scene; None where there is only one candidate

    @classmethod
    def of(cls, text: str, units: Mapping[str, float], what: str) -> NamedSize:
        """Parse a reference; raises InputError as `parse_reference` does."""
        name, equals, size = text.rpartition("=")
        return cls(parse_reference(size, units, what), name.strip() if equals else None)


# Gains of the joint torque sensors, by a known weight in the hand or by the arm's own weight.

# Count of rests at which the arm weighs itself. Friction is about as large as the signal, and
# averages out over many rests.
CONFIGURATIONS = 30
# rad: half width of the uniform distribution of each joint about home.
SPREAD = np.array([0.8, 0.6, 0.6, 0.7, 1.0, 0.8, 1.2])
CLEAR = 0.25  # m: least height of the TCP above the plane of the arm's base
# Relative (1 sigma): wide prior of the gains, for a fit that the prior hardly influences.
WIDE = 0.1
MARGIN = 0.1  # rad: distance of each configuration to the joint limits
UP = np.array([0.0, 0.0, 1.0])
OFFSET = 1.0  # N m (1 sigma): torque offset of a joint, from zeroing and from friction at the start
ROUNDS = 4  # Iterations in which the fit learns the scatter of friction from its own residuals


@dataclass(frozen=True, slots=True, eq=False)
class GainBelief:
    """Gaussian of the relative gain errors of the torque sensors."""

    mean: Array  # (7,)
    covariance: Array  # (7, 7)

    def after(self, corrected: Array) -> GainBelief:
        """Compose with gains `corrected` (7,):

            1 + g = (1 + corrected) (1 + mean)

        The readings were already corrected by them.
        """
        # The covariance scales with the derivative of the composition, 1 + corrected.
        larger = 1.0 + corrected
        whole = larger * (1.0 + self.mean) - 1.0
        return GainBelief(whole, self.covariance * np.outer(larger, larger))


def require(tests: Sequence[FitTest], what: str) -> None:
    """Require that all tests passed. Raises InputError: some did not; the message has their findings."""
    failed = [test.finding for test in tests if not test.passed]
    if failed:
        raise InputError(f"{what} contradicts: {' '.join(failed)} Nothing is written.")


def gains_from_weighing(trace: Trace, parameter: Parameter, known: StatedSize) -> GainBelief:
    """Compute the posterior of the gains from the weighing of a known mass, kg.

    The readings of `trace` are corrected by the calibration so far; `parameter` is the mass of the weight.
    Raises InputError: the object was not weighed, its weighing contradicts itself, or its mass is not the stated one.
    """
    recording = trace.converted(parameter)
    if recording is None or trace.hand.chain is None:
        raise InputError(f"{parameter.object} was not weighed; nothing is calibrated")
    rests, gravity, hand = weighings(trace, recording), trace.gravity, trace.hand
    # Weigh with the prior of the gains. Test that the load hangs free and has the stated mass.
    load = fit_load(rests, gravity, hand)
    mass, mass_std = load.force / gravity, load.force_std / gravity
    same = chi_squared(
        "weight",
        (mass - known.value) ** 2 / (mass_std**2 + known.std**2),
        1,
        f"It weighs {1e3 * mass:.4g} g ± {1e3 * mass_std:.2g} g and is said to be {known.text}: it is "
        "another one, or the arm is not as good as its datasheet.",
        load.freedom,
    )
    require([*load.tests, same], "the weight")
    # Fit the gains with the load fixed at the stated weight. Centres of mass begin at zero.
    rows = [equations(weighing, gravity) for weighing in rests]
    grasps = tuple(time for weighing in rests for time in weighing.grasps)
    about = np.zeros(1 + 2 * len(grasps))
    about[0] = known.value * gravity
    force, std = known.value * gravity, known.std * gravity
    posterior = fit_at_force(load_model(rows, grasps, about, hand), force, std)
    # The columns of the gains are the load's own torques, whose moments are unknown at first.
    for _ in range(LOAD_ITERATIONS):
        about = np.concatenate([[force], posterior.mean[1 : len(about)]])
        posterior = fit_at_force(load_model(rows, grasps, about, hand), force, std)
    # The fit has unit prior deviations: scale its posterior by the root of the prior covariance.
    mean, covariance = posterior[GAIN]
    root = gain_root(hand, len(mean))
    return GainBelief(root @ mean, root @ covariance @ root.T)


def fit_at_force(model: LoadModel, force: float, std: float) -> Posterior:
    """Compute the posterior of a load model of a weighing with a known vertical force, `force` ± `std`, N.

    The first unknown of the posterior is the deviation from `force`.
    """
    # Replace the wide prior of the vertical force by the certificate's, about the known force.
    (load, *others), noise, y, scales = model
    known = replace(load, prior=np.array([std, *load.prior[1:]]))
    # A weight shows the gain together with the crosstalk: torques of other joints that a sensor
    # reads.
    others = [cause for cause in others if cause.name != CROSSTALK]
    # Noise with `freedom` degrees of freedom: use the standard deviation of Student's t.
    wider = math.sqrt(max(1.0, noise.freedom / max(noise.freedom - 2.0, 1.0)))
    # Leave out the hyperprior of the gains' scale: every fit that reads robot.yaml applies it
    # again. Applied here as well, it would leave an unloaded joint less certain after a calibration
    # than before.
    kept = [scale for scale in scales if GAIN not in scale.causes]
    noise = SignalNoise([wider * root for root in noise.roots], noise.freedom)
    return fit([known, *others], noise, y - force * load.columns[:, 0], kept)


def own_weight_tree(arm: RobotDescription) -> Node:
    """Make the tree of rests in configurations around home. The configurations are the same every
    time; the tree begins and ends at home.
    """
    # A fixed seed: every calibration visits the same configurations.
    random, nominal = np.random.default_rng(0), NominalArm(arm, Pose.of([0, 0, 0]), -9.81 * UP)
    low, high = arm.limits.q_min + MARGIN, arm.limits.q_max - MARGIN
    home = Node("MoveJoints", (("joints", HOME_CONFIG),))
    steps = [home]
    while len(steps) <= 2 * CONFIGURATIONS:
        # Draw a configuration; keep it if the TCP is above the clearance and away from the base.
        q = np.clip(arm.home + SPREAD * random.uniform(-1.0, 1.0, len(low)), low, high)
        x, y, z = nominal.poses(q[None])[0, :3].tolist()
        if z > CLEAR and math.hypot(x, y) > arm.reach.nearest:
            steps.append(Node("MoveJoints", (("joints", q.round(4).tolist()),)))
            steps.append(Node("MeasureForces"))
    return Node("Sequence", children=(*steps, home))


def gains_from_own_weight(trace: Trace, arm: RobotDescription) -> GainBelief:
    """Compute the posterior of the gains from the arm's own weight at rest in many configurations.

    The readings of `trace` are corrected by the calibration so far.
    Raises InputError: too few rests, or a weight that such an arm cannot have.
    """
    # Each recording is one rest; half of the planned ones must exist.
    rests = [samples for r in trace.recordings if len(samples := trace.of(r))]
    if len(rests) < CONFIGURATIONS // 2:
        raise InputError(
            f"the arm rested in {len(rests)} configurations, too few to determine its weight; nothing is "
            "written"
        )
    # Average positions and torques over each rest: white noise becomes negligible.
    q = np.array([rest.q.mean(axis=0) for rest in rests])
    torques = np.array([rest.tau_ext.mean(axis=0) for rest in rests])
    maps, root = observe(trace).maps(q), gain_root(trace.hand, q.shape[1])
    # Noise of a rest: friction and drift of each joint, and the wrench that sticks in all of them.
    own = arm.sensors.friction**2 + arm.sensors.drift**2
    stuck = trace.hand.force_repeatability * maps[:, :, :3]
    noise = np.diag(own) + stuck @ stuck.transpose(0, 2, 1)
    gains, others = own_weight_columns(trace, arm, q)
    # Fit the scatter with wide gains, so that an error of their prior does not count as scatter.
    wide = own_causes(WIDE * gains, others)
    noise = noise * scatter(wide, torques, noise)
    # Test the gains against zero, then fit them with their prior in units of its root.
    mean, covariance = own_fit(wide, torques, noise)[GAIN]
    require_own_weight(WIDE * mean, WIDE**2 * covariance, root @ root.T)
    mean, covariance = own_fit(own_causes(gains @ root, others), torques, noise)[GAIN]
    return GainBelief(root @ mean, root @ covariance @ root.T)


def own_causes(gains: Array, others: Array) -> list[Cause]:
    """Make the causes of the own-weight equations from their columns (n, 7, p), in units of their
    prior deviations.
    """
    causes: list[Cause] = []
    for name, columns in ((GAIN, gains), ("links and zeros", others)):
        count = int(columns.shape[2])
        causes.append(Cause(name, columns.reshape(-1, count), np.ones(count)))
    return causes


def own_fit(causes: Sequence[Cause], torques: Array, noise: Array) -> Posterior:
    """Fit torques `torques` (n, 7) with the noise covariance `noise` (n, 7, 7) of each rest, N m."""
    roots: list[Array] = [*np.linalg.cholesky(noise).astype(np.float64)]
    return fit(causes, SignalNoise(roots, KNOWN), torques.ravel())


def scatter(causes: Sequence[Cause], torques: Array, noise: Array) -> Array:
    """Estimate (7, 7) factors that scale the `noise` (n, 7, 7) of each joint to the residuals of the fit.

    Fixed-point iteration: each joint's variance is its sum of squared residuals over its residual
    degrees of freedom.
    """
    # Begin with the datasheet's noise.
    size = np.ones(torques.shape[1])
    for _ in range(ROUNDS):
        # Refit with the current scale; the degrees of freedom are 1 less the leverage of each row.
        posterior = own_fit(causes, torques, noise * np.outer(size, size))
        # Scale of each joint: root of its sum of squares over its degrees of freedom.
        left = (posterior.residual**2).reshape(torques.shape).sum(axis=0)
        freedom = (1.0 - posterior.leverage).reshape(torques.shape).sum(axis=0)
        size = size * np.sqrt(left / np.maximum(freedom, 1.0))
    return np.outer(size, size)


def require_own_weight(mean: Array, covariance: Array, believed: Array) -> None:
    """Require that gains estimated without a prior, `mean` (7,) with `covariance` (7, 7), agree with zero.

    `believed` (7, 7) is the prior covariance of the gains.
    """
    # Test statistic d^T S^-1 d over all joints; the message names the joint that deviates most.
    spread = covariance + believed
    deviations = np.abs(mean) / np.sqrt(spread.diagonal())
    worst = int(np.argmax(deviations))
    same = chi_squared(
        "own weight",
        float(mean @ np.linalg.solve(spread, mean)),
        len(mean),
        f"The arm measures its own weight otherwise than the accuracy of its sensors allows, most of all "
        f"in joint {worst + 1} ({deviations[worst]:.1f} standard deviations): they were calibrated wrongly, "
        "or the arm carries something.",
    )
    require([same], "the arm's own weight")


def own_weight_columns(trace: Trace, arm: RobotDescription, q: Array) -> tuple[Array, Array]:
    """Compute the columns of the own-weight equations at `q` (n, 7), N m.

    Returns:
        (n, 7, 7) torques of unit gains, and (n, 7, p) torques of one standard deviation of each
        other unknown: zero offsets, link masses and centres.
    """
    q = np.concatenate([trace.samples.q[:1], q])  # the sensors were zeroed at the start
    # All columns are differences to the configuration in which the sensors were zeroed.
    nominal = NominalArm(arm, Pose.of([0, 0, 0]), -trace.gravity * UP)
    weight, links = nominal.kinematics(q).gravity_torque, link_columns(arm, trace.gravity, q)
    # A unit gain adds the change of the joint's own gravity torque.
    gains = (weight[1:] - weight[0])[:, :, None] * np.eye(q.shape[1])
    offset = np.broadcast_to(OFFSET * np.eye(q.shape[1]), gains.shape)
    return gains, np.concatenate([offset, links[1:] - links[0]], axis=2)


def link_columns(arm: RobotDescription, gravity: float, q: Array) -> Array:
    """Change of the torques that hold the arm at `q` (n, 7), per standard deviation of the link parameters.

    Returns:
        (n, 7, 4 k) N m, for mass and three coordinates of the centre of each of k links, hand
        included.
    """
    chain, sensors, still = arm.nominal.chain, arm.sensors, np.zeros_like(q)
    assert chain is not None
    # Parameters of the links, the hand scaled to the described mass of the end effector.
    bodies = Bodies.of(chain, sensors.link_mass, sensors.link_com, arm.limits.payload)
    heavier = 1.0 if arm.end_effector is None else arm.end_effector.mass / bodies.hand[0]
    # Torques per unit of mass and of first moment of each link.
    regressors = regressor(chain, q, still, still, -gravity * UP)[..., :4]
    errors = sensors.link_mass, sensors.link_com
    links = [*enumerate(bodies.links), (q.shape[1] - 1, heavier * bodies.hand)]
    columns = [regressors[:, :, i] @ link_deviations(body[:4], *errors) for i, body in links]
    return np.concatenate(columns, axis=2)
