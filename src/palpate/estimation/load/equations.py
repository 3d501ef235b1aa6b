"""The equations of a weighing: its signals in rows, their covariance without the load, and linear
models of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.load.segments import Segment, Weighing
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

FORCE_Z, TORQUE_X, TORQUE_Y, TORQUE_Z = 2, 3, 4, 5
"""Components of a wrench."""
LEANING = (0, 1)
"""Those that a weight has where gravity leans."""
SIDEWAYS = (0, 1, 5)
"""Those that a thing which hangs free does not have."""
WAYS = {"up": 1.0, "down": -1.0}


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The equations of one weighing, signal by signal and in each bin by bin.

    Attributes:
        felt: (n,) the signals. root: (n, n) lower triangle whose square is their covariance without
            the load.
        wrench: (n, 6) what the components of the load's wrench make of them.
        grasp: (n,) s, of loaded rows. height: (n,) m about its mean, of loaded rows.
        way: (n,) 1 up, -1 down, 0 at rest. rest: (n,) 1 at rest.
        rubbed: (n, p) what a level of friction in each joint makes of them, and what it had at the
            start (`estimation.load.rubbing`).
        left: what each pass may be off by as a whole, for what an approach leaves: (n, 3 passes) as
            forces at the TCP of a newton an axis, and (n, m passes) in each signal.
        signal: (n,) which signal a row is of. freedom: degrees of freedom of the noise.
    """

    felt: Array
    root: Array
    wrench: Array
    grasp: Array
    height: Array
    way: Array
    rest: Array
    rubbed: Array
    left: tuple[Array, Array]
    signal: NDArray[np.intp]
    freedom: float

    def white(self, columns: Array) -> Array:
        """(n, p) in rows of unit variance."""
        whitened: Array = np.linalg.solve(self.root, columns).astype(np.float64)
        return whitened


@dataclass(frozen=True, slots=True, eq=False)
class Unsure:
    """How far the prior deviations of some coefficients are off themselves: by one of `factors`,
    `chance` of each of which is what is believed before anything is recorded."""

    columns: slice
    factors: Sequence[float]
    chance: Sequence[float]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A linear model in rows of unit variance: `y` (n,) = `design` (n, p) times coefficients with
    prior deviations `prior` (p,), some of which are `unsure`; the unit is known with `freedom`
    degrees of freedom."""

    design: Array
    y: Array
    prior: Array
    freedom: float
    unsure: tuple[Unsure, ...]

    def solve(self) -> tuple[Array, Array]:
        """Posterior mean (p,) and covariance (p, p), averaged over what is unsure by what `y` says of
        it (Bayesian model averaging: Hoeting et al., Statistical Science 14, 1999)."""
        told, gram = self.design.T @ self.y, self.design.T @ self.design
        choices = product(*(range(len(each.factors)) for each in self.unsure))
        solved = [self._solve(choice, told, gram) for choice in choices]
        evidence = np.array([each[2] for each in solved])
        weights = np.exp(evidence - evidence.max())
        weights /= weights.sum()
        means = np.array([each[0] for each in solved])
        mean: Array = weights @ means
        covariance: Array = (means - mean).T @ (weights[:, None] * (means - mean))
        for weight, (_, own, _) in zip(weights, solved, strict=True):
            covariance += weight * own
        return mean, covariance

    def _solve(
        self, choice: tuple[int, ...], told: Array, gram: Array
    ) -> tuple[Array, Array, float]:
        """Where the deviations are off by the chosen factors: mean, covariance, and the logarithm of
        the probability of that and of `y`, but for what is the same for every choice (Bishop,
        Pattern Recognition and Machine Learning, section 3.5.1)."""
        prior, chance = self.prior.copy(), 0.0
        for each, i in zip(self.unsure, choice, strict=True):
            prior[each.columns] *= each.factors[i]
            chance += float(np.log(each.chance[i]))
        # In units of the prior, where what is known for certain has none.
        information = np.outer(prior, prior) * gram + np.eye(len(prior))
        covariance: Array = np.linalg.inv(information) * np.outer(prior, prior)
        mean = covariance @ told
        _, volume = np.linalg.slogdet(information)
        return mean, covariance, chance + 0.5 * (float(mean @ told) - float(volume))

    def extended(self, columns: Array, prior: float) -> Model:
        """With further coefficients, in front."""
        more = np.full(columns.shape[1], prior)
        wider = np.concatenate([columns, self.design], axis=1)
        unsure: list[Unsure] = []
        for each in self.unsure:
            moved = slice(each.columns.start + len(more), each.columns.stop + len(more))
            unsure.append(replace(each, columns=moved))
        deviations = np.concatenate([more, self.prior])
        return replace(self, design=wider, prior=deviations, unsure=tuple(unsure))


def equations(weighing: Weighing, gravity: float, hand: Hand) -> Rows:
    found = weighing.segments
    hanging: list[Array] = []
    for segment in found:
        hanging.append(segment.loaded * (1.0 + segment.acceleration / gravity))
    loaded = np.concatenate(hanging)
    maps = np.concatenate([segment.maps for segment in found])
    path = np.concatenate([segment.path for segment in found])
    signals = int(maps.shape[1])
    root: Array = np.linalg.cholesky(_covariance(weighing, maps, hand)).astype(np.float64)

    def each(values: Iterable[float]) -> Array:
        """A number of each segment, in all its rows."""
        pairs = zip(found, values, strict=True)
        return np.tile(np.concatenate([np.full(len(s.t), v) for s, v in pairs]), signals)

    return Rows(
        np.concatenate([segment.felt for segment in found]).T.ravel(),
        root,
        (maps * loaded[:, None, None]).transpose(1, 0, 2).reshape(-1, 6),
        each(segment.grasp for segment in found),
        np.tile(path - path[loaded != 0.0].mean(), signals),
        each(WAYS.get(segment.kind, 0.0) for segment in found),
        each(float(segment.at_rest) for segment in found),
        _rubbed(found, signals),
        _left(weighing, maps),
        np.repeat(np.arange(signals), len(path)),
        weighing.noise.freedom,
    )


def _rubbed(found: Sequence[Segment], signals: int) -> Array:
    """(signals x bins, 2 joints): a joint's friction shows in its own signal."""
    states = np.concatenate([segment.rubbed for segment in found])
    bins, joints, kinds = states.shape
    if not joints:
        return np.zeros((signals * bins, 0))
    columns = np.zeros((joints, bins, joints, kinds))
    for joint in range(joints):
        columns[joint, :, joint] = states[:, joint]
    return columns.reshape(joints * bins, joints * kinds)


def in_each(row: Rows, grasps: Sequence[float], components: Sequence[int]) -> Array:
    """(n, grasps x components): columns of `components` of the wrench, its own in each grasp."""
    columns = [row.wrench[:, components] * (row.grasp == grasp)[:, None] for grasp in grasps]
    return np.concatenate(columns, axis=1)


def _left(weighing: Weighing, maps: Array) -> tuple[Array, Array]:
    """The columns of `Rows.left`."""
    signals, count = int(maps.shape[1]), len(maps)
    own = np.eye(signals) * weighing.scale[:, None]
    at_hand: list[Array] = [np.zeros((signals, count, 0))]
    in_signals: list[Array] = [np.zeros((signals, count, 0))]
    at = 0
    for segment in weighing.segments:
        here = slice(at, at + len(segment.t))
        at = here.stop
        if segment.at_rest:
            continue
        forces, offsets = np.zeros((signals, count, 3)), np.zeros((signals, count, signals))
        forces[:, here] = maps[here, :, :3].transpose(1, 0, 2)
        offsets[:, here] = own[:, None, :]
        at_hand.append(forces)
        in_signals.append(offsets)
    rows = signals * count
    return (
        np.concatenate(at_hand, axis=2).reshape(rows, -1),
        np.concatenate(in_signals, axis=2).reshape(rows, -1),
    )


def _covariance(weighing: Weighing, maps: Array, hand: Hand) -> Array:
    """(n, n) of all rows without the load: white noise, biases, the arm's inertia, drift, and what
    sticks."""
    found = weighing.segments
    bins, signals = maps.shape[:2]
    variance = np.concatenate([segment.variance for segment in found])
    bias = _bias(found)
    t = np.concatenate([segment.t for segment in found])
    apart = np.abs(t[:, None] - t)
    moved = _moved(found, weighing.scale)
    out = np.zeros((signals * bins, signals * bins))
    for i, scale in enumerate(weighing.scale.tolist()):
        block = scale**2 * (bias + _drift(apart)) + weighing.noise.flicker[i] * flicker(apart)
        block += moved[i]
        block += np.diag(variance[:, i] + (tuning.FLOOR * scale) ** 2)
        out[i * bins : (i + 1) * bins, i * bins : (i + 1) * bins] = block
    at_rest = np.concatenate([np.full(len(s.t), s.at_rest) for s in found])
    for b in np.flatnonzero(at_rest):
        # What sticks looks like a force at the TCP.
        stuck = maps[b][:, :3] * hand.force_repeatability
        out[b::bins, b::bins] += stuck @ stuck.T
    return out


def _bias(found: Sequence[Segment]) -> Array:
    """(bins, bins) N²: of one signal in units of its scale, all that is no noise: a common bias, one
    of each kind along the path, what the arm's own motion makes, and what a rest was left with."""
    path = np.concatenate([segment.path for segment in found])
    kinds = np.concatenate([[segment.kind] * len(segment.t) for segment in found])
    own = np.concatenate([np.full(len(s.t), i) for i, s in enumerate(found)])
    at_rest = np.concatenate([np.full(len(s.t), float(s.at_rest)) for s in found])
    speed2 = np.concatenate([segment.speed2 for segment in found])
    _, half = _middle(path)
    powers = _powers(path, tuning.DEGREE)
    near = np.maximum(0.0, 1.0 - np.abs(path[:, None] - path) * tuning.BINS / (2.0 * half))
    moving = tuning.CENTRIFUGAL**2 * np.outer(speed2, speed2)
    moving += tuning.VISCOUS**2 * np.sqrt(np.outer(speed2, speed2))
    of_kind = tuning.KIND_BIAS**2 * (powers @ powers.T) + tuning.BIN_BIAS**2 * near + moving
    out = tuning.FORCE_BIAS**2 + of_kind * (kinds[:, None] == kinds)
    out += tuning.REST_FRICTION**2 * np.outer(at_rest, at_rest) * (own[:, None] == own)
    return out


def _middle(path: Array) -> tuple[float, float]:
    """m: the middle of a path, and how far it goes to either side."""
    low, high = float(path.min()), float(path.max())
    return (high + low) / 2.0, max((high - low) / 2.0, 1e-9)


def _powers(path: Array, degree: int) -> Array:
    """(bins, degree + 1) of the place along the path, from -1 to 1."""
    middle, half = _middle(path)
    return np.power.outer((path - middle) / half, np.arange(degree + 1))


def _moved(found: Sequence[Segment], scale: Array) -> Array:
    """(signals, bins, bins) what is not known of what the arm's own motion takes."""
    motion = np.concatenate([segment.motion for segment in found])
    if not motion.shape[1]:
        return scale[:, None, None] ** 2 * _inertia(found)
    changes = np.concatenate([_change(segment) for segment in found])
    out: list[Array] = []
    for taken, change in zip(motion.T, changes.T, strict=True):
        block = tuning.INERTIA_SHARE**2 * np.outer(taken, taken)
        block += tuning.DELAY**2 * np.outer(change, change)
        out.append(block + np.diag((tuning.UNSTEADY_SHARE * taken) ** 2))
    return np.array(out)


def _change(segment: Segment) -> Array:
    """(bins, signals) N m/s of what the arm's own motion takes."""
    if len(segment.t) < 2:
        return np.zeros_like(segment.motion)
    changes: Array = np.gradient(segment.motion, segment.t, axis=0)
    return changes


def _inertia(found: Sequence[Segment]) -> Array:
    """(bins, bins) N² of what an unknown arm takes."""
    path = np.concatenate([segment.path for segment in found])
    acceleration = np.concatenate([segment.acceleration for segment in found])
    inertia = acceleration[:, None] * _powers(path, tuning.INERTIA_DEGREE)
    out: Array = tuning.APPARENT_MASS**2 * (inertia @ inertia.T)
    return out + np.diag((tuning.UNSTEADY * acceleration) ** 2)


def _drift(apart: Array) -> Array:
    """(n, n) N²: covariance of an Ornstein-Uhlenbeck process at times `apart`, s."""
    return tuning.DRIFT**2 * np.exp(-apart / tuning.DRIFT_TIME)


def flicker(apart: Array) -> Array:
    """(n, n): covariance of 1/f noise of density 1/f, at times `apart`, s: a sum of processes with
    time constants evenly in their logarithm (Riley, as in `estimation.load.noise`, section 3.3)."""
    times = tuning.FLICKER_TIMES
    step = float(np.log(times[1] / times[0]))
    out = np.zeros_like(apart)
    for time in times:
        out += step * np.exp(-apart / time)
    return out
