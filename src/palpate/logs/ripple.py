"""Errors of the joint torques that a quick motion shows: ripple of the gears, and shaking."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from palpate.estimation.load.chain import own_motion
from palpate.geometry.pose import Array
from palpate.logs.figure import SURE, Figure
from palpate.logs.sampling import banded, resampled
from palpate.logs.slow_torque import DOWN
from palpate.trace.log import ArmLog
from palpate.trace.recording import Chain

RATE = 250.0  # Hz, to which a recording is resampled
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


def ripple(log: ArmLog, chain: Chain) -> dict[str, Figure]:
    """Measure ripple of torques and encoders, and the shaking that M ddq explains."""
    names = ("ripple", "second", "cycles", "encoder_ripple", "shaking", "shaking_left")
    rate = min(RATE, 1.0 / float(np.median(np.diff(log.t))))
    if rate < LEAST:
        return {name: Figure.unseen() for name in names}
    q, dq, tau = (resampled(log.t, values, rate)[1] for values in (log.q, log.dq, log.tau))
    ddq = np.gradient(banded(dq, rate, None, min(SMOOTH, rate / 3)), 1.0 / rate, axis=0)
    still = np.zeros_like(q)
    held, moved = own_motion(chain, q, still, still, DOWN), own_motion(chain, q, dq, ddq)
    seconds = len(q) / rate
    torque, drawn = (banded(x, rate, *SHAKING) for x in (tau - held, moved))
    shaking, left = (
        Figure.about(x.std(0), x.std(0) / np.sqrt(2 * seconds)) for x in (torque, torque - drawn)
    )
    smooth = banded(dq, rate, None, ABOVE)
    quick = [x - banded(x, rate, None, ABOVE) for x in (tau - held, tau - held - moved, dq)]
    joints = [_joint(q[:, j], smooth[:, j], *(x[:, j] for x in quick)) for j in range(7)]
    found = [Figure(*np.array([joint[i] for joint in joints]).T) for i in range(4)]
    return dict(zip(names, [*found, shaking, left], strict=True))


def _joint(q: Array, smooth: Array, torque: Array, left: Array, rate: Array) -> list[list[float]]:
    """Find the ripple of one joint: value and interval of its two harmonics, N m, of its cycles, and
    of its first harmonic in the encoder, rad. What M ddq explains is none: `left` (n,) is without it.
    """
    runs = one_way(q, smooth)
    unseen = [np.nan, np.nan, np.nan]
    if len(runs) < FEWEST:
        return [unseen] * 4
    torques = np.array([amplitudes(q[run], torque[run]) for run in runs])  # (runs, orders)
    moved = np.array([amplitudes(q[run], rate[run] / smooth[run]) for run in runs]) / ORDERS
    clear = prominence(torques)
    clear[prominence(np.array([amplitudes(q[run], left[run]) for run in runs])) < STAYS] = 0.0
    based = np.abs(ORDERS - BASE) <= BASE_WITHIN
    first = int(np.where(based, clear, 0.0).argmax())
    below = peak(clear, ORDERS[first] / 2)
    if based[below] and clear[below] > CLEAR:
        first = below
    size = _size(torques[:, first])
    if clear[first] < CLEAR or size[1] <= 0 or size[0] < SMALLEST:
        return [unseen] * 4
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
    """Return the index of the largest of `clear` (orders,) about an order."""
    near = np.abs(ORDERS - order) < ABOUT
    return int(np.where(near, clear, -1.0).argmax())


def one_way(q: Array, smooth: Array) -> list[slice]:
    """Cut a motion into pieces of `COHERENT` rad one way."""
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
    """Compute the root mean squares of the waves of all `ORDERS` in values (n,) at angles (n,)."""
    window = np.hanning(len(q))
    window /= window.sum()
    return np.sqrt(2.0) * np.abs((window * values) @ np.exp(-1j * np.outer(q, ORDERS)))


def prominence(sizes: Array) -> Array:
    """Compute the mean power of each order over the larger median of its neighbours on either side:
    (orders,) of (runs, orders)."""
    power = (sizes**2).mean(0)
    clear = np.zeros_like(power)
    for i, order in enumerate(ORDERS):
        sides = (order - ORDERS, ORDERS - order)
        near = [power[(NEAR[0] < away) & (away < NEAR[1])] for away in sides]
        if min(map(len, near)) >= FEWEST_ROWS / 2:
            clear[i] = power[i] / max(float(np.median(side)) for side in near)
    return clear


def _size(sizes: Array) -> list[float]:
    """Return the root mean square over pieces of a motion, with its interval."""
    power = sizes**2
    value = float(np.sqrt(power.mean()))
    half = SURE * float(power.std(ddof=1)) / np.sqrt(len(sizes)) / (2 * value)
    return [value, value - half, value + half]
