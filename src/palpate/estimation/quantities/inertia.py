"""Rotational inertia of a held object, from swings of the hand with and without it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose, components
from palpate.estimation.balance import COM_PRIOR
from palpate.estimation.estimate import (
    Estimate,
    FitTest,
    FitView,
    FurtherValue,
    chi_squared,
    not_identified,
)
from palpate.estimation.grip import EXPECTED, SPREAD, Droop
from palpate.estimation.holds import ObjectHolds, find_holds, grasp_time, pose_in_hand
from palpate.estimation.quantities.com import BLIND
from palpate.estimation.quantities.quantity import (
    Evidence,
    Prior,
    Quantity,
    Status,
    Values,
    held_and_empty,
)
from palpate.estimation.rigid_bodies import (
    MASS,
    about_centre,
    jacobian,
    linear,
    move_inertia,
    of_box,
    pseudo_inertia,
)
from palpate.estimation.swings import contrast, swings
from palpate.estimation.wrench_observation import force_gain
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.contacts import find_constraint
from palpate.mjcf.edits import Slot
from palpate.mjcf.elements import Elements
from palpate.mjcf.inertial import (
    Statement,
    com_of,
    inertia_for,
    inertia_is_open,
    mass_of,
    total_inertia,
)
from palpate.trace.samples import FORCES, Trace

SWING_FLOOR = 3e-4
"""N m. Smallest noise of a swing, by the play of pads and joints. Sensitive: inertia std ×0.9–1.1."""
LOG_MASS_PRIOR = 3.0
"""1 sigma of half the logarithm of a mass: an uninformative prior. Sensitive: no."""
RADIUS_PRIOR = 0.35
"""1 sigma of the logarithm of a radius of gyration. Mass in the core has half the box's radius, mass at the rim nearly
twice; an inertia is its square. Sensitive: weak axes' std ×0.5–2.0."""
SKEW_PRIOR = 0.3
"""Fraction (1 sigma) of a radius of gyration by which the mass lies askew to the body's axes. Sensitive: no."""
GIVE_PRIOR = 4e-4
"""s² (1 sigma). Relative growth of the apparent inertia by the compliance of the pads, per squared rate: its resonance
is at 8 Hz or more. Sensitive: inertia std ×0.8–1.2."""

UNIT = "kg·m²"
BELIEVED = 0.5
"""1 sigma of the prior relative to its mean: mass may be at the rim or in the core."""


class Inertia(Quantity):
    """Inertia about the centre of mass in body axes: xx yy zz xy xz yz."""

    id = "inertia"
    unit = UNIT
    subject = "object"
    bounds = ((0.0, np.inf),) * 3 + ((-np.inf, np.inf),) * 3
    label = "inertia tensor"
    words: ClassVar = {
        "en": ("inertia", "moment of inertia", "moments of inertia", "inertia tensor"),
        "de": ("trägheit", "trägheitsmoment", "trägheitsmomente", "trägheitstensor"),
        "es": ("inercia", "momento de inercia", "momentos de inercia"),
        "fr": ("inertie", "moment d inertie", "moments d inertie"),
        "it": ("inerzia", "momento di inerzia", "momento d inerzia", "momenti di inerzia"),
    }
    size = 6
    evidence = (
        Evidence(
            FORCES, "MeasureForces while held still in free air", activity=("still",), holding=True
        ),
        *held_and_empty(FORCES, "Swing", "swinging", "there"),
    )
    how = f"{evidence[0].how}, and in a Parallel with Swing, held and empty"
    derived = True
    estimators: ClassVar = {
        "swings": "palpate.estimation.quantities.inertia:estimate_inertia",
        "recording": "palpate.estimation.carried:estimate_inertia",
    }

    def status(self, body: BodyDescription) -> Status:
        if body.elements.inertial is None:
            return "assumed"
        return "missing" if inertia_is_open(body.elements.inertial) else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        return tuple(components(total_inertia(body.shapes.model, body.name).tensor))

    def overruled(self, body: BodyDescription) -> str:
        return find_constraint(body)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.inertial is not None:
            required = 3 if elements.inertial.get("fullinertia") is None else 0
            yield Slot(elements.inertial, "diaginertia", "0.001", required=required)
            identity = ("1", "1", "1", "0", "0", "0")
            yield Slot(elements.inertial, "fullinertia", "1", whole=identity)

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior from the object's shape with the believed mass and centre of mass."""
        mass = believed.get(Parameter(body.name, "mass"), (mass_of(body),))
        com = believed.get(Parameter(body.name, "com")) or com_of(body)
        mean = inertia_for(body, mass[0], com)
        return Prior(mean, tuple(BELIEVED * abs(part) for part in mean))

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Statement]:
        yield Statement(inertia=value, std=std)


@dataclass(frozen=True, slots=True, eq=False)
class SwungObject:
    """Linear observation of an object's ten inertial parameters by a sinusoidal swing."""

    observed: Array  # (m,) signals of the load
    variance: Array  # (m,) of `observed`
    # (m, k) effect of one deviation of each unknown of a joint's gear, common to all swings.
    gears: Array
    load: Array  # (m, 10) signals of unit parameters in tool axes
    rate: float  # angular frequency, rad/s
    axis: int  # index of the tool axis of the swing
    pose_tcp_body: Pose  # pose of the object in the hand at the grasp
    droop: Droop  # rotation in the fingers since the grasp

    @property
    def std(self) -> Array:
        """(m,) standard deviations of the signals, including those of the gears."""
        return np.sqrt(self.variance + (self.gears**2).sum(axis=1))


# Parameters of the fit: ten inertial ones, compliance between pads and object about three axes, s², and rotation in
# the fingers (`grip`)
INERTIAL, GIVE, SOFTNESS = slice(0, 10), slice(10, 13), slice(13, 15)
FASTER = 1.2
"""Smallest ratio to the slowest swing rate that a chart calls fast."""


def estimate_inertia(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Inertia tensor of a physically consistent rigid body, from sinusoidal swings and the static load.

    Mass and centre of mass are fitted as well (`rigid_bodies`, `swings`). Compliance between pads and object increases
    the apparent inertia by the square of the frequency; it is an unknown about each axis of the hand. Components that
    the swings hardly excite keep those of the box with their prior standard deviation, and the method says so.
    """
    still = None if body is None else find_holds(trace, body)
    if body is None or still is None or not (swung := observed_swings(trace, still, body)):
        return not_identified(
            parameter,
            UNIT,
            "The recordings hold no swing of the object with one of the empty hand at the same pose, "
            "so its inertia is not excited.",
        )
    numbers, covariance, test = fit_rigid_body(swung, still, trace.gravity, body)
    theta = numbers[INERTIAL]
    # Covariance of the inertia about the centre of mass.
    slopes = jacobian(about_centre, theta)
    value, std = about_centre(theta), np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    # Compare with the prior of an object that was weighed but not swung: mass errors alone are no lack of excitation.
    believed = prior_std(body)[INERTIAL]
    believed[MASS] = np.sqrt(covariance[MASS, MASS])
    blind = std > BLIND * np.sqrt(np.sum((slopes * believed) ** 2, axis=1))
    # Mass and centre of mass of the same fit are further results.
    mass = float(np.exp(2.0 * theta[MASS]))
    parts = {"mass": FurtherValue(mass, 2.0 * mass * float(np.sqrt(covariance[0, 0])), "kg")}
    for name, place in zip("xyz", range(7, 10), strict=True):
        deviation = float(np.sqrt(covariance[place, place]))
        parts[f"com {name}"] = FurtherValue(float(theta[place]), deviation, "m")
    return Estimate.normal(
        parameter,
        UNIT,
        value,
        std,
        method=swing_method(len(swung), blind.tolist()),
        evidence=tuple(hold.recording for hold in still.holds),
        verdict="prior-dominated" if bool(blind[:3].all()) else "identified",
        parts=parts,
        tests=(*still.load.tests, test),
        unseen=tuple(np.flatnonzero(blind).tolist()),
        views=(swing_view(numbers, swung),),
    )


def observed_swings(trace: Trace, still: ObjectHolds, body: Body) -> list[SwungObject]:
    """Swings of the object, each in contrast to one of the empty hand."""
    recordings = [r for r in trace.recordings if r.context.activity == "swinging"]
    noise = still.weighings[0].noise
    # Swings of the empty hand are the reference of all loaded ones.
    unloaded = [recording for recording in recordings if recording.context.holding is None]
    empty = [swing for recording in unloaded for swing in swings(trace, recording, noise)]
    found: list[SwungObject] = []
    for recording in recordings:
        if recording.context.holding != body.name:
            continue
        pose = pose_in_hand(trace, recording, body)
        for swing, observed, spread, gears in contrast(swings(trace, recording, noise), empty):
            # Variance with the gain error, and the tool axis of the rotation.
            droop = still.droop(grasp_time(trace, recording, body), swing.time)
            # The gain is the half width of a uniform distribution, so its std is divided by sqrt(3).
            gain = force_gain(trace.hand) / np.sqrt(3.0) * observed
            variance = spread + gain**2 + SWING_FLOOR**2
            axis = int(np.abs(swing.pose.rotation.T @ swing.axis).argmax())
            found.append(
                SwungObject(observed, variance, gears, swing.load, swing.rate, axis, pose, droop)
            )
    return found


def fit_rigid_body(
    swung: Sequence[SwungObject], still: ObjectHolds, gravity: float, body: Body
) -> tuple[Array, Array, FitTest]:
    """Fit the ten inertial parameters in the body frame, with compliances about three axes and the grip's softness.

    Gauss-Newton starts from a uniform box (Nocedal and Wright, Numerical Optimization, section 10.3). Returns all
    parameters (15,), the covariance of the inertial ones, inflated where the swings disagree, and the test of their
    agreement.
    """
    from scipy.optimize import least_squares  # takes longer to import than most plans to compute

    # Start at a uniform box of the measured mass.
    mass = still.load.force / gravity
    box = of_box(max(mass, 1e-3), body.centre, body.size)
    start = np.concatenate([box, np.zeros(3), EXPECTED])
    spread, roots = prior_std(body), swing_roots(swung)

    def residuals(numbers: Array) -> Array:
        swings = swing_residuals(numbers, swung, roots)
        load = load_residuals(numbers, still, gravity)
        return np.concatenate([swings, load, (numbers - start) / spread])

    solved: Any = least_squares(residuals, start, x_scale=spread)
    numbers, slopes = np.asarray(solved.x, float), np.asarray(solved.jac, float)
    left = swing_residuals(numbers, swung, roots)
    covariance = np.linalg.inv(slopes.T @ slopes)
    # Effective degrees of freedom: number of residuals minus their leverage tr(J P Jᵀ). A parameter counts as far as
    # the data determine it and not the prior (Hastie, Tibshirani and Friedman, The Elements of Statistical Learning,
    # section 7.6).
    rows = slopes[: len(left)]
    leverage = float(np.einsum("ij,jk,ik->", rows, covariance, rows))
    misfit, freedom = float(left @ left), max(1.0, len(left) - leverage)
    # Deviations from a rigid body count as noise (Birge ratio).
    covariance = covariance * max(1.0, misfit / freedom)
    test = chi_squared(
        "swings agree",
        misfit,
        round(freedom),
        "The swings do not fit one rigid body: something in the object moves, or it moves in the "
        "fingers.",
        still.load.freedom,
    )
    return numbers, covariance[INERTIAL, INERTIAL].astype(np.float64), test


def prior_std(body: Body) -> Array:
    """1 sigma (15,) of the prior of the fit's parameters."""
    radii = body.size / np.sqrt(12.0)
    skew = SKEW_PRIOR * radii[[0, 0, 1]]
    centre = COM_PRIOR * np.maximum(body.size, 1e-3)
    mass, radius = [LOG_MASS_PRIOR], [RADIUS_PRIOR] * 3
    return np.concatenate([mass, radius, skew, centre, [GIVE_PRIOR] * 3, SPREAD])


def predicted_swings(numbers: Array, swung: Sequence[SwungObject]) -> Iterator[Array]:
    """Yield the predicted signals (m,) of each swing, N m."""
    pseudo = pseudo_inertia(numbers[INERTIAL])
    for one in swung:
        pose = one.droop.turned(one.pose_tcp_body, numbers[SOFTNESS])
        # Driven oscillator far below its resonance: the amplitude grows by 1 + c ω².
        gives = 1.0 + numbers[GIVE][one.axis] * one.rate**2
        yield gives * one.load @ linear(move_inertia(pseudo, pose))


def swing_roots(swung: Sequence[SwungObject]) -> Array:
    """Cholesky factors (m, s, s) of the covariances of each signal over s swings, which share gear unknowns."""
    gears = np.array([one.gears for one in swung])
    own = np.array([one.variance for one in swung]).T[:, None, :] * np.eye(len(swung))
    shared: Array = np.einsum("ajk,bjk->jab", gears, gears)
    roots: Array = np.linalg.cholesky(own + shared).astype(np.float64)
    return roots


def swing_residuals(numbers: Array, swung: Sequence[SwungObject], roots: Array) -> Array:
    """Residuals of all swings in standard deviations."""
    pairs = zip(swung, predicted_swings(numbers, swung), strict=True)
    left = np.array([one.observed - made for one, made in pairs])
    return np.linalg.solve(roots, left.T[:, :, None]).ravel().astype(np.float64)


def swing_view(numbers: Array, swung: Sequence[SwungObject]) -> FitView:
    """Chart of the load's torques in each joint, swing by swing, against those of the rigid body."""
    # Predicted against measured torques, grouped by rate.
    rates = np.repeat([one.rate for one in swung], len(swung[0].observed))
    hertz = " and ".join(f"{rate:.1f}" for rate in sorted(set((rates / (2.0 * np.pi)).round(1))))
    predicted = 1e3 * np.concatenate(list(predicted_swings(numbers, swung)))
    return FitView(
        name="Torques of the load in the joints as the hand swings.",
        note=f"{len(swung)} swings at {hertz} Hz, less the same swings of the empty hand, each joint by "
        "itself, against those of the fitted rigid body.",
        axes=("by the rigid body (mN·m)", "measured (mN·m)"),
        x=predicted,
        measured=1e3 * np.concatenate([one.observed for one in swung]),
        predicted=predicted,
        std=1e3 * np.concatenate([one.std for one in swung]),
        groups=["fast swings" if rate > FASTER * rates.min() else "slow swings" for rate in rates],
    )


def load_residuals(numbers: Array, still: ObjectHolds, gravity: float) -> Array:
    """Residuals of the static load in standard deviations."""
    pseudo, load = pseudo_inertia(numbers[INERTIAL]), still.load
    predicted = [float(pseudo[3, 3]) * gravity]
    for hold in still.holds:
        pose = hold.droop.turned(hold.pose_tcp_body, numbers[SOFTNESS])
        tool = linear(move_inertia(pseudo, pose))
        # Moment of the weight about the TCP: (y, -x) of the first moment times g.
        x, y, _ = hold.pose_world_tcp.rotation @ tool[1:4] * gravity
        predicted += [y, -x]
    root = np.linalg.cholesky(load.covariance)
    left: Array = np.linalg.solve(root, load.value - np.array(predicted)).astype(np.float64)
    return left


def swing_method(swings: int, blind: Sequence[bool]) -> str:
    """Describe the swings, and the components without evidence."""
    method = (
        f"Resistance of the object to {swings} swings about three axes of the hand, against the same swings of "
        "the empty hand, and its static load, fitted by one physically possible rigid body"
    )
    names = ("xx", "yy", "zz", "xy", "xz", "yz")
    weak = [name for name, unseen in zip(names, blind, strict=True) if unseen]
    if weak:
        method += (
            f"; hardly excited and kept at the box's value: {', '.join(weak)} (prior-dominated)"
        )
    return method + "."
