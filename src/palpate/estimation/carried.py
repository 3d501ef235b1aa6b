"""Inertial parameters of a load that an arm carried through a recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose, components, tensor_of
from palpate.estimation.arm_dynamics import SURELY
from palpate.estimation.arm_fit import (
    COMMON,
    DETAILS,
    FRICTION,
    OFFSET_PRIOR,
    PARTS,
    WEIGHT,
    Assumed,
    Bodies,
    Setup,
    SpectrumRows,
    fit_arm,
)
from palpate.estimation.arm_motion import (
    EqualMotions,
    JointMotion,
    equal_motions,
    transform_signal,
    uniform_runs,
)
from palpate.estimation.estimate import (
    UNSEEN,
    Z95,
    Estimate,
    FitTest,
    FitView,
    FurtherValue,
    chi_squared,
    map_shared,
    not_identified,
)
from palpate.estimation.evidence import once
from palpate.estimation.joint_causes import DRIFT, DRIFT_TIME, LINK_CENTRE, LINK_MASS, per_joint
from palpate.estimation.joint_friction import FLOOR
from palpate.estimation.load_noise import load_rows
from palpate.estimation.motion import Mask
from palpate.estimation.recording_check import CLAIM_MASS, Claim, explained
from palpate.estimation.regression import Cause, Posterior, PriorScale
from palpate.estimation.rigid_bodies import (
    BODY_PRIOR,
    RADIUS,
    SKEW,
    about_centre,
    in_axes,
    jacobian,
    linear,
    load_torques,
    of_box,
    placed_at,
    pseudo_inertia,
    repeat_prior,
)
from palpate.estimation.sensed_load import SensedLoad, fit_sensed_load, observable, sensed_tests
from palpate.estimation.weighing import mass_view
from palpate.estimation.wrench_observation import (
    CROSSTALK,
    CROSSTALK_SHARE,
    TORQUE_LEVER,
    common_gain,
    gain_root,
    is_sensed,
    observe,
)
from palpate.mjcf.body import Body
from palpate.trace.recording import ArmLog, Recording
from palpate.trace.samples import Trace

HAND_PRIOR = repeat_prior(3.0, 0.5, 0.05)
"""Priors like `BODY_PRIOR`, of an unknown end effector. Not sensitive."""
RESTARTED = 5.0
"""s: gap between rows after which the recording may have been restarted, with new sensor zeros. Not sensitive."""
LIKELY_RESTART = (0.7, 0.3)
"""prior probabilities that such a gap is not, and is, a restart. Chosen, without a source. Not sensitive at 0.9."""

DRIFT_FACTORS = (1.0, 3.0, 10.0)
"""Factors on the drift of the sensors' zeros, `DRIFT`. Repetitions of a motion show it. Sensitive: mass 0.1 σ, std
×1.0–1.1."""
LIKELY_DRIFT = (0.5, 0.4, 0.1)
"""Prior probabilities of `DRIFT_FACTORS`. Chosen, without a source. Sensitive: no."""
LOAD, HAND, ZERO_DRIFT = "load", "hand", "drift"
"""Names of causes."""


@dataclass(frozen=True, slots=True, eq=False)
class CarriedLoad:
    """Fitted load of a recording."""

    # (10,) kg, kg m and kg m²: mass, first moment and inertia about the TCP, in the tool's axes.
    value: Array
    covariance: Array  # (10, 10) of `value`
    motions: Sequence[JointMotion]  # s stretches of the recording, each loaded or empty throughout
    hanging: Mask  # (s,) stretches in which the load was carried
    # s arrays (n, 7, 10), joint torques of a unit of each parameter in each stretch, carried or not.
    torques: Sequence[Array]
    equal: EqualMotions  # groups of stretches with the same motion
    posterior: Posterior  # of the fit
    explained: FitTest  # test that the described arm explains the recording

    causes = "friction, zeros and gains of the joints and errors of the arm's model"
    """Causes that are fitted together with the load, for texts."""

    def times(self, hanging: bool) -> Array:
        """Times, s, of the rows with or without the load."""
        pairs = zip(self.motions, self.hanging, strict=True)
        return np.concatenate([motion.t for motion, hung in pairs if hung == hanging])

    @property
    def compared(self) -> bool:
        """True if the recording also holds motion of the empty hand."""
        return not self.hanging.all()

    @property
    def kinematic_error(self) -> float:
        """Standard deviation, m, of the place of the load by errors of link lengths and joint zeros.

        It is in proportion to the errors of the links' weight that the recording shows.
        """
        mean, covariance = self.posterior[WEIGHT]
        prior = next(cause.prior for cause in self.posterior.causes if cause.name == WEIGHT)
        scale = float(np.sqrt(np.mean((mean**2 + np.diag(covariance)) / prior**2)))
        return KINEMATIC * min(scale / CAREFUL, 1.0)

    def seconds(self, hanging: bool) -> float:
        """Duration of the stretches with (`hanging`) or without the load, s."""
        pairs = zip(self.motions, self.hanging, strict=True)
        return sum(float(np.ptp(motion.t)) for motion, hung in pairs if hung == hanging)

    def part(self, start: float, end: float, hanging: bool = True) -> Array:
        """Compute the regression rows (7 k,) of the load, scaled to 1 kg, present from `start` to
        `end` s only.

        Args:
            hanging: use the stretches with the load, else those of the empty hand.
        """
        share = self.value / max(float(self.value[0]), 1e-3)
        rows: list[Array] = []
        for motion, hung, torque in zip(self.motions, self.hanging, self.torques, strict=True):
            here = (start <= motion.t) & (motion.t <= end) & (hung == hanging)
            rows.append(transform_signal(here[:, None] * (torque @ share), motion.step))
        return self.equal.combine(rows).ravel()


@once
def fit_carried_load(trace: Trace, name: str) -> CarriedLoad | None:
    """Fit the load `name` to all time in which it was carried or the hand was empty.

    If the recording is used for the mass of the hand, the hand is fitted as well. None where the
    arm's links are unknown or the load was never carried.
    """
    observed, rows = observe(trace), load_rows(trace, name)
    chain = observed.chain
    if chain is None or not chain.links or not rows.loaded.any():
        return None
    # Cut the recording into stretches with the load and with the empty hand.
    samples, gravity = trace.samples, -trace.gravity * observed.turn[2]
    log = ArmLog(samples.t, samples.q, samples.dq, observed.signals, None, "")
    loaded, empty = (list(_stretches(log, used)) for used in (rows.loaded, rows.empty))
    if not loaded:
        return None
    # Stretches of one motion are combined: what depends on the motion alone cancels.
    found, equal = equal_motions(loaded, empty)
    # Claim that the described arm explains these rows; it is tested after the fit.
    used = rows.loaded | rows.empty
    claim = Claim.of(log, trace.hand, gravity, rows.loaded, used, held=True)
    motions, hanging = [motion for motion, _ in found], np.array([hung for _, hung in found])
    # Regressors: joint torques of each parameter of the load, and those of the arm's own errors.
    torques = [load_torques(chain, one.q, one.dq, one.ddq, gravity) for one in motions]
    bodies = Bodies.of(chain, LINK_MASS, LINK_CENTRE, 0.0, is_hand_known=True)
    setup = Setup(chain, bodies, samples.q[0], gravity, held=True)
    seen = SpectrumRows.of(motions, setup, equal)
    # Causes to fit: the load, new sensor zeros after gaps, and sensor gains.
    loads = list(_loads(trace, equal, motions, hanging, torques))
    begun = list(_restarts(log, equal, motions))
    alike = PriorScale(tuple(one.name for one in begun), (0.0, 1.0), LIKELY_RESTART)
    gains, common = gain_root(trace.hand, len(chain.axes)), common_gain(trace.hand)
    names = (*FRICTION, *DETAILS, *([COMMON, CROSSTALK] if common else []), *PARTS)
    learned = [alike] if begun else []
    begun.append(_drift(equal, motions))
    learned.append(PriorScale((ZERO_DRIFT,), DRIFT_FACTORS, LIKELY_DRIFT))
    crosstalk = CROSSTALK_SHARE * common
    assumed = Assumed(bodies, bodies.hand, gains, common, crosstalk)
    posterior = fit_arm(seen, assumed, names, loads, begun, learned).posterior
    value, covariance = posterior[LOAD]
    return CarriedLoad(
        value, covariance, motions, hanging, torques, equal, posterior, explained(claim)
    )


def _loads(
    trace: Trace,
    equal: EqualMotions,
    motions: Sequence[JointMotion],
    hanging: Mask,
    torques: Sequence[Array],
) -> Iterator[tuple[Cause, Sequence[Array]]]:
    """Yield the load in its stretches; the hand in all stretches where its mass is requested."""
    # Torques of a unit of each parameter, zero where the load was not carried.
    borne = [hung * torque for hung, torque in zip(hanging, torques, strict=True)]
    loads = [(LOAD, borne, BODY_PRIOR)]
    if trace.converted(Parameter(HAND, "mass")) is not None:
        loads.append((HAND, list(torques), HAND_PRIOR))
    for name, parts, prior in loads:
        rows = [transform_signal(part, one.step) for part, one in zip(parts, motions, strict=True)]
        yield Cause.build(name, equal.combine(rows), prior), parts


def _restarts(log: ArmLog, equal: EqualMotions, motions: Sequence[JointMotion]) -> Iterator[Cause]:
    """Yield new sensor zeros and friction states after each long gap in the recording."""
    for i in np.flatnonzero(np.diff(log.t) > RESTARTED).tolist():
        # A restart changes only the later stretches.
        parts: list[Array] = []
        for one in motions:
            signals = [np.ones_like(one.q), *np.moveaxis(one.strained, 2, 0)]
            own = per_joint(*(transform_signal(signal, one.step) for signal in signals))
            parts.append(float(one.t[0] > log.t[i]) * own)
        yield Cause.build(f"start at {log.t[i + 1]:g} s", equal.combine(parts), OFFSET_PRIOR)


def _drift(equal: EqualMotions, motions: Sequence[JointMotion]) -> Cause:
    """Build the drift of the sensors' zeros from stretch to stretch, an Ornstein-Uhlenbeck process."""
    t = np.array([one.t.mean() for one in motions])
    between = np.abs(t[:, None] - t)
    root = np.linalg.cholesky(np.exp(-between / DRIFT_TIME) + FLOOR * np.eye(len(t)))
    parts: list[Array] = []
    for one, row in zip(motions, root, strict=True):
        level = transform_signal(np.ones_like(one.q), one.step)
        parts.append(per_joint(*(own * level for own in row)))
    return Cause.build(ZERO_DRIFT, equal.combine(parts), DRIFT * TORQUE_LEVER)


def _stretches(log: ArmLog, rows: Mask) -> Iterator[JointMotion]:
    """Cut a recording into uniformly sampled stretches within `rows` (n,)."""
    for motion in uniform_runs(log):
        # Split each uniform run where the nearest logged row enters or leaves `rows`.
        nearest = np.searchsorted(log.t, motion.t).clip(0, len(log.t) - 1)
        used = rows[nearest]
        edges = np.flatnonzero(np.diff(used)) + 1
        for part in np.split(np.arange(len(motion)), edges):
            if used[part[0]]:
                yield motion.between(int(part[0]), int(part[-1]) + 1)


# Mass, centre of mass and inertia of a carried load.


CARRIED_HALF = 1.0
"""s: shortest half of a window whose mass is compared with the others. Not sensitive."""
COM_BELIEVED = 0.05
"""m (1 sigma): prior distance of a load's centre of mass from the fingertips. Not sensitive."""
KINEMATIC = 4e-4
"""m (1 sigma): error of the hand's place by link lengths and joint zeros of an arm installed with care: 0.3 mm a link,
and 1 mrad a joint at the wrist's levers. Sensitive: com std ×1.0–1.4 above 1 kg."""
CAREFUL = 0.2
"""factor on the prior errors of links (`LINK_MASS`, `LINK_CENTRE`) of such an arm. Sensitive: as `KINEMATIC`."""
RADIUS_BELIEVED = 0.1
"""m: largest plausible radius of gyration of a load. Not sensitive."""
CARRIED_APART = 0.03
"""fraction of the mass (1 sigma): tolerated difference between the halves of a window. A larger one
shows that the load was taken or left in between. Not sensitive."""
CARRIED_LEAST = 0.005
"""kg (1 sigma): tolerated difference, as the lower bound of `CARRIED_APART`. Not sensitive."""
RADIUS_LIKELY = (0.03, 1.0)
"""m, and 1 sigma of the logarithm: root mean square distance of a load's mass from its centre along an axis, 4 mm to
0.2 m. A motion hardly shows the inertia of a light load. Sensitive: inertia below 0.5 kg at `measured`, std ×0.7."""
SKEW_LIKELY = 0.03
"""m (1 sigma): the same distance for the products of inertia. Sensitive: as `RADIUS_LIKELY`."""

EMPTY_PARTS = 6
"""Number of parts of the empty hand's time that are compared."""
CARRIED_PARTS = 24
"""Largest number of parts of a recording in a chart."""
ALONE = (
    "the recording holds no motion of the empty hand, so that errors of the arm's model count as load: give one "
    "(empty=LOG)"
)


def estimate_mass(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Estimate the mass of the load, or of the hand itself, from its weight and its inertial force."""
    found = _fit_load(trace)
    if found is None:
        return _nothing(parameter, "kg", trace)
    if isinstance(found, SensedLoad) and (reason := observable(found)):
        return not_identified(parameter, "kg", reason, _recordings(trace))
    # The cause whose mass is requested: the hand itself or the load.
    name = HAND if parameter.object == HAND else LOAD
    mean, covariance = found.posterior[name]
    mass, std = float(mean[0]), float(np.sqrt(covariance[0, 0]))
    what = "hand with what is mounted on it" if name == HAND else "load"
    method = (
        f"Weight of the {what} and its resistance to acceleration in {_seconds(found)}, fitted together with "
        f"{found.causes}; the noise is what the recording itself leaves."
    )
    return Estimate.normal(
        parameter,
        "kg",
        mass,
        std,
        method,
        _recordings(trace),
        reason="" if found.compared or name == HAND else ALONE,
        tests=(
            *_sound(trace, found, name),
            *(_same_in_all_parts(trace, found) if name == LOAD else ()),
        ),
        shared=map_shared(found.posterior.shared(name), np.eye(10)[:1]),
        views=(_mass_view(trace, found),) if name == LOAD else (),
    )


def estimate_com(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Estimate the centre of mass of the load, m: its first moment over its mass."""
    found = _fit_load(trace)
    if found is None or not _is_felt(trace, found):
        return _nothing(parameter, "m", trace)
    # Centre of mass in the object's frame.
    to_body = _in_hand(trace).inverse()

    def centre(value: Array) -> Array:
        return to_body.apply(value[1:4] / value[0])

    # Propagate the covariance, and mark the axes that the motion did not excite.
    slopes = jacobian(centre, found.value)
    stds = np.hypot(np.sqrt(np.diag(slopes @ found.covariance @ slopes.T)), found.kinematic_error)
    unseen = tuple(np.flatnonzero(stds > COM_BELIEVED).tolist())
    made = Estimate.normal(
        parameter,
        "m",
        centre(found.value),
        stds,
        f"First moment of the load over its mass, in {_axes(trace)}.",
        _recordings(trace),
        parts={
            "mass": FurtherValue(
                float(found.value[0]), float(np.sqrt(found.covariance[0, 0])), "kg"
            )
        },
        reason=UNSEEN if len(unseen) == 3 else "" if found.compared else ALONE,
        unseen=unseen,
        tests=_same_in_all_parts(trace, found),
    )
    return replace(made, shared=map_shared(found.posterior.shared(LOAD), slopes))


def estimate_inertia(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Estimate the inertia of the load about its centre of mass, kg m².

    The value is that of the likeliest physically consistent body.
    """
    found = _fit_load(trace)
    if found is None or not _is_felt(trace, found):
        return _nothing(parameter, "kg·m²", trace)
    pose, body_fit = _in_hand(trace), fit_body(found.value, found.covariance)

    def central(theta: Array) -> Array:
        """Inertia about the centre of mass, in the object's axes."""
        tensor = tensor_of(about_centre(theta).tolist())
        return np.array(components(pose.rotation.T @ tensor @ pose.rotation))

    # Propagate the covariance of the body to the six components, and the error of its place in the hand.
    value, slopes = central(body_fit.theta), jacobian(central, body_fit.theta)
    place = in_axes(pose.rotation.T)[4:, 4:] @ _place_effects(trace, found)
    variance = np.diag(slopes @ body_fit.covariance @ slopes.T) + (place**2).sum(axis=1)
    stds = np.sqrt(variance)
    # A component is observed if its error is small against the reference size. The reference is the
    # moment itself, for a product the mean moment, and at most that of the largest plausible load.
    # Products without any observed moment do not count.
    believed = float(found.value[0]) * RADIUS_BELIEVED**2
    sizes = np.minimum([*value[:3], *[value[:3].mean()] * 3], believed)
    hardly = stds > 0.5 * sizes
    unseen = tuple(np.flatnonzero(hardly | hardly[:3].all()).tolist())
    names = ("xx", "yy", "zz", "xy", "xz", "yz")
    weak = ", ".join(names[i] for i in unseen)
    excited = f" Hardly excited: {weak}; turn the hand faster about more axes." if weak else ""
    test = chi_squared(
        "physical consistency",
        body_fit.misfit,
        10,
        "No rigid body has the inertia that was fitted: the load moves in the hand, or is no rigid body.",
    )
    made = Estimate.normal(
        parameter,
        "kg·m²",
        value,
        stds,
        f"Resistance of the load to being turned, about its centre of mass, in {_axes(trace)}; of the likeliest "
        f"physically consistent body (Wensing, Kim and Slotine, RA-L 2018).{excited}",
        _recordings(trace),
        reason=UNSEEN if len(unseen) == 6 else "" if found.compared else ALONE,
        unseen=unseen,
        tests=(test, *_same_in_all_parts(trace, found)),
    )
    return replace(made, shared=map_shared(found.posterior.shared(LOAD), slopes @ body_fit.gain))


def _place_effects(trace: Trace, found: CarriedLoad | SensedLoad) -> Array:
    """Effects (6, 3), kg m², of `kinematic_error` along each axis on the inertia about the centre of mass, tool axes.

    The joints show the inertia about the wrist. That of a load at `lever` from there has the part m lever² (Steiner).
    """
    chain, value = trace.hand.chain, found.value
    if chain is None:
        return np.zeros((6, 3))
    from_wrist = np.array(chain.tool).T @ (np.array(chain.tcp) - chain.anchors[-1])
    lever = from_wrist + value[1:4] / value[0]
    effects: Array = found.kinematic_error * value[0] * placed_at(lever)[4:, 1:4]
    return effects


class FittedBody(NamedTuple):
    """Physically consistent body, by its log-Cholesky parameters (10,)."""

    theta: Array
    covariance: Array  # (10, 10)
    gain: Array  # (10, 10) change of `theta` with the ten fitted parameters
    misfit: float  # squared Mahalanobis distance from these


def fit_body(value: Array, covariance: Array) -> FittedBody:
    """Find the likeliest physically consistent body for ten fitted parameters, with a prior of its size.

    The covariance is that of the linearised fit in log-Cholesky coordinates, in which every body is consistent.
    Source: P. Wensing, S. Kim and J.-J. Slotine, Linear matrix inequalities for physically consistent inertial
    parameter identification, IEEE RA-L 3, 2018.
    """
    from scipy.optimize import least_squares  # takes longer to import than most plans to make

    root = np.linalg.cholesky(covariance)
    likely, spread = np.log(RADIUS_LIKELY[0]), RADIUS_LIKELY[1]

    def residuals(theta: Array) -> Array:
        left: Array = np.linalg.solve(root, linear(pseudo_inertia(theta)) - value).astype(float)
        return np.concatenate([left, (theta[RADIUS] - likely) / spread, theta[SKEW] / SKEW_LIKELY])

    # Start from a box of the fitted mass and centre of mass.
    mass = max(float(value[0]), 1e-3)
    start = of_box(mass, value[1:4] / mass, np.full(3, RADIUS_LIKELY[0] * np.sqrt(12.0)))
    solved: Any = least_squares(residuals, start, x_scale="jac")
    theta, slopes = np.asarray(solved.x, float), np.asarray(solved.jac, float)
    within = np.linalg.inv(slopes.T @ slopes).astype(np.float64)
    # The first ten residuals are those of the fitted parameters, whitened.
    gain = np.linalg.solve(root.T, slopes[:10] @ within).T.astype(np.float64)
    return FittedBody(theta, within, gain, float(np.sum(residuals(theta)[:10] ** 2)))


def _fit_load(trace: Trace) -> CarriedLoad | SensedLoad | None:
    """Fit the first load that the recordings name; None without one."""
    names = [one.context.holding for one in trace.recordings if one.context.holding]
    fit_one = fit_sensed_load if is_sensed(trace) else fit_carried_load
    return fit_one(trace, names[0]) if names else None


def _recordings(trace: Trace) -> tuple[Recording, ...]:
    """Select the recordings with a load."""
    return tuple(one for one in trace.recordings if one.context.holding)


def _in_hand(trace: Trace) -> Pose:
    """Pose of the object in the hand, as stated by the grasp of a recording; identity without one."""
    stated = _recordings(trace)[0].context.grasp
    numbers = [float(word) for word in stated.split()] if stated else [0.0] * 3
    return Pose.of(numbers[:3], numbers[3:] or (1.0, 0.0, 0.0, 0.0))


def _axes(trace: Trace) -> str:
    """Name the axes of the result."""
    stated = _recordings(trace)[0].context.grasp
    if stated:
        return "the object's frame"
    sensed = "the axes of the sensor, from its origin"
    return sensed if is_sensed(trace) else "the axes of the tool, from the TCP"


def _is_felt(trace: Trace, found: CarriedLoad | SensedLoad) -> bool:
    """Return true if the mass differs from zero and its tests pass, so that quotients by it are defined."""
    if isinstance(found, SensedLoad) and observable(found):
        return False
    mass, std = float(found.value[0]), float(np.sqrt(found.covariance[0, 0]))
    return mass > Z95 * std and all(test.passed for test in _sound(trace, found, LOAD))


def _nothing(parameter: Parameter, unit: str, trace: Trace) -> Estimate:
    """Report a load that is contradicted or was not detected."""
    found = _fit_load(trace)
    if isinstance(found, SensedLoad) and (reason := observable(found)):
        return not_identified(parameter, unit, reason)
    if found is not None and not all(test.passed for test in _sound(trace, found, LOAD)):
        return not_identified(parameter, unit, "The mass is contradicted: see there.")
    return not_identified(
        parameter, unit, "No load was felt in the windows in which one was said to be carried."
    )


def _sound(trace: Trace, found: CarriedLoad | SensedLoad, name: str) -> tuple[FitTest, ...]:
    """Test that the described arm explains the recording, and then that the arm can carry the mass."""
    if isinstance(found, SensedLoad):
        return sensed_tests(found, name)
    # The mass is tested only if the described arm explains the recording.
    if not found.explained.passed:
        return (found.explained,)
    mean, covariance = found.posterior[name]
    mass, doubt = float(mean[0]), SURELY * float(np.sqrt(covariance[0, 0]))
    payload = trace.hand.payload
    return (
        found.explained,
        FitTest(
            "a mass is not negative",
            -(mass + doubt),
            CARRIED_LEAST,
            f"The {name} weighs less than nothing: the windows of the load and of the empty hand are exchanged, or the "
            "hand is lighter than described (hand=KG or found).",
        ),
        FitTest(
            "a mass is within the payload",
            mass - doubt,
            payload * (1.0 + CLAIM_MASS),
            f"The {name} weighs more than the arm's payload of {payload:g} kg: the torques are in another unit, or the "
            "recording is of another arm (arm=NAME or a folder with its description).",
        ),
    )


def _seconds(found: CarriedLoad | SensedLoad) -> str:
    """Phrase for the durations with the load and with the empty hand."""
    hung, empty = found.seconds(True), found.seconds(False)
    return f"{hung:.1f} s of motion, against {empty:.1f} s of the empty hand"


def _halves(trace: Trace) -> list[tuple[float, float]]:
    """Start and end of both halves of each window, s; a short window stays whole."""
    found: list[tuple[float, float]] = []
    for one in _recordings(trace):
        middle = (one.start + one.end) / 2.0
        if middle - one.start >= CARRIED_HALF:
            found += [(one.start, middle), (middle, one.end)]
        else:
            found.append((one.start, one.end))
    return found


def _same_in_all_parts(trace: Trace, found: CarriedLoad | SensedLoad) -> tuple[FitTest, ...]:
    """Test that the mass is the same in all parts of the recording."""
    parts = [found.part(start, end) for start, end in _halves(trace)][1:]
    # Split the time of the empty hand as well: it must be as empty in each part as in the first.
    if found.seconds(False) > 2.0 * CARRIED_HALF:
        edges = np.quantile(found.times(False), np.linspace(0.0, 1.0, EMPTY_PARTS + 1)).tolist()
        parts += [found.part(*edge, hanging=False) for edge in pairwise(edges)][1:]
    if not parts:
        return ()
    # Test an extra mass in each part but the first.
    cause = Cause.build("mass in all parts", np.column_stack(parts), 1.0)
    finding = (
        "The mass differs between parts of the recording: the load was not carried in all of its windows, was carried "
        "outside of them, or touched something."
    )
    tolerated = max(CARRIED_APART * float(found.value[0]), CARRIED_LEAST)
    return (found.posterior.test(cause, np.full(len(parts), tolerated), finding),)


def _mass_view(trace: Trace, found: CarriedLoad | SensedLoad) -> FitView:
    """Chart the mass by parts of the windows."""
    # Split the windows into parts of at least 0.5 s, and fit an extra mass to each part alone.
    edges: list[tuple[float, float]] = []
    share = max(1, CARRIED_PARTS // len(_recordings(trace)))
    for one in _recordings(trace):
        count = int(np.clip((one.end - one.start) / 0.5, 1, share))
        stops = np.linspace(one.start, one.end, count + 1).tolist()
        edges += pairwise(stops)
    parts = np.column_stack([found.part(start, end) for start, end in edges])
    extra, note = found.posterior.each_alone(parts, 1.0), "Each part, fitted with a mass of its own"
    return mass_view(
        np.array(edges).mean(axis=1), float(found.value[0]), extra, note, "with the load"
    )
