"""Mass, centre of mass and inertia of a load that was carried through a recording of free motion, in the object's
axes where its pose in the hand is known, else in those of the tool, from the TCP."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.carried.fit import HAND, LOAD, Carried, carried
from palpate.estimation.estimate import UNSEEN, Z95, Estimate, Part, Shared, not_identified
from palpate.estimation.regression import Cause
from palpate.estimation.rigid import linear, of_box, pseudo_inertia
from palpate.estimation.view import FitView, constant, unit_slopes
from palpate.geometry.pose import Array, Pose, components, tensor_of
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace

EMPTY_PARTS = 6
"""Parts of the empty hand's time that are compared."""
PARTS = 24
"""Parts of a recording in a chart, at most."""
ALONE = (
    "the recording holds no motion of the empty hand, so that errors of the arm's model count as load: give one "
    "(empty=LOG)"
)


def estimate_mass(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mass of the load, or of the hand itself, by its weight and its resistance to acceleration."""
    found = _carried(trace)
    if found is None:
        return _nothing(parameter, "kg", trace)
    name = HAND if parameter.object == HAND else LOAD
    mean, covariance = found.posterior[name]
    mass, std = float(mean[0]), float(np.sqrt(covariance[0, 0]))
    what = "hand with what is mounted on it" if name == HAND else "load"
    method = (
        f"Weight of the {what} and its resistance to acceleration in {_seconds(found)}, fitted together with friction, "
        "zeros and gains of the joints and errors of the arm's model; the noise is what the recording itself leaves."
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
        shared=_shared(found, np.eye(10)[:1], name),
        views=(_mass_view(trace, found),) if name == LOAD else (),
    )


def estimate_com(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Centre of mass of the load: its first moment over its mass."""
    found = _carried(trace)
    if found is None or not _is_felt(trace, found):
        return _nothing(parameter, "m", trace)
    to_body = _in_hand(trace).inverse()

    def centre(value: Array) -> Array:
        return to_body.apply(value[1:4] / value[0])

    slopes = _slopes(centre, found.value)
    stds = np.sqrt(np.diag(slopes @ found.covariance @ slopes.T))
    unseen = tuple(np.flatnonzero(stds > tuning.COM_BELIEVED).tolist())
    made = Estimate.normal(
        parameter,
        "m",
        centre(found.value),
        stds,
        f"First moment of the load over its mass, in {_axes(trace)}.",
        _recordings(trace),
        parts={"mass": Part(float(found.value[0]), float(np.sqrt(found.covariance[0, 0])), "kg")},
        reason=UNSEEN if len(unseen) == 3 else "" if found.compared else ALONE,
        unseen=unseen,
        tests=_same_in_all_parts(trace, found),
    )
    return replace(made, shared=_shared(found, slopes))


def estimate_inertia(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Inertia of the load about its centre of mass: that of the physically consistent body nearest to the fit."""
    found = _carried(trace)
    if found is None or not _is_felt(trace, found):
        return _nothing(parameter, "kg·m²", trace)
    pose, theta, statistic = _in_hand(trace), *consistent(found.value, found.covariance)

    def central(value: Array) -> Array:
        c = value[1:4] / value[0]
        steiner = value[0] * (float(c @ c) * np.eye(3) - np.outer(c, c))
        tensor = tensor_of(value[4:].tolist()) - steiner
        return np.array(components(pose.rotation.T @ tensor @ pose.rotation))

    slopes = _slopes(central, found.value)
    stds = np.sqrt(np.diag(slopes @ found.covariance @ slopes.T))
    pseudo = pseudo_inertia(theta)
    # The nearest body may be a sheet or a rod without thickness, which MuJoCo takes for none.
    pseudo[:3, :3] += pseudo[3, 3] * tuning.THINNEST**2 * np.eye(3)
    value = central(linear(pseudo))
    # Moments are seen where they stand out of their errors, products where these are small beside the moments; both
    # where a load with the largest radius of gyration that is believed would. A product without moments says nothing.
    believed = float(found.value[0]) * tuning.RADIUS_BELIEVED**2
    sizes = np.minimum([*value[:3], *[value[:3].mean()] * 3], believed)
    hardly = stds > 0.5 * sizes
    unseen = tuple(np.flatnonzero(hardly | hardly[:3].all()).tolist())
    names = ("xx", "yy", "zz", "xy", "xz", "yz")
    weak = ", ".join(names[i] for i in unseen)
    excited = f" Hardly excited: {weak}; turn the hand faster about more axes." if weak else ""
    test = chi_squared(
        "physical consistency",
        statistic,
        10,
        "No rigid body has the inertia that was fitted: the load moves in the hand, or is no rigid body.",
    )
    made = Estimate.normal(
        parameter,
        "kg·m²",
        value,
        stds,
        f"Resistance of the load to being turned, about its centre of mass, in {_axes(trace)}; of the physically "
        f"consistent body nearest to the fit (Wensing, Kim and Slotine, RA-L 2018).{excited}",
        _recordings(trace),
        reason=UNSEEN if len(unseen) == 6 else "" if found.compared else ALONE,
        unseen=unseen,
        tests=(test, *_same_in_all_parts(trace, found)),
    )
    return replace(made, shared=_shared(found, slopes))


def consistent(value: Array, covariance: Array) -> tuple[Array, float]:
    """Log-Cholesky numbers (10,) of the rigid body nearest to ten fitted parameters, and its squared distance in
    standard deviations (P. Wensing, S. Kim and J.-J. Slotine, Linear matrix inequalities for physically consistent
    inertial parameter identification, IEEE RA-L 3, 2018)."""
    from scipy.optimize import least_squares  # takes longer to import than most plans to make

    root = np.linalg.cholesky(covariance)

    def residuals(theta: Array) -> Array:
        left: Array = np.linalg.solve(root, linear(pseudo_inertia(theta)) - value).astype(float)
        return left

    mass = max(float(value[0]), 1e-3)
    start = of_box(mass, value[1:4] / mass, np.full(3, 2.0 * tuning.RADIUS_BELIEVED))
    solved: Any = least_squares(residuals, start)
    return np.asarray(solved.x, float), float(2.0 * solved.cost)


def _carried(trace: Trace) -> Carried | None:
    names = [one.context.holding for one in trace.recordings if one.context.holding]
    return carried(trace, names[0]) if names else None


def _recordings(trace: Trace) -> tuple[Recording, ...]:
    return tuple(one for one in trace.recordings if one.context.holding)


def _in_hand(trace: Trace) -> Pose:
    """Pose of the object in the hand, which the grasp of a recording states; identity where it does not."""
    stated = _recordings(trace)[0].context.grasp
    numbers = [float(word) for word in stated.split()] if stated else [0.0] * 3
    return Pose.of(numbers[:3], numbers[3:] or (1.0, 0.0, 0.0, 0.0))


def _axes(trace: Trace) -> str:
    stated = _recordings(trace)[0].context.grasp
    return "the object's frame" if stated else "the axes of the tool, from the TCP"


def _is_felt(trace: Trace, found: Carried) -> bool:
    """There is a load that a quotient by its mass says something of."""
    mass, std = float(found.value[0]), float(np.sqrt(found.covariance[0, 0]))
    return mass > Z95 * std and all(test.passed for test in _sound(trace, found, LOAD))


def _nothing(parameter: Parameter, unit: str, trace: Trace) -> Estimate:
    found = _carried(trace)
    if found is not None and not all(test.passed for test in _sound(trace, found, LOAD)):
        return not_identified(parameter, unit, "The mass is contradicted: see there.")
    return not_identified(
        parameter, unit, "No load was felt in the windows in which one was said to be carried."
    )


def _sound(trace: Trace, found: Carried, name: str) -> tuple[FitTest, ...]:
    """Tests that the described arm explains the recording; and if it does, that a mass is one that it can carry."""
    if not found.explained.passed:
        return (found.explained,)
    mean, covariance = found.posterior[name]
    mass, doubt = float(mean[0]), tuning.SURELY * float(np.sqrt(covariance[0, 0]))
    payload = trace.hand.payload
    return (
        found.explained,
        FitTest(
            "a mass is not negative",
            -(mass + doubt),
            tuning.CARRIED_LEAST,
            f"The {name} weighs less than nothing: the windows of the load and of the empty hand are exchanged, or the "
            "hand is lighter than described (hand=KG or found).",
        ),
        FitTest(
            "a mass is within the payload",
            mass - doubt,
            payload * (1.0 + tuning.CLAIM_MASS),
            f"The {name} weighs more than the arm's payload of {payload:g} kg: the torques are in another unit, or the "
            "recording is of another arm (arm=NAME or a folder with its description).",
        ),
    )


def _slopes(of: Callable[[Array], Array], value: Array) -> Array:
    """(k, 10) Jacobian of a function of the parameters, by central differences."""
    steps = 1e-6 * np.eye(len(value))
    return np.column_stack([(of(value + step) - of(value - step)) / 2e-6 for step in steps])


def _shared(found: Carried, slopes: Array, name: str = LOAD) -> tuple[Shared, ...]:
    """Errors in common with other runs of the arm."""
    each = found.posterior.shared(name)
    return tuple(replace(one, effect=tuple(slopes @ np.array(one.effect))) for one in each)


def _seconds(found: Carried) -> str:
    hung, empty = found.seconds(True), found.seconds(False)
    return f"{hung:.1f} s of motion, against {empty:.1f} s of the empty hand"


def _halves(trace: Trace) -> list[tuple[float, float]]:
    """Start and end of both halves of each window."""
    found: list[tuple[float, float]] = []
    for one in _recordings(trace):
        middle = (one.start + one.end) / 2.0
        if middle - one.start >= tuning.CARRIED_HALF:
            found += [(one.start, middle), (middle, one.end)]
        else:
            found.append((one.start, one.end))
    return found


def _same_in_all_parts(trace: Trace, found: Carried) -> tuple[FitTest, ...]:
    """Test for other masses in parts of the recording."""
    parts = [found.part(start, end) for start, end in _halves(trace)][1:]
    # The empty hand, too, is as empty in all parts as in its first.
    if found.seconds(False) > 2.0 * tuning.CARRIED_HALF:
        pairs = zip(found.motions, found.hanging, strict=True)
        empty = np.concatenate([motion.t for motion, hung in pairs if not hung])
        edges = np.quantile(empty, np.linspace(0.0, 1.0, EMPTY_PARTS + 1)).tolist()
        parts += [found.part(*edge, hanging=False) for edge in pairwise(edges)][1:]
    if not parts:
        return ()
    cause = Cause("mass in all parts", np.column_stack(parts), np.full(len(parts), 1.0))
    finding = (
        "The mass differs between parts of the recording: the load was not carried in all of its windows, was carried "
        "outside of them, or touched something."
    )
    tolerated = max(tuning.CARRIED_APART * float(found.value[0]), tuning.CARRIED_LEAST)
    return (found.posterior.test(cause, np.full(len(parts), tolerated), finding),)


def _mass_view(trace: Trace, found: Carried) -> FitView:
    """Mass by parts of the windows."""
    edges: list[tuple[float, float]] = []
    share = max(1, PARTS // len(_recordings(trace)))
    for one in _recordings(trace):
        count = int(np.clip((one.end - one.start) / 0.5, 1, share))
        stops = np.linspace(one.start, one.end, count + 1).tolist()
        edges += pairwise(stops)
    parts = np.column_stack([found.part(start, end) for start, end in edges])
    mean, variance = found.posterior.each_alone(parts, 1.0)
    x, mass = np.array(edges).mean(axis=1), float(found.value[0])
    return FitView(
        name="Mass by part of the recording.",
        note="Each part of the windows, fitted with a mass of its own, ± 1 std with all error causes.",
        axes=("time in the recording (s)", "mass (kg)"),
        x=x,
        measured=mass + mean,
        predicted=constant(mass, x),
        std=np.sqrt(variance),
        slopes=unit_slopes(x),
    )
