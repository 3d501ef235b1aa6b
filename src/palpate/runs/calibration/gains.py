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
from palpate.robots.robot_config import JOINTS
from palpate.trace.samples import Trace

MASS: Mapping[str, float] = {"kg": 1.0, "g": 1e-3, "mg": 1e-6}
LENGTH: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
NUMBER = r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-zµ]*)\s*"
STATED = re.compile(rf"{NUMBER}(?:(?:±|\+-|\+/-){NUMBER})?")


@dataclass(frozen=True, slots=True)
class Stated:
    """Value within limits, in SI units.

    Attributes:
        value: nominal value.
        limit: largest deviation from it, as on the certificate of a weight or a gauge block.
        text: as written.
    """

    value: float
    limit: float
    text: str

    @property
    def std(self) -> float:
        """Standard deviation of a uniform distribution within the limits (GUM, JCGM 100:2008, 4.3.7)."""
        return self.limit / math.sqrt(3.0)


def parse_reference(text: str, units: Mapping[str, float], what: str) -> Stated:
    """Parse `text`. Without a unit a number is in SI units, without a tolerance it is exact.

    Raises:
        InputError: not of that form; the message names `what` and gives an example.
    """
    example = "0.5kg±0.1g" if "kg" in units else "50mm±0.01mm"
    refusal = InputError(
        f"{what} '{text}' is no size with a unit: give e.g. {example}, in {', '.join(units)}"
    )
    found = STATED.fullmatch(text)
    if found is None:
        raise refusal
    value, unit, limit, limit_unit = found.groups()
    if any(name and name not in units for name in (unit, limit_unit)):
        raise refusal
    try:
        size = float(value) * units.get(unit, 1.0)
        # A tolerance without a unit is in the unit of the value.
        off = float(limit) * units.get(limit_unit or unit, 1.0) if limit else 0.0
    except ValueError:
        raise refusal from None
    if not (0.0 < size < math.inf and off < size):
        raise refusal
    return Stated(size, off, text.strip())


@dataclass(frozen=True, slots=True)
class Known:
    """Reference in the scene: `[NAME=]SIZE`.

    Attributes:
        size: its known mass or height.
        name: its name in the scene; None where there is only one candidate.
    """

    size: Stated
    name: str | None = None

    @classmethod
    def of(cls, text: str, units: Mapping[str, float], what: str) -> Known:
        """Parse a reference; raises InputError as `parse_reference` does."""
        name, found, size = text.rpartition("=")
        return cls(parse_reference(size, units, what), name.strip() if found else None)


# Gains of the joint torque sensors, from a known weight in the hand or from the arm's own weight.


CONFIGURATIONS = 30
"""Rests at which the arm weighs itself: friction is about as large as the signal, and averages out."""
SPREAD = np.array([0.8, 0.6, 0.6, 0.7, 1.0, 0.8, 1.2])
"""rad about home, uniform, half width."""
CLEAR = 0.25
"""m: least height of the TCP above the plane on which the arm stands."""
WIDE = 0.1
"""Relative (1 sigma): a bound of gains for a fit that hardly uses their prior."""
MARGIN = 0.1
"""rad to the joints' limits."""
UP = np.array([0.0, 0.0, 1.0])
OFFSET = 1.0
"""N m (1 sigma): torque offset of a joint, from zeroing and friction at the start."""
ROUNDS = 4
"""Iterations in which the fit learns the scatter of friction from its own residuals."""


@dataclass(frozen=True, slots=True, eq=False)
class GainBelief:
    """Gaussian of the torque sensors' relative gain errors: `mean` (7,), `covariance` (7, 7)."""

    mean: Array
    covariance: Array

    def after(self, corrected: Array) -> GainBelief:
        """Compose with gains `corrected` (7,) by which the readings were already corrected:
        1 + g = (1 + corrected)(1 + mean)."""
        larger = 1.0 + corrected
        whole = larger * (1.0 + self.mean) - 1.0
        return GainBelief(whole, self.covariance * np.outer(larger, larger))


def require(tests: Sequence[FitTest], what: str) -> None:
    """Require that all tests passed.

    Raises:
        InputError: some did not; the message has their findings.
    """
    failed = [test.finding for test in tests if not test.passed]
    if failed:
        raise InputError(f"{what} contradicts: {' '.join(failed)} Nothing is written.")


def gains_from_weighing(trace: Trace, parameter: Parameter, known: Stated) -> GainBelief:
    """Compute the posterior of the gains from a weighing of a `known` mass, kg, in `trace`, whose readings
    are corrected by the calibration so far.

    Raises:
        InputError: it was not weighed, its weighing contradicts itself, or it weighs something else than
            is stated.
    """
    recording = trace.converted(parameter)
    if recording is None or trace.hand.chain is None:
        raise InputError(f"{parameter.object} was not weighed; nothing is calibrated")
    found, gravity, hand = weighings(trace, recording), trace.gravity, trace.hand
    # Weighed with the prior of the gains: does it hang free, and weigh what is stated?
    load = fit_load(found, gravity, hand)
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
    rows = [equations(weighing, gravity) for weighing in found]
    grasps = tuple(time for weighing in found for time in weighing.grasps)
    about = np.zeros(1 + 2 * len(grasps))
    about[0] = known.value * gravity
    force, std = known.value * gravity, known.std * gravity
    posterior = fit_at_force(load_model(rows, grasps, about, hand), force, std)
    # The columns of the gains are the load's own torques, whose moments are unknown at first.
    for _ in range(LOAD_ITERATIONS):
        about = np.concatenate([[force], posterior.mean[1 : len(about)]])
        posterior = fit_at_force(load_model(rows, grasps, about, hand), force, std)
    mean, covariance = posterior[GAIN]
    root = gain_root(hand, JOINTS)
    return GainBelief(root @ mean, root @ covariance @ root.T)


def fit_at_force(model: LoadModel, force: float, std: float) -> Posterior:
    """Posterior of a load model with a known vertical `force` ± `std`, N. The first unknown is the deviation from
    that force."""
    (load, *others), noise, y, scales = model
    known = replace(load, prior=np.array([std, *load.prior[1:]]))
    # What a sensor reads of the other joints' torques belongs to the gain that a weight shows.
    others = [cause for cause in others if cause.name != CROSSTALK]
    # Noise estimated from `freedom` blocks: standard deviation of Student's t.
    wider = math.sqrt(max(1.0, noise.freedom / max(noise.freedom - 2.0, 1.0)))
    # Without the hyperprior of the gains' scale: every fit that reads robot.yaml applies it again. Applied
    # here, too, an unloaded joint would be known worse after a calibration than before.
    kept = [scale for scale in scales if GAIN not in scale.causes]
    noise = SignalNoise([wider * root for root in noise.roots], noise.freedom)
    return fit([known, *others], noise, y - force * load.columns[:, 0], kept)


def own_weight_tree(arm: RobotDescription) -> Node:
    """Tree of rests in configurations around home, the same ones every time, from home and back."""
    random, nominal = np.random.default_rng(0), NominalArm(arm, Pose.of([0, 0, 0]), -9.81 * UP)
    low, high = arm.limits.q_min + MARGIN, arm.limits.q_max - MARGIN
    home = Node("MoveJoints", (("joints", HOME_CONFIG),))
    steps = [home]
    while len(steps) <= 2 * CONFIGURATIONS:
        q = np.clip(arm.home + SPREAD * random.uniform(-1.0, 1.0, JOINTS), low, high)
        x, y, z = nominal.poses(q[None])[0, :3].tolist()
        if z > CLEAR and math.hypot(x, y) > arm.reach.nearest:
            steps.append(Node("MoveJoints", (("joints", q.round(4).tolist()),)))
            steps.append(Node("MeasureForces"))
    return Node("Sequence", children=(*steps, home))


def weighed_itself(trace: Trace, arm: RobotDescription) -> GainBelief:
    """Compute the posterior of the gains from the arm's own weight at rest in many configurations; the
    readings are corrected by the calibration so far.

    Raises:
        InputError: too few rests, or a weight that such an arm cannot have.
    """
    rests = [samples for r in trace.recordings if len(samples := trace.of(r))]
    if len(rests) < CONFIGURATIONS // 2:
        raise InputError(
            f"the arm rested in {len(rests)} configurations, too few to determine its weight; nothing is "
            "written"
        )
    q = np.array([rest.q.mean(axis=0) for rest in rests])
    observed = np.array([rest.tau_ext.mean(axis=0) for rest in rests])
    maps, root = observe(trace).maps(q), gain_root(trace.hand, JOINTS)
    # Friction and drift of each joint, and the wrench that sticks in all of them, differ at every rest.
    own = arm.sensors.friction**2 + arm.sensors.drift**2
    stuck = trace.hand.force_repeatability * maps[:, :, :3]
    noise = np.diag(own) + stuck @ stuck.transpose(0, 2, 1)
    gains, others = own_weight_columns(trace, arm, q)
    # The scatter is fitted with wide gains, so that a wrong prior of them does not pass for scatter.
    wide = own_causes(WIDE * gains, others)
    noise = noise * scatter(wide, observed, noise)
    mean, covariance = own_fit(wide, observed, noise)[GAIN]
    require_own_weight(WIDE * mean, WIDE**2 * covariance, root @ root.T)
    mean, covariance = own_fit(own_causes(gains @ root, others), observed, noise)[GAIN]
    return GainBelief(root @ mean, root @ covariance @ root.T)


def own_causes(gains: Array, others: Array) -> list[Cause]:
    """Causes of the own-weight equations by their columns (n, 7, p), in units of their prior deviations."""
    found: list[Cause] = []
    for name, columns in ((GAIN, gains), ("links and zeros", others)):
        count = int(columns.shape[2])
        found.append(Cause(name, columns.reshape(-1, count), np.ones(count)))
    return found


def own_fit(causes: Sequence[Cause], observed: Array, noise: Array) -> Posterior:
    """Fit torques `observed` (n, 7) with the covariance `noise` (n, 7, 7) at each rest."""
    roots: list[Array] = [*np.linalg.cholesky(noise).astype(np.float64)]
    return fit(causes, SignalNoise(roots, KNOWN), observed.ravel())


def scatter(causes: Sequence[Cause], observed: Array, noise: Array) -> Array:
    """(7, 7) factors that make the `noise` (n, 7, 7) of each joint as large as the fit's residuals."""
    size = np.ones(JOINTS)
    for _ in range(ROUNDS):
        found = own_fit(causes, observed, noise * np.outer(size, size))
        left = (found.residual**2).reshape(observed.shape).sum(axis=0)
        freedom = (1.0 - found.leverage).reshape(observed.shape).sum(axis=0)
        size = size * np.sqrt(left / np.maximum(freedom, 1.0))
    return np.outer(size, size)


def require_own_weight(mean: Array, covariance: Array, believed: Array) -> None:
    """Require that gains estimated without a prior, `mean` (7,) with `covariance` (7, 7), agree with zero
    within the prior covariance `believed` (7, 7)."""
    spread = covariance + believed
    apart = np.abs(mean) / np.sqrt(spread.diagonal())
    worst = int(np.argmax(apart))
    same = chi_squared(
        "own weight",
        float(mean @ np.linalg.solve(spread, mean)),
        JOINTS,
        f"The arm measures its own weight otherwise than the accuracy of its sensors allows, most of all "
        f"in joint {worst + 1} ({apart[worst]:.1f} standard deviations): they were calibrated wrongly, "
        "or the arm carries something.",
    )
    require([same], "the arm's own weight")


def own_weight_columns(trace: Trace, arm: RobotDescription, q: Array) -> tuple[Array, Array]:
    """Columns of the own-weight equations at `q` (n, 7): torques of unit gains (n, 7, 7), and those of one
    standard deviation of each other unknown, zero offsets, link masses and centres (n, 7, p); N m."""
    q = np.concatenate([trace.samples.q[:1], q])  # the sensors were zeroed at the start
    nominal = NominalArm(arm, Pose.of([0, 0, 0]), -trace.gravity * UP)
    weight, links = nominal.kinematics(q).gravity_torque, link_columns(arm, trace.gravity, q)
    gains = (weight[1:] - weight[0])[:, :, None] * np.eye(JOINTS)
    offset = np.broadcast_to(OFFSET * np.eye(JOINTS), gains.shape)
    return gains, np.concatenate([offset, links[1:] - links[0]], axis=2)


def link_columns(arm: RobotDescription, gravity: float, q: Array) -> Array:
    """(n, 7, 4 k) N m: change of the torques that hold the arm at `q` (n, 7), by one standard deviation of
    the mass of each of k links, hand included, and of its centre along three axes."""
    chain, sensors, still = arm.nominal.chain, arm.sensors, np.zeros_like(q)
    assert chain is not None
    bodies = Bodies.of(chain, sensors.link_mass, sensors.link_com, arm.limits.payload)
    heavier = 1.0 if arm.end_effector is None else arm.end_effector.mass / bodies.hand[0]
    # Torques of a unit of mass and first moment of each link.
    held = regressor(chain, q, still, still, -gravity * UP)[..., :4]
    columns: list[Array] = []
    for joint, body in [*enumerate(bodies.links), (JOINTS - 1, heavier * bodies.hand)]:
        shifts = sensors.link_com * body[0] * np.eye(4)[:, 1:]
        sizes = np.column_stack([sensors.link_mass * body[:4], shifts])
        columns.append(held[:, :, joint] @ sizes)
    return np.concatenate(columns, axis=2)
