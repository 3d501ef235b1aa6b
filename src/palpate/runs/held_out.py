"""Validation of estimates on motions that were held out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.common.processes import shared_out
from palpate.estimation.estimate import Estimate, FitTest, chi_squared
from palpate.estimation.evidence import remove_spoiled, select_evidence
from palpate.estimation.load_noise import load_rows
from palpate.estimation.quantities.catalogue import catalogue
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.segments import weighing
from palpate.runs.prediction import (
    PredictedSignal,
    known_value,
    lever_of,
    mass_part,
    predict_segments,
    wrench_of,
)
from palpate.scene.scene import Scene
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace
from palpate.twin.inject import stated_parameter

WEIGHT = "held-out weight"
BALANCE = "held-out balance"
TORQUES = "held-out torques"
# Quantity that each test judges. The test of the remaining torques judges none.
JUDGED = {WEIGHT: "mass", BALANCE: "com"}


@dataclass(frozen=True, slots=True)
class Curve:
    """Effect of the load on the signals of a motion, bin by bin, for the plot, N m (N of a force)."""

    signals: tuple[str, ...]  # (m,) names
    t: tuple[float, ...]  # (k,) s, the middle of each bin
    measured: tuple[tuple[float, ...], ...]  # (m, k)
    std: tuple[tuple[float, ...], ...]  # (m, k) of the measured ones
    twin: tuple[tuple[float, ...], ...]  # (m, k) as predicted from the estimates
    template: tuple[tuple[float, ...], ...]  # (m, k) as predicted from the priors


@dataclass(frozen=True, slots=True)
class HeldOutMotion:
    """A held-out motion with its prediction."""

    object: str  # in the hand
    motion: str  # description
    # start, end: s.
    start: float
    end: float
    # chi2, dof, p: of the joint torques, over all joints and bins.
    chi2: float
    dof: int
    p: float
    chi2_template: float  # the same for the mass of the prior
    # rms, rms_template: root mean square of measured less predicted torques, N m.
    rms: float
    rms_template: float
    # weight, weight_std: kg, measured less predicted mass, and its standard deviation.
    weight: float
    weight_std: float
    tests: tuple[FitTest, ...]  # of weight, balance and torques
    curve: Curve  # for the plot

    @property
    def agrees(self) -> bool:
        """True if weight and balance agree with the prediction. Remaining torques may come from the arm itself."""
        return all(test.passed for test in self.tests if test.name in JUDGED)

    @property
    def is_better(self) -> bool:
        """True if the twin predicts the motion better than the scene as given."""
        return self.chi2 < self.chi2_template

    @property
    def disagreement(self) -> str:
        """Deviation from the prediction, in words, with the residual torque."""
        return " ".join(test.finding for test in self.tests if not test.passed)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Held-out motions, one for each object. `notes` are the reasons why an object has none."""

    motions: tuple[HeldOutMotion, ...]
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """True if all motions agree with their predictions."""
        return all(motion.agrees for motion in self.motions)


# Cross-validation: hold out one motion of each object, estimate without it, and predict it.

FITTED = ("mass", "com", "inertia")  # Quantities on which the wrench of a held object depends
# Activities of recordings from which these quantities are estimated.
IN_THE_AIR = ("still", "swinging")


@dataclass(frozen=True, slots=True)
class HoldOut:
    """A held-out interval."""

    words: str  # description
    # start, end: s.
    start: float
    end: float
    recording: Recording  # along its path the object moves in the interval


def held_out(
    scene: Scene,
    trace: Trace,
    estimates: Sequence[Estimate],
    choice: Mapping[str, str] | None = None,
    early: Mapping[str, HeldOutMotion | str | None] | None = None,
) -> HeldOut | None:
    """Judge the estimates of every lifted object; None without any.

    `choice` has estimators by quantity, where `estimates` were not made by the default ones, and `early` objects
    judged before.
    """
    # Find the objects that were lifted; those judged before are not judged again.
    evidence = remove_spoiled(trace)
    motions: list[HeldOutMotion] = []
    notes: list[str] = []
    lifted = (recording.context.holding for recording in still_recordings(evidence))
    names = list(dict.fromkeys(name for name in lifted if name is not None))  # each once, in order
    known = early or {}
    due = [name for name in names if known.get(name) is None]
    every = shared_out(
        lambda name: judge(scene, select_evidence(evidence, name), estimates, name, choice), due
    )
    # Collect motions and notes in the order of lifting.
    judgements = {**known, **dict(zip(due, every, strict=True))}
    for name in names:
        judged = judgements[name]
        if isinstance(judged, str):
            notes.append(f"{name}: {judged}")
        elif judged is not None:
            motions.append(judged)
    if not motions and not notes:
        return None
    return HeldOut(tuple(motions), tuple(notes))


def with_tests(estimates: Sequence[Estimate], held_out: HeldOut) -> tuple[Estimate, ...]:
    """Add the tests on the held-out motions to the estimates.

    A mass is contradicted if it does not predict the weight in another motion. A centre of mass is
    contradicted if it does not predict the balance.
    """
    # Find the test of each parameter.
    tests: dict[Parameter, FitTest] = {}
    for motion in held_out.motions:
        for test in motion.tests:
            if test.name in JUDGED:
                tests[Parameter(motion.object, JUDGED[test.name])] = test
    # Only identified values can be contradicted.
    tested: list[Estimate] = []
    for estimate in estimates:
        test = tests.get(stated_parameter(estimate.parameter, catalogue()))
        if test is not None and estimate.identified:
            estimate = replace(estimate, tests=(*estimate.tests, test))
        tested.append(estimate)
    return tuple(tested)


def usable(estimate: Estimate) -> bool:
    """True if an estimate has a value and no test contradicts it."""
    return estimate.has_value and estimate.verdict != "contradicted"


def still_recordings(trace: Trace, name: str | None = None) -> Iterator[Recording]:
    """Yield the recordings of forces while an object, or the one called `name`, was held still in the air."""
    for recording in trace.recordings:
        context = recording.context
        is_carried = context.holding is not None and name in (None, context.holding)
        if is_carried and recording.buffer == FORCES and context.activity == "still":
            yield recording


def cut_of(trace: Trace, name: str) -> HoldOut | None:
    """Choose the interval to hold out: the last of several lifts, else the way down after the measurement."""
    # Find the lifts in which the object was held still at least once.
    grasps = load_rows(trace, name).grasps
    lifts: list[HoldOut] = []
    # Grasps and releases alternate: every second interval is a lift.
    for start, end in list(pairwise([*grasps, float(trace.t[-1])]))[::2]:
        measured = [r for r in still_recordings(trace, name) if start <= r.start and r.end <= end]
        if measured:
            # Follow the path of the first recording: later the object may be tilted.
            lifts.append(HoldOut("", start, end, measured[0]))
    if not lifts:
        return None
    # With several lifts, the last one as a whole is held out.
    last = lifts[-1]
    if len(lifts) > 1:
        return replace(last, words=f"the last of {len(lifts)} lifts of the {name}")
    # Keep all recordings in the air for the estimates: the interval begins after the last of them.
    kept = [last.recording.end]
    for recording in trace.recordings:
        inside = last.start <= recording.start and recording.end <= last.end
        if inside and recording.context.activity in IN_THE_AIR:
            kept.append(recording.end)
    words = f"the way down with the {name}, after it was measured"
    return replace(last, words=words, start=float(np.nextafter(max(kept), np.inf)))


def judge(
    scene: Scene,
    trace: Trace,
    estimates: Sequence[Estimate],
    name: str,
    choice: Mapping[str, str] | None,
) -> HeldOutMotion | str:
    """Predict and judge the held-out motion of an object; return the reason if there is none."""
    body = scene.bodies.get(name)
    cut = cut_of(trace, name)
    if body is None or cut is None:
        return "nothing was recorded of it that could be held out"
    # Repeat the estimates of the object without the interval.
    of_it = [e for e in estimates if e.parameter.object == name and usable(e)]
    wanted = list(
        dict.fromkeys(stated_parameter(estimate.parameter, catalogue()) for estimate in of_it)
    )
    wanted = [parameter for parameter in wanted if parameter.quantity in FITTED]
    fitted = estimate_all(wanted, trace.without(cut.start, cut.end), scene.bodies, choice)
    again = {estimate.parameter.quantity: estimate for estimate in fitted}
    signals = len(trace.hand.joints)

    # Make the load's wrench from the new mass and centre of mass.
    mass = known_value(again.get("mass"), body.known.get("mass"), signals) or mass_part(
        fitted, signals
    )
    if mass is None:
        return explain_missing_mass(again.get("mass"), cut)
    # Predict the loaded segments within the interval.
    along = weighing(trace, cut.recording)
    motion = [s for s in along.segments if s.loaded and cut.start <= s.start and s.end <= cut.end]
    lever = lever_of(scene, trace, name, cut.recording, again.get("com"))
    wrench = wrench_of(mass, lever, trace.gravity)
    predicted = predict_segments(along, motion, wrench, trace.gravity, trace.hand)
    if predicted is None:
        return "nothing was recorded of the empty hand along the motion that could be held out"
    # Predict the same load with the mass of the prior, for comparison.
    believed = scene.priors.get(Parameter(name, "mass"), tuple(mass.value.tolist()))
    guess = predicted.instead(wrench.value * believed[0] / float(mass.value[0]))
    return judged_motion(name, cut, predicted, guess, trace)


def explain_missing_mass(mass: Estimate | None, cut: HoldOut) -> str:
    """Explain why no mass predicts the held-out motion."""
    if mass is None:
        return "neither a mass nor a centre of mass was measured that could predict a motion"
    how_well = (
        f"known to {1e3 * mass.stds[0]:.2g} g, {mass.verdict}" if usable(mass) else mass.verdict
    )
    return f"without {cut.words}, its mass is {how_well}"


def judged_motion(
    name: str, cut: HoldOut, predicted: PredictedSignal, guess: PredictedSignal, trace: Trace
) -> HeldOutMotion:
    from scipy.special import fdtrc

    # Fit the wrench that the prediction lacks; the p-value is that of an F-test with the noise's
    # degrees of freedom.
    more, covariance = predicted.missing_wrench()
    dof, misfit = len(predicted.residual), predicted.misfit
    return HeldOutMotion(
        object=name,
        motion=cut.words,
        start=cut.start,
        end=cut.end,
        chi2=misfit,
        dof=dof,
        p=float(fdtrc(dof, predicted.freedom, misfit / dof)),
        chi2_template=guess.misfit,
        rms=rms(predicted.residual),
        rms_template=rms(guess.residual),
        weight=float(more[0]) / trace.gravity,
        weight_std=float(np.sqrt(covariance[0, 0])) / trace.gravity,
        tests=tuple(tests_of(name, predicted, more, covariance, trace.gravity)),
        curve=curve_of(predicted, guess, trace),
    )


def tests_of(
    name: str, predicted: PredictedSignal, more: Array, covariance: Array, gravity: float
) -> Iterator[FitTest]:
    """Test the wrench `more` (3,), N and N m, that the prediction lacks, and the whole residual.

    `covariance` (3, 3) is that of `more`, `gravity` is in m/s^2.
    """
    lead = "In a motion that was held out,"
    # Weight: one degree of freedom.
    mass = float(more[0]) / gravity
    direction = "heavier" if mass > 0 else "lighter"
    yield chi_squared(
        WEIGHT,
        float(more[0] ** 2 / covariance[0, 0]),
        1,
        f"{lead} the {name} is {1e3 * abs(mass):.3g} g {direction} than the twin predicts.",
        predicted.freedom,
    )
    # Balance: two horizontal moments.
    moment = float(np.hypot(more[1], more[2]))
    yield chi_squared(
        BALANCE,
        float(more[1:] @ np.linalg.solve(covariance[1:, 1:], more[1:])),
        2,
        f"{lead} the moment of the {name} is {moment:.2g} N·m off what the twin predicts.",
        predicted.freedom,
    )
    # All torques: one degree of freedom a row.
    yield chi_squared(
        TORQUES,
        predicted.misfit,
        len(predicted.residual),
        f"{lead} {rms(predicted.residual):.2g} N·m (rms) of the joint torques are not explained.",
        predicted.freedom,
    )


def curve_of(predicted: PredictedSignal, guess: PredictedSignal, trace: Trace) -> Curve:
    # Sort the bins by time: segments may overlap.
    order = np.argsort(predicted.t)
    std = np.sqrt(np.diag(predicted.covariance)).reshape(predicted.measured.shape)
    # A robot with a wrench sensor has six signals instead of the joints.
    names = trace.hand.joints
    if len(predicted.measured) != len(names):
        names = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")

    # Five decimals suffice for the plot.
    def rows(values: Array) -> tuple[tuple[float, ...], ...]:
        return tuple(tuple(row) for row in values[:, order].round(5).tolist())

    (times,) = rows(predicted.t[None])
    parts = (predicted.measured, std, predicted.expected, guess.expected)
    return Curve(names, times, *map(rows, parts))


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
