"""Errors of joint torques in the frequency domain: offset, friction, drift and ripple."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.arm_motion import PRESLIDINGS, SpectralNoise
from palpate.estimation.joint_causes import per_joint
from palpate.estimation.joint_friction import dahl, turned_round
from palpate.estimation.regression import Cause, fit
from palpate.estimation.rigid_bodies import load_torques, own_motion
from palpate.trace.recording import ArmLog, Chain
from palpate.trace.samples import STANDARD_GRAVITY

SURE = 1.96  # standard deviations of a 95 % interval


@dataclass(frozen=True, slots=True, eq=False)
class FigureInterval:
    """Quantity of each joint with its 95 % interval; NaN where the recording does not show it."""

    value: Array  # (7,)
    low: Array
    high: Array

    @classmethod
    def unseen(cls) -> FigureInterval:
        """Quantity that no joint shows."""
        return cls(*(np.full(7, np.nan) for _ in range(3)))

    @classmethod
    def about(
        cls, value: Array, std: Array, seen: NDArray[np.bool_] | bool = True
    ) -> FigureInterval:
        """Values with normal errors, for the joints in `seen`."""
        value, std = np.where(seen, value, np.nan), np.where(seen, std, np.nan)
        return cls(value, value - SURE * std, value + SURE * std)

    def where(self, seen: NDArray[np.bool_]) -> FigureInterval:
        """Copy restricted to the joints in `seen`."""
        return FigureInterval(
            *(np.where(seen, x, np.nan) for x in (self.value, self.low, self.high))
        )


# Signals of a recording on a uniform clock, and in a frequency band


def resample(t: Array, values: Array, rate: float) -> tuple[Array, Array]:
    """Average a signal (n, k) over the periods of a uniform clock of `rate` Hz.

    Returns the middle times (m,) and the means (m, k).
    """
    # Differences of the trapezoidal integral between the edges are exact means.
    edges = np.arange(t[0], t[-1], 1.0 / rate)
    area = np.zeros(values.shape)  # of the signal, up to each sample
    area[1:] = np.cumsum((values[1:] + values[:-1]) * (np.diff(t)[:, None] / 2), axis=0)
    means = np.empty((len(edges) - 1, values.shape[1]))
    for k in range(values.shape[1]):
        means[:, k] = np.diff(np.interp(edges, t, area[:, k])) * rate
    return (edges[1:] + edges[:-1]) / 2, means


def filter_band(values: Array, rate: float, low: float | None, high: float) -> Array:
    """Zero-phase band-pass of a signal (n, ...) at `rate` Hz from `low` to `high` Hz; low-pass if `low` is None."""
    from scipy.signal import butter, sosfiltfilt  # takes longer to load than most plans to make

    below = sosfiltfilt(butter(4, high, fs=rate, output="sos"), values, axis=0)
    return (
        below
        if low is None
        else below - sosfiltfilt(butter(4, low, fs=rate, output="sos"), below, axis=0)
    )


# Errors of the joint torques in slow motion: offset, friction, drift, and the residual


DOWN: Array = np.array([0.0, 0.0, -STANDARD_GRAVITY])
SLOW = 5.0  # Hz: the torques are fitted below
SLOW_RATE = 100.0  # Hz of the fit
PRESLIDING: Array = np.geomspace(2e-4, 2e-2, 21)  # rad
USUAL = 2e-3  # rad, where the recording does not show it
WIDE = 1.0  # rad, range of a joint that shows how its friction varies over a turn
STRETCH = 1.0  # s: stretches of a residual that count as independent of each other
ANYTHING = 1e3  # N m (1 sigma): uninformative prior of a joint's coefficients
LOAD: Array = np.array([0.3, 0.03, 0.03, 0.03])
"""Standard deviations of a load beyond the nominal hand: kg, and kg m along each axis of the hand."""


@dataclass(frozen=True, slots=True, eq=False)
class JointFits:
    """Least-squares fit of k columns per joint, and of a load common to all joints."""

    value: Array  # (k, 7)
    std: Array  # (k, 7), of a residual that is correlated within `STRETCH`
    load: Array  # (4,)
    residual: Array  # (n, 7)
    independent: Array  # (7,) independent samples among the residual's

    @classmethod
    def of(cls, y: Array, columns: list[Array], load: Array, t: Array) -> JointFits:
        """Fit `columns`, k of (n, 7), and the load's (n, 7, 4), to `y` (n, 7) sampled at times `t` (n,)."""
        n, k = len(y), len(columns)
        joints = Cause.build("joints", per_joint(*columns), ANYTHING)
        causes = [joints, Cause.build("load", load, LOAD)]
        # Two weighted solutions: the second with the residual size of each joint.
        size = fit(causes, SpectralNoise(np.ones(y.size), y.size), y.ravel()).residual
        size = size.reshape(y.shape).std(0) + 1e-9
        posterior = fit(causes, SpectralNoise(np.tile(size, n), y.size), y.ravel())
        found, inverse = posterior.mean, posterior.covariance
        # Robust (sandwich) covariance over stretches, for a residual correlated within them.
        stretch = ((t - t[0]) / STRETCH).astype(int)
        starts = np.flatnonzero(np.diff(stretch, prepend=-1))
        residual = posterior.residual.reshape(y.shape) * size
        scores = (posterior.model.design * posterior.residual[:, None]).reshape(n, 7, -1).sum(1)
        summed = np.add.reduceat(scores, starts)
        means = np.add.reduceat(residual, starts)
        alike = np.maximum(
            (means**2).sum(0) / (residual**2).sum(0), 1.0
        )  # samples that count as one
        # Over few stretches, both estimates scatter: take the larger variance.
        white = np.diag(inverse)[: 7 * k].reshape(k, 7) * alike
        summed = np.diag(inverse @ summed.T @ summed @ inverse)[: 7 * k].reshape(k, 7)
        std = np.sqrt(np.maximum(white, summed))
        return cls(found[: 7 * k].reshape(k, 7), std, found[7 * k :], residual, n / alike)


def slow_torque(log: ArmLog, chain: Chain) -> dict[str, FigureInterval]:
    """Measure offset, Coulomb friction, presliding, drift, and the residual of a slow motion."""
    # Uniform clock, and the torque without that of the described arm, below `SLOW`.
    rate = min(SLOW_RATE, 1.0 / float(np.median(np.diff(log.t))))
    (t, q), dq = resample(log.t, log.q, rate), resample(log.t, log.dq, rate)[1]
    tau = resample(log.t, log.tau, rate)[1]
    dq = filter_band(dq, rate, None, SLOW)
    motion = q, dq, np.gradient(dq, 1.0 / rate, axis=0), DOWN
    y = filter_band(tau - own_motion(chain, *motion), rate, None, SLOW)
    load = filter_band(load_torques(chain, *motion)[:, :, :4], rate, None, SLOW)
    # Friction curves of unit level for each candidate presliding distance.
    steps = np.diff(q, axis=0, prepend=q[:1])
    curves = filter_band(dahl(steps, PRESLIDING)[0], rate, None, SLOW)
    turns = turned_round(dahl(steps, np.array(PRESLIDINGS[-1:]))[0][:, :, 0])
    level, presliding = np.ones_like(y), FigureInterval.unseen()
    fit, rubbing = JointFits.of(y, [level], load, t), np.zeros_like(y)
    # Alternate between the fit and the presliding distance, as each depends on the other.
    for _ in range(3):
        told = np.where(np.isnan(presliding.value), USUAL, presliding.value)
        rubbing = filter_band(dahl(steps, told[:, None])[0][:, :, 0], rate, None, SLOW) * turns
        fit = JointFits.of(y, [level, rubbing], load, t)
        free = y - load @ fit.load
        misfits = np.array([misfit(free[:, j], curves[:, j]) for j in range(7)])
        presliding = distances(misfits, fit.independent)
    # Friction is significant only where a joint reverses; drift is the slope of the residual.
    slid = turns & (fit.value[1] > SURE * fit.std[1])
    rms = fit.residual.std(0)
    minutes = (t - t.mean())[:, None] / 60.0 * level
    drift = JointFits.of(fit.residual, [level, minutes], np.zeros_like(load), t)
    return {
        "offset": FigureInterval.about(fit.value[0], fit.std[0]),
        "coulomb": FigureInterval.about(fit.value[1], fit.std[1], slid),
        "presliding": presliding.where(slid),
        "position": variation(
            JointFits.of(y, [level, rubbing, rubbing * np.sin(q), rubbing * np.cos(q)], load, t)
        ).where(slid & (np.ptp(q, axis=0) > WIDE)),
        "residual": FigureInterval.about(rms, rms / np.sqrt(2.0 * fit.independent)),
        "drift": FigureInterval.about(drift.value[1], drift.std[1]),
    }


def misfit(y: Array, curves: Array) -> Array:
    """Mean squares (g,) of the residuals of `y` (n,) after fitting an offset and each of `curves` (n, g)."""
    y, curves = y - y.mean(), curves - curves.mean(0)
    return ((y @ y) - (curves.T @ y) ** 2 / np.maximum((curves**2).sum(0), 1e-12)) / len(y)


def distances(misfits: Array, independent: Array) -> FigureInterval:
    """Presliding distances, rad, with the smallest of `misfits` (7, g), and the range that fits nearly as well.

    Not seen where the range reaches an end of the grid.
    """
    alike = misfits < misfits.min(1)[:, None] * (1.0 + SURE**2 / independent[:, None])
    first, last = alike.argmax(1), alike.shape[1] - 1 - alike[:, ::-1].argmax(1)
    told: NDArray[np.bool_] = (first > 0) & (last < len(PRESLIDING) - 1)
    return FigureInterval(*(PRESLIDING[i] for i in (misfits.argmin(1), first, last))).where(told)


def variation(fit: JointFits) -> FigureInterval:
    """Relative variation of the friction over a turn (root mean square), corrected for noise."""
    level = np.maximum(fit.value[1], 1e-9)
    size, std = (np.sqrt((each[2:] ** 2).sum(0) / 2) / level for each in (fit.value, fit.std))
    less = np.sqrt(np.maximum(size**2 - std**2, 0.0))
    return FigureInterval(less, np.maximum(size - SURE * std, 0.0), size + SURE * std)


# Errors of the joint torques in fast motion: gear ripple, and shaking


RIPPLE_RATE = 250.0  # Hz, to which a recording is resampled
LEAST = 100.0  # Hz, slowest recording that shows ripple
ABOVE = 6.0  # Hz
SHAKING = (8.0, 30.0)  # Hz
SMOOTH = 60.0  # Hz: accelerations are differences of velocities below
ORDERS: Array = np.arange(20.0, 740.0, 4.0)  # cycles per turn
BASE, BASE_WITHIN = 220.0, 120.0  # cycles of the first harmonic
COHERENT = 0.2  # rad of one-way motion in which a ripple keeps its phase
SLOWEST = 0.15  # rad/s: a ripple's frequency is beyond `ABOVE`
FEWEST, FEWEST_ROWS = 3, 16  # pieces of motion, and samples of each
SMALLEST = 0.002  # N m, root mean square of a ripple: no joint torque sensor resolves less
CLEAR, STAYS = 5.0, 1.5  # power of a ripple over its neighbours', and of what M ddq leaves of it
ABOUT = 9.0  # cycles, within which a harmonic is looked for
NEAR = (40.0, 120.0)  # orders between which they lie from it


def ripple(log: ArmLog, chain: Chain) -> dict[str, FigureInterval]:
    """Measure ripple of torques and encoders, and the shaking that M ddq explains."""
    names = ("ripple", "second", "cycles", "encoder_ripple", "shaking", "shaking_left")
    rate = min(RIPPLE_RATE, 1.0 / float(np.median(np.diff(log.t))))
    if rate < LEAST:
        return {name: FigureInterval.unseen() for name in names}
    # Gravity and inertial torques of the described arm on a uniform clock.
    q, dq, tau = (resample(log.t, values, rate)[1] for values in (log.q, log.dq, log.tau))
    ddq = np.gradient(filter_band(dq, rate, None, min(SMOOTH, rate / 3)), 1.0 / rate, axis=0)
    still = np.zeros_like(q)
    held, moved = own_motion(chain, q, still, still, DOWN), own_motion(chain, q, dq, ddq)
    seconds = len(q) / rate
    # Shaking: torque in its band, with and without M ddq.
    torque, drawn = (filter_band(x, rate, *SHAKING) for x in (tau - held, moved))
    shaking, left = (
        FigureInterval.about(x.std(0), x.std(0) / np.sqrt(2 * seconds))
        for x in (torque, torque - drawn)
    )
    # Ripple of each joint in the signals above `ABOVE`.
    smooth = filter_band(dq, rate, None, ABOVE)
    quick = [x - filter_band(x, rate, None, ABOVE) for x in (tau - held, tau - held - moved, dq)]
    joints = [_joint(q[:, j], smooth[:, j], *(x[:, j] for x in quick)) for j in range(7)]
    found = [FigureInterval(*np.array([joint[i] for joint in joints]).T) for i in range(4)]
    return dict(zip(names, [*found, shaking, left], strict=True))


def _joint(q: Array, smooth: Array, torque: Array, left: Array, rate: Array) -> list[list[float]]:
    """Find the ripple of one joint.

    Returns value and interval of the two harmonics, N m, of the cycles, and of the first encoder harmonic, rad. The
    ripple must remain in `left` (n,), the torque without M ddq.
    """
    # Spectra over the angle for each piece of one-way motion; keep orders that M ddq does not explain.
    runs = one_way(q, smooth)
    unseen = [np.nan, np.nan, np.nan]
    if len(runs) < FEWEST:
        return [unseen] * 4
    torques = np.array([amplitudes(q[run], torque[run]) for run in runs])  # (runs, orders)
    moved = np.array([amplitudes(q[run], rate[run] / smooth[run]) for run in runs]) / ORDERS
    clear = prominence(torques)
    clear[prominence(np.array([amplitudes(q[run], left[run]) for run in runs])) < STAYS] = 0.0
    # First harmonic: the most prominent order near `BASE`, or its half if that is prominent as well.
    based = np.abs(ORDERS - BASE) <= BASE_WITHIN
    first = int(np.where(based, clear, 0.0).argmax())
    below = peak(clear, ORDERS[first] / 2)
    if based[below] and clear[below] > CLEAR:
        first = below
    size = _size(torques[:, first])
    if clear[first] < CLEAR or size[1] <= 0 or size[0] < SMALLEST:
        return [unseen] * 4
    # Second harmonic, and the resolution of the order by the length of the pieces.
    second = peak(clear, 2 * ORDERS[first])
    half = 2 * np.pi / float(np.median([np.ptp(q[run]) for run in runs])) / np.sqrt(len(runs))
    cycles = float(ORDERS[first])
    return [
        size,
        _size(torques[:, second]) if clear[second] > CLEAR else unseen,
        [cycles, cycles - half, cycles + half],
        _size(moved[:, first]) if prominence(moved)[first] > CLEAR else unseen,
    ]


def peak(clear: Array, order: float) -> int:
    """Index of the largest of `clear` (orders,) near an order."""
    near = np.abs(ORDERS - order) < ABOUT
    return int(np.where(near, clear, -1.0).argmax())


def one_way(q: Array, smooth: Array) -> list[slice]:
    """Cut a motion into pieces of `COHERENT` rad in one direction."""
    way = np.where(np.abs(smooth) > SLOWEST, np.sign(smooth), 0.0)
    turns = np.flatnonzero(np.diff(way, prepend=np.nan, append=np.nan))
    found: list[slice] = []
    for first, last in pairwise(turns.tolist()):
        pieces = int(abs(q[last - 1] - q[first]) / COHERENT) if way[first] else 0
        if pieces:
            goals = q[first] + (q[last - 1] - q[first]) * np.arange(pieces + 1) / pieces
            cuts = np.abs(q[first:last, None] - goals).argmin(0).tolist()
            found += [slice(first + a, first + b) for a, b in pairwise(cuts) if b - a > FEWEST_ROWS]
    return found


def amplitudes(q: Array, values: Array) -> Array:
    """Root mean squares of the waves of all `ORDERS` in values (n,) over angles (n,)."""
    window = np.hanning(len(q))
    window /= window.sum()
    return np.sqrt(2.0) * np.abs((window * values) @ np.exp(-1j * np.outer(q, ORDERS)))


def prominence(sizes: Array) -> Array:
    """Prominence (orders,) of sizes (runs, orders).

    It is the mean power of each order over the larger median of its neighbours on either side.
    """
    power = (sizes**2).mean(0)
    clear = np.zeros_like(power)
    for i, order in enumerate(ORDERS):
        sides = (order - ORDERS, ORDERS - order)
        near = [power[(NEAR[0] < away) & (away < NEAR[1])] for away in sides]
        if min(map(len, near)) >= FEWEST_ROWS / 2:
            clear[i] = power[i] / max(float(np.median(side)) for side in near)
    return clear


def _size(sizes: Array) -> list[float]:
    """Root mean square over pieces of a motion, with its interval."""
    power = sizes**2
    value = float(np.sqrt(power.mean()))
    half = SURE * float(power.std(ddof=1)) / np.sqrt(len(sizes)) / (2 * value)
    return [value, value - half, value + half]
