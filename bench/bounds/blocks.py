"""The Cramér-Rao bound of a recorded motion: block means, and the covariance of the unknowns.

Blocks are long enough that white noise averages out, and short enough that nothing moves far. Joint
torques are, block by block, linear in the unknowns: what is sought, and every error of the arm that
the noise model draws, each with its own size,

    y_j = sum_k H_jk theta_k + n_j          theta_k ~ N(0, sigma_k²),  n_j ~ N(0, C_j)

n is the white noise, drift and 1/f noise of joint j. The covariance of the unknowns given y,
(H^T C^-1 H + diag(sigma^-2))^-1, is the Cramér-Rao bound for those who know how large every error
may be (S. M. Kay, Fundamentals of Statistical Signal Processing I, 1993, sections 3.8 and 10.6;
H. L. Van Trees, Detection, Estimation, and Modulation Theory I, 1968, section 2.4.3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from palpate.common.pose import Array
from palpate.estimation.motion import Mask, acceleration
from palpate.estimation.wrench_observation import observe
from palpate.robots.simulated.noise.model import Torque
from palpate.robots.simulated.noise.sensors import PER_DECADE, WALK_TIME
from palpate.robots.simulated.timing import BLOCK as CYCLES
from palpate.trace.samples import Trace

BLOCK = 0.1
"""s."""
SMOOTH = 0.05
"""s over which accelerations are averaged."""


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Means of a trace over `BLOCK` s.

    Attributes:
        place: (rows,) index of each sample's block.
        rows: (n,) samples in each block.
        t: (n,) s.
        q, dq: (n, 7) rad, rad/s.
        position: (n, 3) m of the TCP, world.
        rotation: (n, 3, 3) the tool's axes in the world.
        acceleration: (n, 3) m/s² of the TCP, world.
        maps: (n, 7, 6) joint torques of unit wrenches, world axes about the TCP.
        turn: (3, 3) the base's axes in the world.
    """

    place: NDArray[np.intp]
    rows: Array
    t: Array
    q: Array
    dq: Array
    position: Array
    rotation: Array
    acceleration: Array
    maps: Array
    turn: Array

    def mean(self, signal: Array) -> Array:
        """Block means of a signal (rows, ...)."""
        sums = np.zeros((len(self.rows), *signal.shape[1:]))
        np.add.at(sums, self.place, signal)
        return sums / self.rows.reshape(-1, *[1] * (signal.ndim - 1))

    def all(self, mask: Mask) -> Mask:
        """Blocks of which every row is in the mask (rows,), (n,)."""
        return self.mean(mask.astype(float)) > 1.0 - 1e-9


def blocks(trace: Trace) -> Blocks | None:
    """Divide a trace into blocks; None for a trace without the arm's kinematics."""
    observed, samples = observe(trace), trace.samples
    if observed.chain is None:
        return None
    _, place = np.unique(((samples.t - samples.t[0]) / BLOCK).astype(int), return_inverse=True)
    rows = np.bincount(place).astype(float)
    middle = np.searchsorted(place, np.arange(len(rows))) + (rows // 2).astype(int)
    q = samples.q[middle]
    quaternions = samples.pose_world_tcp[middle, 3:]
    turns: Any = Rotation.from_quat(
        quaternions, scalar_first=True
    )  # scipy's stubs lack its methods
    return Blocks(
        place,
        rows,
        t=samples.t[middle],
        q=q,
        dq=samples.dq[middle],
        position=samples.pose_world_tcp[middle, :3],
        rotation=turns.as_matrix(),
        acceleration=acceleration(samples, SMOOTH)[middle],
        maps=observed.maps(q),
        turn=observed.turn,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """Torques of one unknown, (n, 7) N m a unit, and its prior standard deviation."""

    torque: Array
    size: float


def covariance(
    sought: Sequence[Column],
    errors: Sequence[Column],
    blocks: Blocks,
    counted: Mask,
    noise: Torque,
) -> Array:
    """Covariance (k, k) of the k unknowns `sought`, from the blocks in the mask `counted` (n,)."""
    columns = [*sought, *(error for error in errors if error.size > 0.0)]
    design = np.array([column.torque[counted] for column in columns])
    information = np.diag([column.size**-2.0 for column in columns])
    for joint, own in enumerate(_covariances(blocks, counted, noise)):
        white = np.linalg.solve(np.linalg.cholesky(own), design[:, :, joint].T)
        information += white.T @ white
    # Sizes span many powers of ten: scaled by each, the matrix is well conditioned.
    scale = 1.0 / np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    return inverse[: len(sought), : len(sought)].astype(np.float64)


def _covariances(blocks: Blocks, counted: Mask, noise: Torque) -> Sequence[Array]:
    """Covariances of each joint's noise in block means, (n, n) N² m²."""
    t, rows = blocks.t[counted], blocks.rows[counted]
    apart = BLOCK * np.round(np.abs(t[:, None] - t) / BLOCK)
    drift = _drift(noise.drift.time_constant, t, apart)
    low, high = noise.flicker.band
    corners = np.geomspace(low, high, max(2, math.ceil(PER_DECADE * math.log10(high / low)) + 1))
    step = math.log(corners[1] / corners[0])
    flicker = sum(step * _relaxing(2 * np.pi * corner, apart) for corner in corners.tolist())
    found: list[Array] = []
    for white, drifting, flickering in zip(
        noise.white.tolist(), noise.drift.size.tolist(), noise.flicker.level.tolist(), strict=True
    ):
        own = drifting**2 * drift + flickering**2 * flicker
        # A resolution finer than any sensor's keeps the matrix positive definite without noise.
        found.append(own + np.diag(white**2 / (rows * CYCLES) + 1e-12))
    return found


def _drift(time: float, t: Array, apart: Array) -> Array:
    """Covariance (n, n) of a drift of unit size: Ornstein-Uhlenbeck, or a random walk."""
    if math.isinf(time):
        return 2.0 / WALK_TIME * np.minimum(t[:, None], t)
    return _relaxing(1.0 / time, apart)


def _relaxing(rate: float, apart: Array) -> Array:
    """Covariance (n, n) of means over `BLOCK` s of an Ornstein-Uhlenbeck process of unit variance and
    `rate` 1/s."""
    x = rate * BLOCK
    within = 2.0 * (x + math.expm1(-x)) / x**2
    between = (math.sinh(x / 2.0) / (x / 2.0)) ** 2
    return np.where(apart < BLOCK / 2.0, within, between * np.exp(-rate * apart))
