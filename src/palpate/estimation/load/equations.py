"""The equations of a weighing: its signals in rows, their covariance without the load, and linear
models of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.load.biases import covariance
from palpate.estimation.load.segments import Segment, Weighing
from palpate.estimation.windows import Mask
from palpate.geometry.pose import Array

FORCE_Z, TORQUE_X, TORQUE_Y, TORQUE_Z = 2, 3, 4, 5
"""Components of a wrench."""
LEANING = (0, 1)
"""Those that a weight has where gravity leans."""
SIDEWAYS = (0, 1, 5)
"""Those that a thing which hangs free does not have."""
WAYS = {"up": 1.0, "down": -1.0}


class Left(NamedTuple):
    """What an approach leaves in the joints.

    Attributes:
        stuck: (n, 3 rests) at a rest, as forces at the TCP of a newton an axis.
        forces: (n, 3 passes) in a pass, likewise.
        carried: (n, 3 pairs) at a rest and in the pass that begins at it.
        offsets: (n, m passes) in a pass, in each signal.
        paired: (3 rests + 3 passes,) which of `stuck` and `forces` are of such a pair.
    """

    stuck: Array
    forces: Array
    carried: Array
    offsets: Array
    paired: Mask

    @property
    def columns(self) -> tuple[Array, Array, Array, Array]:
        return self.stuck, self.forces, self.carried, self.offsets


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The equations of one weighing, signal by signal and in each bin by bin.

    Attributes:
        felt: (n,) the signals.
        root: (n, n) lower triangle whose square is their covariance without the load.
        wrench: (n, 6) what the components of the load's wrench make of them.
        grasp: (n,) s, of loaded rows.
        height: (n,) m about its mean, of loaded rows.
        way: (n,) 1 up, -1 down, 0 at rest.
        rest: (n,) 1 at rest.
        rubbed: (n, p) what a level of friction in each joint makes of them, and what it had at the
            start (`estimation.load.rubbing`).
        left: what each rest and each pass may be off by as a whole, for what an approach leaves in
            the joints.
        since: (n, k) what a newton upward at the TCP makes of them from the second segment on, from the third,
            and so on in time.
        signal: (n,) which signal a row is of.
        freedom: degrees of freedom of the noise.
    """

    felt: Array
    root: Array
    wrench: Array
    grasp: Array
    height: Array
    way: Array
    rest: Array
    rubbed: Array
    left: Left
    since: Array
    signal: NDArray[np.intp]
    freedom: float

    @property
    def volume(self) -> float:
        """Logarithm of the volume that a unit of all rows becomes by whitening, negative."""
        return float(np.log(np.diag(self.root)).sum())

    def white(self, columns: Array) -> Array:
        """(n, p) in rows of unit variance."""
        from scipy.linalg.lapack import dtrtrs

        # LAPACK's matrices go by columns, so that it takes the root for its transpose.
        return dtrtrs(self.root.T, columns, lower=False, trans=True)[0]


class _Solved(NamedTuple):
    """A posterior: prior deviations and mean (p,), and the Cholesky factor of the information in
    units of the former."""

    prior: Array
    root: Array
    mean: Array
    evidence: float

    def covariance(self, first: int) -> Array:
        """(first, p): the first rows."""
        from scipy.linalg.lapack import dpotrs

        columns = np.zeros((len(self.prior), first))
        np.fill_diagonal(columns, self.prior)
        return (dpotrs(self.root, columns, lower=True)[0] * self.prior[:, None]).T


@dataclass(frozen=True, slots=True, eq=False)
class Unsure:
    """How far the prior deviations of some coefficients are off themselves: by one of `factors`, of
    all of them or of each, `chance` of each of which is what is believed before anything is
    recorded."""

    columns: slice
    factors: Sequence[float | Array]
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

    def solve(self, first: int | None = None) -> tuple[Array, Array]:
        """Posterior mean (p,) and covariance (first, p), all rows of it by default, averaged over what is
        unsure by what `y` says of it (Bayesian model averaging: Hoeting et al., Statistical Science 14,
        1999)."""
        count = len(self.prior) if first is None else first
        every = self._every()
        evidence = np.array([each.evidence for each in every])
        weights = np.exp(evidence - evidence.max())
        weights /= weights.sum()
        counted = np.flatnonzero(weights > tuning.COUNTED)
        weights = weights[counted] / weights[counted].sum()
        solved = [every[i] for i in counted.tolist()]
        means = np.array([each.mean for each in solved])
        mean: Array = weights @ means
        covariance: Array = (means - mean)[:, :count].T @ (weights[:, None] * (means - mean))
        for weight, each in zip(weights, solved, strict=True):
            covariance += weight * each.covariance(count)
        return mean, covariance

    @property
    def evidence(self) -> float:
        """Logarithm of the probability density of `y`, but for a constant."""
        found = np.array([each.evidence for each in self._every()])
        likeliest = float(found.max())
        together = likeliest + float(np.log(np.exp(found - likeliest).sum()))
        return together - 0.5 * float(self.y @ self.y)

    def _every(self) -> Sequence[_Solved]:
        """For each choice of what is unsure."""
        told, gram = self.design.T @ self.y, self.design.T @ self.design
        choices = product(*(range(len(each.factors)) for each in self.unsure))
        return [self._solve(choice, told, gram) for choice in choices]

    def _solve(self, choice: tuple[int, ...], told: Array, gram: Array) -> _Solved:
        """Where the deviations are off by the chosen factors. The evidence is the logarithm of the
        probability of that and of `y`, but for what is the same for every choice (Bishop, Pattern
        Recognition and Machine Learning, section 3.5.1)."""
        from scipy.linalg.lapack import dpotrf, dpotrs

        prior, chance = self.prior.copy(), 0.0
        for each, i in zip(self.unsure, choice, strict=True):
            prior[each.columns] *= each.factors[i]
            chance += float(np.log(each.chance[i]))
        # In units of the prior, where what is known for certain has none.
        information = np.outer(prior, prior) * gram + np.eye(len(prior))
        root = dpotrf(information, lower=True)[0]
        solved = dpotrs(root, prior * told, lower=True)[0]
        mean = prior * solved
        volume = 2.0 * float(np.log(np.diag(root)).sum())
        return _Solved(prior, root, mean, chance + 0.5 * (float(mean @ told) - volume))

    def each_alone(self, columns: Array, prior: float) -> tuple[Array, Array]:
        """Posterior means and variances (k,) of further coefficients of `columns` (n, k), each of which would be
        the only one beside the model's."""
        from scipy.linalg.lapack import dpotrs

        shared = self.design.T @ columns
        told, squares = columns.T @ self.y, (columns**2).sum(axis=0)
        means: list[Array] = []
        variances: list[Array] = []
        evidence: list[Array] = []
        for each in self._every():
            scaled = each.prior[:, None] * shared
            known = (scaled * dpotrs(each.root, scaled, lower=True)[0]).sum(axis=0)
            variance = 1.0 / (np.maximum(squares - known, 0.0) + prior**-2)
            mean = variance * (told - shared.T @ each.mean)
            means.append(mean)
            variances.append(variance)
            evidence.append(each.evidence + 0.5 * (mean**2 / variance + np.log(variance)))
        weights = np.exp(np.array(evidence) - np.max(evidence, axis=0))
        weights /= weights.sum(axis=0)
        found: Array = (weights * means).sum(axis=0)
        return found, (weights * (np.array(variances) + (np.array(means) - found) ** 2)).sum(axis=0)

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


def equations(weighing: Weighing, gravity: float, apart: float = 1.0) -> Rows:
    """The rows of a weighing, kinds of segments being `apart` in their biases
    (`estimation.load.biases`)."""
    found = weighing.segments
    hanging: list[Array] = []
    for segment in found:
        hanging.append(segment.loaded * (1.0 + segment.acceleration / gravity))
    loaded = np.concatenate(hanging)
    maps = np.concatenate([segment.maps for segment in found])
    path = np.concatenate([segment.path for segment in found])
    signals = int(maps.shape[1])
    root: Array = np.linalg.cholesky(covariance(weighing, maps, apart)).astype(np.float64)

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
        _since(found, maps),
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


def each_its_own(blocks: Sequence[Array]) -> list[Array]:
    """The columns of each weighing beside those of the others, which are zero there."""
    width = sum(block.shape[1] for block in blocks)
    wide: list[Array] = []
    at = 0
    for block in blocks:
        own = np.zeros((len(block), width))
        own[:, at : at + block.shape[1]] = block
        at += block.shape[1]
        wide.append(own)
    return wide


def _left(weighing: Weighing, maps: Array) -> Left:
    """The columns of `Rows.left`."""
    signals, count = int(maps.shape[1]), len(maps)
    own = np.eye(signals) * weighing.scale[:, None]
    forces: list[Array] = []
    offsets: list[Array] = []
    at = 0
    for segment in weighing.segments:
        here = slice(at, at + len(segment.t))
        at = here.stop
        pushed, off = np.zeros((signals, count, 3)), np.zeros((signals, count, signals))
        pushed[:, here] = maps[here, :, :3].transpose(1, 0, 2)
        off[:, here] = own[:, None, :]
        forces.append(pushed.reshape(signals * count, 3))
        offsets.append(off.reshape(signals * count, signals))
    rests = [i for i, segment in enumerate(weighing.segments) if segment.at_rest]
    passes = [i for i, segment in enumerate(weighing.segments) if not segment.at_rest]
    pairs = _pairs(weighing.segments)
    both = {i for pair in pairs for i in pair}
    nothing = np.zeros((signals * count, 0))
    return Left(
        np.hstack([nothing, *(forces[i] for i in rests)]),
        np.hstack([nothing, *(forces[i] for i in passes)]),
        np.hstack([nothing, *(forces[i] + forces[j] for i, j in pairs)]),
        np.hstack([nothing, *(offsets[i] for i in passes)]),
        np.repeat([i in both for i in [*rests, *passes]], 3),
    )


def _since(found: Sequence[Segment], maps: Array) -> Array:
    """The columns of `Rows.since`."""
    signals, upward = int(maps.shape[1]), maps[:, :, FORCE_Z].T
    start = np.concatenate([np.full(len(segment.t), segment.start) for segment in found])
    columns: list[Array] = []
    for moment in sorted({segment.start for segment in found})[1:]:
        columns.append((upward * (start >= moment)).ravel())
    return np.array(columns).reshape(-1, signals * len(start)).T


def _pairs(found: Sequence[Segment]) -> list[tuple[int, int]]:
    """Each rest with the pass that begins at it."""
    pairs: list[tuple[int, int]] = []
    for i, rest in enumerate(found):
        for j, one in enumerate(found):
            begins = 0.0 < one.start - rest.end < tuning.PAUSE
            if rest.at_rest and not one.at_rest and begins:
                pairs.append((i, j))
    return pairs
