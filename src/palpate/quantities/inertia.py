"""Rotational inertia of a held object, from swings of the hand with it and without."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.droop import EXPECTED, SPREAD, Droop
from palpate.estimation.estimate import Estimate, Part, not_identified
from palpate.estimation.holds import Held, grasped, held, pose_in_hand
from palpate.estimation.rigid import MASS, about_centre, linear, moved, of_box, pseudo_inertia
from palpate.estimation.swung import contrast, swings
from palpate.estimation.view import FitView
from palpate.geometry.inertia import components
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.edits import Slot
from palpate.mjcf.inertial.stated import com_of, inertia_for, inertia_is_open, mass_of
from palpate.mjcf.inertial.written import Statement
from palpate.mjcf.roles.elements import Elements
from palpate.mjcf.whole import whole
from palpate.parameter import Parameter
from palpate.quantities.contacts import tied_to
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Prior, Quantity, Status, Values
from palpate.trace.samples import FORCES, Trace

UNIT = "kg·m²"

BELIEVED = 0.5
"""Part of the prior that is its 1 sigma: mass may sit at the rim or in the core."""


class Inertia(Quantity):
    """Inertia about the centre of mass in body axes: xx yy zz xy xz yz."""

    id = "inertia"
    unit = UNIT
    subject = "object"
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
            FORCES,
            "MeasureForces while held still in free air",
            activity=("still",),
            holding=True,
        ),
        Evidence(
            FORCES,
            "in a Parallel with Swing while it is held there",
            activity=("swinging",),
            holding=True,
        ),
        Evidence(
            FORCES,
            "in a Parallel with Swing at the same pose with the empty hand",
            activity=("swinging",),
            empty=True,
        ),
    )
    how = f"{evidence[0].how}, and in a Parallel with Swing, held there and with the empty hand"
    derived = True
    estimators: ClassVar = {"swings": "palpate.quantities.inertia:estimate_inertia"}

    def status(self, body: BodyDescription) -> Status:
        if body.elements.inertial is None:
            return "assumed"
        return "missing" if inertia_is_open(body.elements.inertial) else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        return tuple(components(whole(body.shapes.model, body.name).tensor))

    def overruled(self, body: BodyDescription) -> str:
        return tied_to(body)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.inertial is not None:
            required = 3 if elements.inertial.get("fullinertia") is None else 0
            yield Slot(elements.inertial, "diaginertia", "0.001", required=required)
            whole = ("1", "1", "1", "0", "0", "0")
            yield Slot(elements.inertial, "fullinertia", "1", whole=whole)

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Of the object's shape, with the mass and the centre of mass that are believed."""
        mass = believed.get(Parameter(body.name, "mass"), (mass_of(body),))
        com = believed.get(Parameter(body.name, "com")) or com_of(body)
        mean = inertia_for(body, mass[0], com)
        return Prior(mean, tuple(BELIEVED * abs(part) for part in mean))

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Statement]:
        yield Statement(inertia=value, std=std)


@dataclass(frozen=True, slots=True, eq=False)
class _Swung:
    """Linear observation of an object's ten inertial parameters by a sinusoidal swing.

    Attributes:
        observed, variance: (m,) signals of the load, and their variance.
        load: (m, 10) what unit parameters in the tool's axes make of them.
        rate: rad/s.
        axis: which axis of the tool it is about.
        pose_tcp_body: of the object in the hand as it was grasped.
        droop: what has turned it since.
    """

    observed: Array
    variance: Array
    load: Array
    rate: float
    axis: int
    pose_tcp_body: Pose
    droop: Droop


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """All swings of an object, and how it was held still."""

    swings: Sequence[_Swung]
    held: Held
    gravity: float


FASTER = 1.2
"""Times the slowest rate: what a chart calls a fast swing."""

GIVE, SOFTNESS = slice(10, 13), slice(13, 15)
"""Indices of nuisance parameters behind the ten inertial ones: compliance between pads and object
about three axes, s², and rotation in the fingers (`estimation.droop`)."""


def estimate_inertia(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mass, centre of mass and inertia tensor of a physically consistent rigid body
    (`estimation.rigid`), from sinusoidal swings (`estimation.swung`) and from the static load.

    What gives way between pads and object makes it seem to resist with more the faster it swings, by
    the square of the frequency; that is fitted beside it, about each axis of the hand. Components
    that the swings say little of keep the box's with its prior spread, and the method says so.
    """
    found = None if body is None else _evidence(trace, body)
    if body is None or found is None:
        return not_identified(
            parameter,
            UNIT,
            "The recordings hold no swing of the object with one of the empty hand at the same pose, "
            "so its inertia is not excited.",
        )
    numbers, covariance, test = _fit(found, body)
    theta = numbers[:10]
    slopes = _slopes(theta)
    value, std = about_centre(theta), np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    blind = std > tuning.BLIND * _believed(slopes, covariance, body)
    mass = float(np.exp(2.0 * theta[MASS]))
    parts = {"mass": Part(mass, 2.0 * mass * float(np.sqrt(covariance[0, 0])), "kg")}
    for name, place in zip("xyz", range(7, 10), strict=True):
        deviation = float(np.sqrt(covariance[place, place]))
        parts[f"com {name}"] = Part(float(theta[place]), deviation, "m")
    return Estimate.normal(
        parameter,
        UNIT,
        value,
        std,
        _method(len(found.swings), blind.tolist()),
        tuple(hold.recording for hold in found.held.holds),
        "prior-dominated" if bool(blind[:3].all()) else "identified",
        parts,
        tests=(*found.held.load.tests, test),
        unseen=tuple(np.flatnonzero(blind).tolist()),
        views=(_view(numbers, found),),
    )


def _evidence(trace: Trace, body: Body) -> _Evidence | None:
    still = held(trace, body)
    swung = [one for one in trace.recordings if one.context.activity == "swinging"]
    if still is None or not swung:
        return None
    noise = still.weighings[0].noise
    empty = [one for r in swung if r.context.holding is None for one in swings(trace, r, noise)]
    found: list[_Swung] = []
    for recording in swung:
        if recording.context.holding == body.name:
            pose = pose_in_hand(trace, recording, body)
            for swing, observed, spread in contrast(swings(trace, recording, noise), empty):
                droop = still.droop(grasped(trace, recording, body), swing.time)
                gain = trace.hand.torque_gain / np.sqrt(3.0) * observed
                variance = spread + gain**2 + tuning.SWING_FLOOR**2
                axis = int(np.abs(swing.pose.rotation.T @ swing.axis).argmax())
                found.append(_Swung(observed, variance, swing.load, swing.rate, axis, pose, droop))
    return _Evidence(found, still, trace.gravity) if found else None


def _fit(found: _Evidence, body: Body) -> tuple[Array, Array, FitTest]:
    """Fit the ten inertial parameters in the body frame with the compliance about three axes, by
    Gauss-Newton from those of a uniform box (Nocedal and Wright, Numerical Optimization, section
    10.3). Returns all numbers (15,), the covariance of the ten, inflated where the swings disagree, and
    the test of that."""
    from scipy.optimize import least_squares  # takes longer to load than most plans to make

    mass = found.held.load.force / found.gravity
    box = of_box(max(mass, 1e-3), body.centre, body.size)
    start = np.concatenate([box, np.zeros(3), EXPECTED])
    spread = _spread(body)

    def misfit(numbers: Array) -> Array:
        swung = _swung(numbers, found)
        return np.concatenate([*swung, _hanging(numbers, found), (numbers - start) / spread])

    solved: Any = least_squares(misfit, start, x_scale=spread)
    numbers, slopes = np.asarray(solved.x, float), np.asarray(solved.jac, float)
    left = np.concatenate(_swung(numbers, found))
    covariance = np.linalg.inv(slopes.T @ slopes)
    misfit_squared, freedom = float(left @ left), _freedom(slopes[: len(left)], covariance)
    # What joints feel beside one rigid body counts as noise (Birge ratio).
    covariance = covariance * max(1.0, misfit_squared / freedom)
    test = chi_squared(
        "swings agree",
        misfit_squared,
        round(freedom),
        "The swings do not fit one rigid body: something in the object moves, or it moves in the "
        "fingers.",
        found.held.load.freedom,
    )
    return numbers, covariance[:10, :10].astype(np.float64), test


def _freedom(slopes: Array, covariance: Array) -> float:
    """Effective degrees of freedom of residuals with Jacobian `slopes` (n, k): n less the leverage
    tr(J P Jᵀ), which counts a parameter as far as the data determine it and not the prior (Hastie,
    Tibshirani and Friedman, The Elements of Statistical Learning, section 7.6)."""
    leverage = float(np.einsum("ij,jk,ik->", slopes, covariance, slopes))
    return max(1.0, len(slopes) - leverage)


def _spread(body: Body) -> Array:
    """(15,) 1 sigma of what is believed of the numbers before they are measured."""
    radii = body.size / np.sqrt(12.0)
    skew = tuning.SKEW_PRIOR * radii[[0, 0, 1]]
    centre = tuning.COM_PRIOR * np.maximum(body.size, 1e-3)
    mass, radius = [tuning.LOG_MASS_PRIOR], [tuning.RADIUS_PRIOR] * 3
    return np.concatenate([mass, radius, skew, centre, [tuning.GIVE_PRIOR] * 3, SPREAD])


def _believed(slopes: Array, covariance: Array, body: Body) -> Array:
    """(6,) 1 sigma of the inertia by its `slopes` (6, 10), of a body that was weighed but not swung: a mass
    of which nothing is believed must not pass for an inertia of which nothing is."""
    spread = _spread(body)[:10]
    spread[MASS] = np.sqrt(covariance[MASS, MASS])
    return np.sqrt(np.sum((slopes * spread) ** 2, axis=1))


def _swung(numbers: Array, found: _Evidence) -> list[Array]:
    """Residuals of each swing, in standard deviations."""
    pairs = zip(found.swings, _made(numbers, found), strict=True)
    return [(one.observed - made) / np.sqrt(one.variance) for one, made in pairs]


def _made(numbers: Array, found: _Evidence) -> Iterator[Array]:
    """Predicted signals (m,) of each swing, N m."""
    pseudo = pseudo_inertia(numbers[:10])
    for one in found.swings:
        pose = one.droop.turned(one.pose_tcp_body, numbers[SOFTNESS])
        gives = 1.0 + numbers[GIVE][one.axis] * one.rate**2
        yield gives * one.load @ linear(moved(pseudo, pose))


def _view(numbers: Array, found: _Evidence) -> FitView:
    """Torques of the load in each joint, swing by swing, against the rigid body's."""
    rates = np.repeat([one.rate for one in found.swings], len(found.swings[0].observed))
    hertz = " and ".join(f"{rate:.1f}" for rate in sorted(set((rates / (2.0 * np.pi)).round(1))))
    made = np.concatenate(list(_made(numbers, found)))
    return FitView(
        name="Torques of the load in the joints as the hand swings.",
        note=f"{len(found.swings)} swings at {hertz} Hz, less the same swings of the empty hand, each joint by "
        "itself, against those of the fitted rigid body.",
        axes=("by the rigid body (mN·m)", "measured (mN·m)"),
        x=1e3 * made,
        measured=1e3 * np.concatenate([one.observed for one in found.swings]),
        predicted=1e3 * made,
        std=1e3 * np.sqrt(np.concatenate([one.variance for one in found.swings])),
        groups=["fast swings" if rate > FASTER * rates.min() else "slow swings" for rate in rates],
    )


def _hanging(numbers: Array, found: _Evidence) -> Array:
    """Residuals of the static load, in standard deviations."""
    pseudo, load = pseudo_inertia(numbers[:10]), found.held.load
    made = [float(pseudo[3, 3]) * found.gravity]
    for hold in found.held.holds:
        pose = hold.droop.turned(hold.pose_tcp_body, numbers[SOFTNESS])
        tool = linear(moved(pseudo, pose))
        x, y, _ = hold.pose_world_tcp.rotation @ tool[1:4] * found.gravity
        made += [y, -x]
    root = np.linalg.cholesky(load.covariance)
    left: Array = np.linalg.solve(root, load.value - np.array(made)).astype(np.float64)
    return left


def _slopes(theta: Array) -> Array:
    """(6, 10) of the inertia about the centre of mass, by the ten numbers."""
    step = 1e-6
    columns: list[Array] = []
    for one in step * np.eye(10):
        columns.append((about_centre(theta + one) - about_centre(theta - one)) / (2.0 * step))
    return np.stack(columns, axis=1)


def _method(swings: int, blind: Sequence[bool]) -> str:
    method = (
        f"What the object resists {swings} swings about three axes of the hand with, against the same "
        "swings of the empty hand, and how it hangs, fitted together by a rigid body that there can be"
    )
    names = ("xx", "yy", "zz", "xy", "xz", "yz")
    weak = [name for name, unseen in zip(names, blind, strict=True) if unseen]
    if weak:
        method += f"; of {', '.join(weak)} they say little: the box's, prior-dominated"
    return method + "."
