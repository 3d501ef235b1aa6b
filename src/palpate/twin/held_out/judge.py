"""Holds motions out, makes the estimates again without them, and tests what they predict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.estimate import Estimate
from palpate.estimation.load.segments import weighing
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.quantities.estimators import estimate_all
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace
from palpate.trace.soundness import sound
from palpate.twin.held_out.believed import besides, hanging_of, known, wrench_of
from palpate.twin.held_out.cut import Cut, cut_of, lifted
from palpate.twin.held_out.judged import BALANCE, JUDGED, TORQUES, WEIGHT, Curve, HeldOut, Motion
from palpate.twin.held_out.prediction import Predicted, predicted

FITTED = ("mass", "com", "inertia")
"""Quantities that tell how an object weighs on the hand."""


def held_out(
    scene: Scene,
    trace: Trace,
    estimates: Sequence[Estimate],
    choice: Mapping[str, str] | None = None,
) -> HeldOut | None:
    """Judge what is believed of every object that was lifted; None where nothing was. `choice` names
    the estimators by quantity, where `estimates` were not made by the default ones."""
    evidence = sound(trace)
    motions: list[Motion] = []
    notes: list[str] = []
    for name in lifted(evidence):
        judged = _judged(scene, evidence, estimates, name, choice)
        if isinstance(judged, str):
            notes.append(f"{name}: {judged}")
        else:
            motions.append(judged)
    if not motions and not notes:
        return None
    return HeldOut(tuple(motions), tuple(notes))


def with_tests(estimates: Sequence[Estimate], held: HeldOut) -> tuple[Estimate, ...]:
    """The estimates with the tests of what was held out: a mass that does not predict the weight in
    another motion, or a centre of mass the balance, is contradicted."""
    tests: dict[Parameter, FitTest] = {}
    for motion in held.motions:
        for test in motion.tests:
            if test.name in JUDGED:
                tests[Parameter(motion.object, JUDGED[test.name])] = test
    found: list[Estimate] = []
    for estimate in estimates:
        test = tests.get(estimate.parameter)
        if test is not None and estimate.identified:
            estimate = replace(estimate, tests=(*estimate.tests, test))
        found.append(estimate)
    return tuple(found)


def _judged(
    scene: Scene,
    trace: Trace,
    estimates: Sequence[Estimate],
    name: str,
    choice: Mapping[str, str] | None,
) -> Motion | str:
    """The motion that was held out of an object's, or why there is none."""
    body = scene.bodies.get(name)
    cut = cut_of(trace, name)
    if body is None or cut is None:
        return "nothing was recorded of it that could be held out"
    wanted = [e.parameter for e in estimates if e.parameter.object == name and e.identified]
    wanted = [parameter for parameter in wanted if parameter.quantity in FITTED]
    fitted = estimate_all(wanted, trace.without(cut.start, cut.end), scene.bodies, choice)
    again = {estimate.parameter.quantity: estimate for estimate in fitted}
    signals = len(trace.hand.joints)

    mass = known(again.get("mass"), body.known.get("mass"), signals) or besides(fitted, signals)
    if mass is None:
        return "its mass is not known well enough to predict another motion"
    along = weighing(trace, cut.recording)
    motion = [s for s in along.segments if s.loaded and cut.start <= s.start and s.end <= cut.end]
    hanging = hanging_of(scene, trace, name, cut.recording, again.get("com"))
    wrench = wrench_of(mass, hanging, trace.gravity)
    found = predicted(along, motion, wrench, trace.gravity, trace.hand)
    if found is None:
        return "nothing was recorded of the empty hand along the motion that could be held out"
    believed = scene.priors.get(Parameter(name, "mass"), tuple(mass.value.tolist()))
    guess = found.instead(wrench.value * believed[0] / float(mass.value[0]))
    return _motion(name, cut, found, guess, trace)


def _motion(name: str, cut: Cut, found: Predicted, guess: Predicted, trace: Trace) -> Motion:
    from scipy.special import fdtrc

    more, spread = found.beyond()
    dof, misfit = len(found.left), found.misfit
    return Motion(
        name,
        cut.words,
        cut.start,
        cut.end,
        misfit,
        dof,
        float(fdtrc(dof, found.freedom, misfit / dof)),
        guess.misfit,
        _rms(found.left),
        _rms(guess.left),
        float(more[0]) / trace.gravity,
        float(np.sqrt(spread[0, 0])) / trace.gravity,
        tuple(_tests(name, found, more, spread, trace.gravity)),
        _curve(found, guess, trace),
    )


def _tests(
    name: str, found: Predicted, more: Array, spread: Array, gravity: float
) -> Iterator[FitTest]:
    mass = float(more[0]) / gravity
    way = "heavier" if mass > 0 else "lighter"
    yield chi_squared(
        WEIGHT,
        float(more[0] ** 2 / spread[0, 0]),
        1,
        f"In a motion that was held out, the {name} is {1e3 * abs(mass):.3g} g {way} than the twin "
        "predicts.",
        found.freedom,
    )
    moment = float(np.hypot(more[1], more[2]))
    yield chi_squared(
        BALANCE,
        float(more[1:] @ np.linalg.solve(spread[1:, 1:], more[1:])),
        2,
        f"In a motion that was held out, the moment of the {name} is {moment:.2g} N·m off what the "
        "twin predicts.",
        found.freedom,
    )
    yield chi_squared(
        TORQUES,
        found.misfit,
        len(found.left),
        f"In a motion that was held out, {_rms(found.left):.2g} N·m (rms) of the joint torques are not "
        "explained.",
        found.freedom,
    )


def _curve(found: Predicted, guess: Predicted, trace: Trace) -> Curve:
    order = np.argsort(found.t)
    std = np.sqrt(np.diag(found.covariance)).reshape(found.felt.shape)
    names = trace.hand.joints
    if len(found.felt) != len(names):
        names = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
    parts = (found.felt, std, found.expected, guess.expected)
    return Curve(names, _rounded(found.t[order]), *(_rows(part[:, order]) for part in parts))


def _rows(values: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(_rounded(row) for row in values)


def _rounded(values: Array) -> tuple[float, ...]:
    return tuple(np.round(values, 5).tolist())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
