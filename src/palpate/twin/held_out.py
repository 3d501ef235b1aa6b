"""The twin judged on motions that it was not fitted to.

Of every object that was lifted, one motion is held out: the last lift where there are several, else
the way back down after it was measured. All that was recorded of it is cut out of the trace, the
estimates are made again from the rest, and the joint torques of the motion are predicted from them
(`palpate.twin.prediction`). What was measured then passes three tests, with the false alarms of all
tests of fit: whether the object weighs what was predicted, whether it hangs where its centre of mass
says, and whether anything else is left in the torques.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.balance import BELIEVED, accuracy
from palpate.estimation.estimate import Estimate
from palpate.estimation.holds import pose_in_hand
from palpate.estimation.load.segments import weighing
from palpate.estimation.windows import load_of, mean_pose
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.whole import whole
from palpate.parameter import Parameter
from palpate.quantities.estimators import estimate_all
from palpate.scene.scene import Scene
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace
from palpate.trace.soundness import sound
from palpate.twin.prediction import Predicted, Wrench, predicted

WEIGHT, BALANCE, TORQUES = "held-out weight", "held-out balance", "held-out torques"
"""The tests; the first two are tests of a mass and of a centre of mass."""
JUDGED = {WEIGHT: "mass", BALANCE: "com"}
IN_THE_AIR = ("still", "swinging")
"""Activities of recordings that such an estimate rests on."""
FITTED = ("mass", "com", "inertia")
"""Quantities that tell how an object weighs on the hand."""


@dataclass(frozen=True, slots=True)
class Curve:
    """Signals over a motion, bin by bin, for the plot: `signals` (m,) their names, `t` (k,) s, and of
    each signal (k,) what the load made of it, N m (N of a force): `measured` with `std`, `twin` and
    `template` as predicted."""

    signals: tuple[str, ...]
    t: tuple[float, ...]
    measured: tuple[tuple[float, ...], ...]
    std: tuple[tuple[float, ...], ...]
    twin: tuple[tuple[float, ...], ...]
    template: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion that was held out, and how it was predicted.

    Attributes:
        object: what was in the hand.
        motion: which motion, in words.
        start, end: s.
        chi2, dof, p: of the joint torques, over all joints and bins, and how probable so much is.
        chi2_template: the same, had the object weighed what was believed before.
        rms, rms_template: root mean square of measured less predicted torques, N m.
        weight, weight_std: kg, how much more it weighed than predicted, and 1 sigma of that.
        tests: what was tested.
        curve: for the plot.
    """

    object: str
    motion: str
    start: float
    end: float
    chi2: float
    dof: int
    p: float
    chi2_template: float
    rms: float
    rms_template: float
    weight: float
    weight_std: float
    tests: tuple[FitTest, ...]
    curve: Curve

    @property
    def agrees(self) -> bool:
        """Whether the object weighs and hangs as predicted. What is left in the torques besides may be
        the arm's own."""
        return all(test.passed for test in self.tests if test.name in JUDGED)

    @property
    def disagreement(self) -> str:
        """What was not as predicted, in words; what is left in the torques among it."""
        return " ".join(test.finding for test in self.tests if not test.passed)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """All motions that were held out, one an object; `notes`: why there is none of an object."""

    motions: tuple[Motion, ...]
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether all were as predicted."""
        return all(motion.agrees for motion in self.motions)


@dataclass(frozen=True, slots=True)
class _Cut:
    """What is held out, and the recording whose path it goes along."""

    words: str
    start: float
    end: float
    recording: Recording


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """A value (n,), the standard deviation (n,) of its own, and what one of each gain did (n, m)."""

    value: Array
    own: Array
    gains: Array


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
    for name in _lifted(evidence):
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


def _lifted(trace: Trace) -> list[str]:
    names = [recording.context.holding for recording in _still(trace)]
    return list(dict.fromkeys(name for name in names if name is not None))


def _still(trace: Trace, name: str | None = None) -> Iterator[Recording]:
    """Recordings of forces while something, or `name`, was held still in the air."""
    for recording in trace.recordings:
        context = recording.context
        held = context.holding is not None and name in (None, context.holding)
        if held and recording.buffer == FORCES and context.activity == "still":
            yield recording


def _judged(
    scene: Scene,
    trace: Trace,
    estimates: Sequence[Estimate],
    name: str,
    choice: Mapping[str, str] | None,
) -> Motion | str:
    """The motion that was held out of an object's, or why there is none."""
    body = scene.bodies.get(name)
    cut = _cut(trace, name)
    if body is None or cut is None:
        return "nothing was recorded of it that could be held out"
    wanted = [e.parameter for e in estimates if e.parameter.object == name and e.identified]
    wanted = [parameter for parameter in wanted if parameter.quantity in FITTED]
    fitted = estimate_all(wanted, trace.without(cut.start, cut.end), scene.bodies, choice)
    again = {estimate.parameter.quantity: estimate for estimate in fitted}
    signals = len(trace.hand.joints)

    mass = _known(again.get("mass"), body.known.get("mass"), signals) or _besides(fitted, signals)
    if mass is None:
        return "its mass is not known well enough to predict another motion"
    along = weighing(trace, cut.recording)
    motion = [s for s in along.segments if s.loaded and cut.start <= s.start and s.end <= cut.end]
    hanging = _hanging(scene, trace, name, cut.recording, again.get("com"))
    wrench = _wrench(mass, hanging, trace.gravity)
    found = predicted(along, motion, wrench, trace.gravity, trace.hand)
    if found is None:
        return "nothing was recorded of the empty hand along the motion that could be held out"
    believed = scene.priors.get(Parameter(name, "mass"), tuple(mass.value.tolist()))
    guess = found.instead(wrench.value * believed[0] / float(mass.value[0]))
    return _motion(name, cut, found, guess, trace)


def _cut(trace: Trace, name: str) -> _Cut | None:
    """The last lift of several, else the way down after the object was measured."""
    grasps = load_of(trace, name).grasps
    ends = [*grasps, float(trace.t[-1])]
    lifts: list[_Cut] = []
    for start, end in list(pairwise(ends))[::2]:
        measured = [one for one in _still(trace, name) if start <= one.start and one.end <= end]
        if measured:
            # Along the way up to where it was measured first: later it may be tilted.
            lifts.append(_Cut("", start, end, measured[0]))
    if not lifts:
        return None
    last = lifts[-1]
    if len(lifts) > 1:
        return replace(last, words=f"the last of {len(lifts)} lifts of the {name}")
    words = f"the way down with the {name}, after it was measured"
    # What was recorded of it in the air stays.
    stays = [last.recording.end]
    for one in trace.recordings:
        if one.context.activity in IN_THE_AIR and last.start <= one.start and one.end <= last.end:
            stays.append(one.end)
    return replace(last, words=words, start=float(np.nextafter(max(stays), np.inf)))


def _known(
    estimate: Estimate | None, stated: tuple[float, ...] | None, signals: int
) -> _Known | None:
    """What was fitted without the motion, else what the scene states."""
    if estimate is None and stated is not None:
        return _Known(np.array(stated), np.zeros(len(stated)), np.zeros((len(stated), signals)))
    if estimate is None or not estimate.identified:
        return None
    # What all grasps have in common is in the motion as well, but for what was believed before.
    common = tuple(one for one in estimate.shared if not one.cause.startswith(BELIEVED))
    alike = replace(estimate, shared=common).shared_std
    own = np.sqrt(np.maximum(estimate.std**2 - alike**2, 0.0))
    effects = {shared.cause: shared.effect for shared in estimate.shared}
    nothing = (0.0,) * len(own)
    columns = [effects.get(f"gain of joint {i + 1}", nothing) for i in range(signals)]
    return _Known(estimate.value, own, np.array(columns).T)


def _besides(fitted: Sequence[Estimate], signals: int) -> _Known | None:
    """The mass that was found together with a centre of mass or an inertia."""
    for estimate in fitted:
        found = estimate.parts.get("mass")
        if estimate.identified and found is not None:
            return _Known(np.array([found.value]), np.array([found.std]), np.zeros((1, signals)))
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Hanging:
    """Where the load hangs from the TCP, seen from above: (2,) m, its covariance (2, 2), and what
    gains did to it (2, m)."""

    offset: Array
    covariance: Array
    gains: Array


def _hanging(
    scene: Scene, trace: Trace, name: str, recording: Recording, fitted: Estimate | None
) -> _Hanging:
    """By the centre of mass that was fitted or is stated, else by the one that MuJoCo would infer,
    which then is known no better than before it was measured."""
    body, signals = scene.bodies[name], len(trace.hand.joints)
    pose_world_tcp = mean_pose(trace.of(recording))
    pose_world_body: Pose = pose_world_tcp @ pose_in_hand(trace, recording, body)
    across = pose_world_body.rotation[:2]
    # Where grasps were compared, what they have in common is in none of the differences.
    place = tuning.GRASP_SHIFT**2 + 2.0 * trace.hand.pose_repeatability**2
    centre = _known(fitted, body.known.get("com"), signals)
    if fitted is None or centre is None:
        place += accuracy(body) ** 2 + trace.hand.tip_offset_std**2
    if centre is None:
        spread = tuning.COM_PRIOR * np.maximum(body.size, 1e-3)
        inferred = whole(scene.spec().compile(), name).com
        centre = _Known(inferred, spread, np.zeros((3, signals)))
    offset = (pose_world_body.position - pose_world_tcp.position)[:2] + across @ centre.value
    covariance = across @ np.diag(centre.own**2) @ across.T + place * np.eye(2)
    return _Hanging(offset, covariance, across @ centre.gains)


def _wrench(mass: _Known, hanging: _Hanging, gravity: float) -> Wrench:
    """The weight F at r = (x, y) from the TCP has the moment (y F, -x F)."""
    force = float(mass.value[0]) * gravity
    x, y = hanging.offset.tolist()
    of_force = np.array([1.0, y, -x])
    of_offset = force * np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    own = (float(mass.own[0]) * gravity) ** 2 * np.outer(of_force, of_force)
    gains = np.outer(of_force, gravity * mass.gains[0]) + of_offset @ hanging.gains
    return Wrench(force * of_force, own + of_offset @ hanging.covariance @ of_offset.T, gains)


def _motion(name: str, cut: _Cut, found: Predicted, guess: Predicted, trace: Trace) -> Motion:
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
