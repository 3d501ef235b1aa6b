"""Equations of a weighing, and their covariance without the load."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.drag_causes import KIND_BIAS
from palpate.estimation.joint_causes import DRIFT, DRIFT_TIME, INERTIA_SHARE, UNSTEADY_SHARE
from palpate.estimation.joint_friction import FLOOR
from palpate.estimation.load_noise import flicker
from palpate.estimation.motion import Mask
from palpate.estimation.segments import BINS, PAUSE, Weighing

CENTRIFUGAL = 8.0
"""N s²/m² (1 sigma): force in proportion to the squared speed; equal motions compare best. Hardly sensitive."""
DEGREE = 3
"""degree of the polynomial along the path for the bias of one direction of travel. Sensitive: mass
0.2 σ."""
APPARENT_MASS = 10.0
"""kg (1 sigma): apparent vertical mass at the TCP of an arm with unknown links, wide enough for any
seven-axis arm. Sensitive: mass 0.1 σ."""
INERTIA_DEGREE = 1
"""degree of the polynomial along the path for the arm's apparent mass. Hardly sensitive."""
UNSTEADY = 0.15
"""kg (1 sigma): unknown force per acceleration, independent in each bin, where links are unknown.
It is some per cent of the arm's apparent mass. Not sensitive with steady passes."""
VISCOUS = 1.0
"""N s/m (1 sigma): force in proportion to the speed. Friction of 0.07 N m s/rad at a lever arm of
0.5 m is a third of it. Hardly sensitive."""
BIN_BIAS = 0.03
"""N (1 sigma): residual of the polynomial bias at one place of the path (gear ripple). Sensitive: mass 0.08 σ."""
REST_FRICTION = 0.1
"""N (1 sigma): friction that differs between rests after the same approach. Sensitive: mass 0.08 σ."""
FORCE_BIAS = 0.5
"""N (1 sigma): bias of an unreferenced force; Franka states 0.8 N relative accuracy. Hardly
sensitive; without a pass or rest of the empty hand it dominates the std of a mass."""


def covariance(weighing: Weighing, maps: Array) -> Array:
    """Compute the covariance (n, n) of all rows without the load.

    It holds white noise, biases, inertia of the arm, and drift.

    Args:
        maps: (bins, signals, 6) signals per unit wrench.
    """
    found = weighing.segments
    bins, signals = maps.shape[:2]
    variance = np.concatenate([segment.variance for segment in found])
    # Bias and drift, common to all signals in units of their scale.
    bias = bias_covariance(weighing)
    t = np.concatenate([segment.t for segment in found])
    between = np.abs(t[:, None] - t)
    # Ornstein-Uhlenbeck process.
    drift = DRIFT**2 * np.exp(-between / DRIFT_TIME)
    # Inertia of the links and residual of the arm's model, signal by signal.
    moved = inertia_covariance(weighing)
    spans = weighing.spans
    out = np.zeros((signals * bins, signals * bins))
    for i, scale in enumerate(weighing.scale.tolist()):
        block = scale**2 * (bias + drift) + weighing.noise.flicker[i] * flicker(between)
        # Mean with the empty hand, N m: it is the size of the bias of a wrongly configured end
        # effector. The contrast with the load does not depend on it.
        shown = [float(segment.observed[:, i].mean()) for segment in found if not segment.loaded]
        block += (float(np.mean(shown)) if shown else 0.0) ** 2
        block += moved[i]
        if weighing.left is not None:
            block += weighing.left.covariance(spans, i)
        block += np.diag(variance[:, i] + (FLOOR * scale) ** 2)
        out[i * bins : (i + 1) * bins, i * bins : (i + 1) * bins] = block
    return out


def _each(found: Weighing, name: str) -> Array:
    """Concatenate an attribute of all segments, bin after bin."""
    return np.concatenate([getattr(segment, name) for segment in found.segments])


def bias_covariance(weighing: Weighing) -> Array:
    """Compute the covariance (bins, bins), N², of the biases of one signal in units of its scale.

    The biases are a constant, residual stiction of each rest, and a part of each kind of segment: a function of the
    place on the path, and inertial and viscous effects of the motion.
    """
    found = weighing.segments
    # Kind, segment and type of each bin.
    kinds = np.concatenate([[segment.kind] * len(segment.t) for segment in found])
    own = np.concatenate([np.full(len(s.t), i) for i, s in enumerate(found)])
    at_rest = np.concatenate([np.full(len(s.t), float(s.at_rest)) for s in found])
    turning = np.concatenate([np.full(len(s.t), s.turns) for s in found])
    speed2, path, turned = (_each(weighing, name) for name in ("speed2", "path", "turned"))
    # Place from -1 to 1 along the path; for turns, along all turns.
    place = np.zeros(len(path))
    for rows, way in ((~turning, path), (turning, turned)):
        if rows.any():
            middle, half = _middle(way[rows])
            place[rows] = (way[rows] - middle) / half
    # Function of the place: a polynomial, plus local deviations with a triangular correlation.
    powers = np.power.outer(place, np.arange(DEGREE + 1))
    near = np.maximum(0.0, 1.0 - np.abs(place[:, None] - place) * BINS / 2.0)
    kind = KIND_BIAS**2 * (powers @ powers.T) + BIN_BIAS**2 * near
    # Effects of the speed: centrifugal by its square, viscous by the speed itself.
    kind += CENTRIFUGAL**2 * np.outer(speed2, speed2)
    kind += VISCOUS**2 * np.sqrt(np.outer(speed2, speed2))
    rests = REST_FRICTION**2 * np.outer(at_rest, at_rest) * (own[:, None] == own)
    return FORCE_BIAS**2 + kind * (kinds[:, None] == kinds) + rests


def _middle(path: Array) -> tuple[float, float]:
    """Middle of a path, m, and its half length, m."""
    low, high = float(path.min()), float(path.max())
    return (high + low) / 2.0, max((high - low) / 2.0, 1e-9)


def inertia_covariance(weighing: Weighing) -> Array:
    """Compute the covariance (signals, bins, bins) of the torque that moves the arm's own links."""
    motion = _each(weighing, "motion")
    if not motion.shape[1]:
        # Unknown links: an apparent mass at the TCP that varies along the path, (bins, bins) N².
        path, acceleration = _each(weighing, "path"), _each(weighing, "acceleration")
        middle, half = _middle(path)
        powers = np.power.outer((path - middle) / half, np.arange(INERTIA_DEGREE + 1))
        inertia = acceleration[:, None] * powers
        force: Array = APPARENT_MASS**2 * (inertia @ inertia.T)
        force = force + np.diag((UNSTEADY * acceleration) ** 2)
        return weighing.scale[:, None, None] ** 2 * force
    # Known links: an error in proportion to their torque, common to all bins and bin by bin.
    out: list[Array] = []
    for taken in motion.T:
        block = INERTIA_SHARE**2 * np.outer(taken, taken)
        out.append(block + np.diag((UNSTEADY_SHARE * taken) ** 2))
    return np.array(out)


# Equations of a weighing.


FORCE_Z, TORQUE_X, TORQUE_Y, TORQUE_Z = 2, 3, 4, 5
"""Indices of the components of a wrench."""
LEANING = (0, 1)
"""Components of a weight where gravity is tilted."""
SIDEWAYS = (0, 1, 5)
"""Components that are zero for a freely hanging object."""
WAYS = {"up": 1.0, "down": -1.0}


class ResidualStiction(NamedTuple):
    """Columns of the joint torque that remains after an approach."""

    stuck: Array  # (n, 3 rests) signals per newton at the TCP along each axis, in each rest
    forces: Array  # (n, 3 passes) the same in each pass
    carried: Array  # (n, 3 pairs) the same in a rest and the pass that begins at it
    offsets: Array  # (n, m passes) an offset of each signal in each pass
    paired: Mask  # (3 rests + 3 passes,) columns of `stuck` and `forces` that belong to such a pair

    @property
    def columns(self) -> tuple[Array, Array, Array, Array]:
        """The four groups of columns."""
        return self.stuck, self.forces, self.carried, self.offsets


@dataclass(frozen=True, slots=True, eq=False)
class WeighingRows:
    """Linear equations of a weighing, ordered by signal, then by bin."""

    observed: Array  # (n,) the signals
    root: Array  # (n, n) lower Cholesky factor of their covariance without the load
    wrench: Array  # (n, 6) signals per unit of each component of the load's wrench
    grasp: Array  # (n,) s, of the segment
    height: Array  # (n,) m along the path, about the mean of the loaded rows
    way: Array  # (n,) 1 up, -1 down, 0 at rest
    rest: Array  # (n,) 1 at rest
    # (n, p) signals per unit of friction level in each joint, and per unit of its initial state (`joint_friction`).
    dahl: Array
    # Columns of the torque that remains after an approach, per rest and pass.
    stiction: ResidualStiction
    # (n, k) signals per newton upward at the TCP, for a step that begins with the second segment in
    # time, the third, and so on.
    since: Array
    signal: NDArray[np.intp]  # (n,) index of the signal of a row
    freedom: float  # degrees of freedom of the noise


def equations(weighing: Weighing, gravity: float) -> WeighingRows:
    """Set up the equations of a weighing."""
    found = weighing.segments
    # The weight of the load, and its inertial force under vertical acceleration.
    loaded = np.concatenate([s.loaded * (1.0 + s.acceleration / gravity) for s in found])
    maps = np.concatenate([segment.maps for segment in found])
    path = np.concatenate([segment.path for segment in found])
    signals = int(maps.shape[1])
    # Cholesky factor of the covariance without the load.
    root: Array = np.linalg.cholesky(covariance(weighing, maps)).astype(np.float64)

    def each(values: Iterable[float]) -> Array:
        """Repeat a number of each segment in all its rows."""
        pairs = zip(found, values, strict=True)
        return np.tile(np.concatenate([np.full(len(s.t), v) for s, v in pairs]), signals)

    # Friction of a joint acts on its own signal only: (signals x bins, 2 joints).
    states = np.concatenate([segment.dahl for segment in found])
    bins, joints, kinds = states.shape
    dahl = np.zeros((joints or signals, bins, joints, kinds))
    for joint in range(joints):
        dahl[joint, :, joint] = states[:, joint]
    # Upward force steps that begin with the second segment in time, the third, and so on.
    upward = maps[:, :, FORCE_Z].T
    start = np.concatenate([np.full(len(segment.t), segment.start) for segment in found])
    steps: list[Array] = []
    for moment in sorted({segment.start for segment in found})[1:]:
        steps.append((upward * (start >= moment)).ravel())
    return WeighingRows(
        observed=np.concatenate([segment.observed for segment in found]).T.ravel(),
        root=root,
        wrench=(maps * loaded[:, None, None]).transpose(1, 0, 2).reshape(-1, 6),
        grasp=each(segment.grasp for segment in found),
        height=np.tile(path - path[loaded != 0.0].mean(), signals),
        way=each(WAYS.get(segment.kind, 0.0) for segment in found),
        rest=each(float(segment.at_rest) for segment in found),
        dahl=dahl.reshape(signals * bins, joints * kinds),
        stiction=residual_stiction(weighing, maps),
        since=np.array(steps).reshape(-1, signals * len(start)).T,
        signal=np.repeat(np.arange(signals), len(path)),
        freedom=weighing.freedom,
    )


def in_each(row: WeighingRows, grasps: Sequence[float], components: Sequence[int]) -> Array:
    """Split `components` of the wrench into columns of each grasp: (n, grasps x components)."""
    columns = [row.wrench[:, components] * (row.grasp == grasp)[:, None] for grasp in grasps]
    return np.concatenate(columns, axis=1)


def each_its_own(blocks: Sequence[Array]) -> list[Array]:
    """Place the columns of each weighing side by side, with zeros in the rows of the others."""
    width = sum(block.shape[1] for block in blocks)
    wide: list[Array] = []
    at = 0
    for block in blocks:
        own = np.zeros((len(block), width))
        own[:, at : at + block.shape[1]] = block
        at += block.shape[1]
        wide.append(own)
    return wide


def residual_stiction(weighing: Weighing, maps: Array) -> ResidualStiction:
    """Build the columns of the residual stiction, segment by segment."""
    found, signals, count = weighing.segments, int(maps.shape[1]), len(maps)
    own = np.eye(signals) * weighing.scale[:, None]
    # A force at the TCP, and an offset of each signal, in the rows of one segment.
    forces: list[Array] = []
    offsets: list[Array] = []
    at = 0
    for segment in found:
        here = slice(at, at + len(segment.t))
        at = here.stop
        pushed, off = np.zeros((signals, count, 3)), np.zeros((signals, count, signals))
        pushed[:, here] = maps[here, :, :3].transpose(1, 0, 2)
        off[:, here] = own[:, None, :]
        forces.append(pushed.reshape(signals * count, 3))
        offsets.append(off.reshape(signals * count, signals))
    rests = [i for i, segment in enumerate(found) if segment.at_rest]
    passes = [i for i, segment in enumerate(found) if not segment.at_rest]
    # Pair each rest with the pass that begins at it.
    pairs = [(i, j) for i in rests for j in passes if 0.0 < found[j].start - found[i].end < PAUSE]
    both = {i for pair in pairs for i in pair}
    nothing = np.zeros((signals * count, 0))
    return ResidualStiction(
        np.hstack([nothing, *(forces[i] for i in rests)]),
        np.hstack([nothing, *(forces[i] for i in passes)]),
        np.hstack([nothing, *(forces[i] + forces[j] for i, j in pairs)]),
        np.hstack([nothing, *(offsets[i] for i in passes)]),
        np.repeat([i in both for i in [*rests, *passes]], 3),
    )
