"""Errors of the joint torques that a slow motion shows: offset, friction, drift, and what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.joint_friction import dahl, turned_round
from palpate.estimation.load.chain import load_torques, own_motion
from palpate.geometry.pose import Array
from palpate.logs.figure import SURE, Figure
from palpate.logs.sampling import banded, resampled
from palpate.trace.log import ArmLog
from palpate.trace.recording import Chain
from palpate.trace.samples import STANDARD_GRAVITY

DOWN: Array = np.array([0.0, 0.0, -STANDARD_GRAVITY])
SLOW = 5.0  # Hz: the torques are fitted below
RATE = 100.0  # Hz of the fit
PRESLIDING: Array = np.geomspace(2e-4, 2e-2, 21)  # rad
USUAL = 2e-3  # rad, where the recording does not tell
WIDE = 1.0  # rad, range of a joint that shows how its friction varies over a turn
STRETCH = 1.0  # s: stretches of a residual that count as independent of each other
LOAD: Array = np.array([0.3, 0.03, 0.03, 0.03])
"""Standard deviations of a load beyond the nominal hand: kg, kg m along each axis of the hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Least squares of k columns a joint, and of a load that all joints bear."""

    value: Array  # (k, 7)
    std: Array  # (k, 7), of a residual that is correlated within `STRETCH`
    load: Array  # (4,)
    residual: Array  # (n, 7)
    independent: Array  # (7,) independent samples among the residual's

    @classmethod
    def of(cls, y: Array, columns: list[Array], load: Array, t: Array) -> Fit:
        """Fit `columns`, k of (n, 7), and the load's (n, 7, 4) to `y` (n, 7), sampled at `t` (n,)."""
        n, k = len(y), len(columns)
        design = np.zeros((n, 7, 7 * k + 4))
        for joint in range(7):
            for i, column in enumerate(columns):
                design[:, joint, 7 * i + joint] = column[:, joint]
        design[:, :, 7 * k :] = load
        ridge = np.zeros(7 * k + 4)
        ridge[7 * k :] = 1.0 / LOAD**2
        stretch = ((t - t[0]) / STRETCH).astype(int)
        starts = np.flatnonzero(np.diff(stretch, prepend=-1))
        found, inverse = _solved(design, y, np.ones(7), ridge)
        size = (y - design @ found).std(0) + 1e-9
        found, inverse = _solved(design, y, size, ridge)
        residual = y - design @ found
        scores = (design / size[:, None] * (residual / size)[:, :, None]).sum(1)
        summed = np.add.reduceat(scores, starts)
        means = np.add.reduceat(residual, starts)
        alike = np.maximum(
            (means**2).sum(0) / (residual**2).sum(0), 1.0
        )  # samples that count as one
        # Sums over few stretches are too small as often as too large: the larger of two estimates.
        white = np.diag(inverse)[: 7 * k].reshape(k, 7) * alike
        summed = np.diag(inverse @ summed.T @ summed @ inverse)[: 7 * k].reshape(k, 7)
        std = np.sqrt(np.maximum(white, summed))
        return cls(
            found[: 7 * k].reshape(k, 7),
            std,
            found[7 * k :],
            residual,
            n / alike,
        )


def _solved(design: Array, y: Array, size: Array, ridge: Array) -> tuple[Array, Array]:
    """Solve the normal equations, each joint's rows over `size` (7,); return the inverse, too."""
    x = (design / size[:, None]).reshape(-1, design.shape[2])
    inverse = np.asarray(np.linalg.pinv(x.T @ x + np.diag(ridge), hermitian=True), dtype=np.float64)
    return inverse @ (x.T @ (y / size).ravel()), inverse


def slow_torque(log: ArmLog, chain: Chain) -> dict[str, Figure]:
    """Measure offset, Coulomb friction, presliding, drift, and what they leave."""
    rate = min(RATE, 1.0 / float(np.median(np.diff(log.t))))
    (t, q), dq = resampled(log.t, log.q, rate), resampled(log.t, log.dq, rate)[1]
    tau = resampled(log.t, log.tau, rate)[1]
    dq = banded(dq, rate, None, SLOW)
    motion = q, dq, np.gradient(dq, 1.0 / rate, axis=0), DOWN
    y = banded(tau - own_motion(chain, *motion), rate, None, SLOW)
    load = banded(load_torques(chain, *motion)[:, :, :4], rate, None, SLOW)
    steps = np.diff(q, axis=0, prepend=q[:1])
    curves = banded(dahl(steps, PRESLIDING)[0], rate, None, SLOW)
    turns = turned_round(dahl(steps, np.array(tuning.PRESLIDINGS[-1:]))[0][:, :, 0])
    level, presliding = np.ones_like(y), Figure.unseen()
    fit, rubbing = Fit.of(y, [level], load, t), np.zeros_like(y)
    for _ in range(3):
        told = np.where(np.isnan(presliding.value), USUAL, presliding.value)
        rubbing = banded(dahl(steps, told[:, None])[0][:, :, 0], rate, None, SLOW) * turns
        fit = Fit.of(y, [level, rubbing], load, t)
        free = y - load @ fit.load
        misfits = np.array([misfit(free[:, j], curves[:, j]) for j in range(7)])
        presliding = distances(misfits, fit.independent)
    slid = turns & (fit.value[1] > SURE * fit.std[1])
    rms = fit.residual.std(0)
    minutes = (t - t.mean())[:, None] / 60.0 * level
    drift = Fit.of(fit.residual, [level, minutes], np.zeros_like(load), t)
    return {
        "offset": Figure.about(fit.value[0], fit.std[0]),
        "coulomb": Figure.about(fit.value[1], fit.std[1], slid),
        "presliding": presliding.where(slid),
        "position": variation(
            Fit.of(y, [level, rubbing, rubbing * np.sin(q), rubbing * np.cos(q)], load, t)
        ).where(slid & (np.ptp(q, axis=0) > WIDE)),
        "residual": Figure.about(rms, rms / np.sqrt(2.0 * fit.independent)),
        "drift": Figure.about(drift.value[1], drift.std[1]),
    }


def misfit(y: Array, curves: Array) -> Array:
    """Compute the mean square (g,) that an offset and each of `curves` (n, g) leave of `y` (n,)."""
    y, curves = y - y.mean(), curves - curves.mean(0)
    return ((y @ y) - (curves.T @ y) ** 2 / np.maximum((curves**2).sum(0), 1e-12)) / len(y)


def distances(misfits: Array, independent: Array) -> Figure:
    """Return the presliding distances, rad, with the least of `misfits` (7, g), and those that fit
    nearly as well; not seen where no end is shown."""
    alike = misfits < misfits.min(1)[:, None] * (1.0 + SURE**2 / independent[:, None])
    first, last = alike.argmax(1), alike.shape[1] - 1 - alike[:, ::-1].argmax(1)
    told: NDArray[np.bool_] = (first > 0) & (last < len(PRESLIDING) - 1)
    return Figure(*(PRESLIDING[i] for i in (misfits.argmin(1), first, last))).where(told)


def variation(fit: Fit) -> Figure:
    """Return the friction's relative variation over a turn, its root mean square; noise is taken
    off."""
    size = np.sqrt((fit.value[2:] ** 2).sum(0) / 2) / fit.value[1]
    std = np.sqrt((fit.std[2:] ** 2).sum(0) / 2) / fit.value[1]
    less = np.sqrt(np.maximum(size**2 - std**2, 0.0))
    return Figure(less, np.maximum(size - SURE * std, 0.0), size + SURE * std)
