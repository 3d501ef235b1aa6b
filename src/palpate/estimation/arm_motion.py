"""Motion of an arm on a uniform clock, and its signals in the frequency domain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.estimation.joint_friction import dahl
from palpate.trace.recording import ArmLog

MOTION_BAND = 15.0
"""Hz. Bandwidth of the motion from the encoders: products of it fill `BAND`. Sensitive: hand 0.1 σ, std ×1.0–1.1;
others at most 1.0 σ, std ×0.9–1.1."""
CLOCK = 200.0
"""Hz. Largest rate of the common clock of all signals. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.0 σ, std
×0.9–1.0."""
SLOWEST = 0.05
"""s. Largest time between rows: two rows per period of twice `BAND`. Sensitive: no."""
LOG_GAP = 0.2
"""s. A longer time without a row splits a recording. Sensitive: no."""
EDGE = 0.2
"""s. Margin at both ends of a recording for the filter: three periods of `MOTION_BAND`. Sensitive: hand 0.1 σ, std
×0.9–1.0; others at most 2.1 σ, std ×0.9–1.2."""
STRETCH = 20.0
"""s. Longest stretch for one cosine transform. Sensitive: hand 0 σ, std ×1.0–1.0; others at most 0.1 σ, std
×1.0–1.0."""
SHORTEST_STRETCH = 2.0
"""s. Shorter pieces of a recording are left out. Sensitive: no."""
SHORTEST_LOG = 5.0
"""s. Shortest motion accepted: ten periods of 0.5 Hz, without the held-out part. Sensitive: no."""
LEARNT = 0.6
"""Fraction of a recording, from its start, that is fitted; the rest is held out. Sensitive: hand 0.1 σ, std ×1.0–1.1;
others at most 0.9 σ, std ×0.9–1.1."""
PRESLIDINGS = (1.5e-3, 6e-4, 4e-3, 1e-2)
"""rad. Presliding distances over which elements of a joint's friction reverse. The first is the usual one (real arms
showed 1 to 4 mrad). Sensitive: hand 0.4 σ, std ×0.9–1.1; others at most 1.7 σ, std ×0.7–1.3."""


@dataclass(frozen=True, slots=True, eq=False)
class JointMotion:
    """Joint signals at n uniform times, low-passed by a zero-phase filter.

    Attributes:
        t: (n,) s.
        q, dq, ddq: (n, 7) rad, rad/s, rad/s².
        tau, tau_ext: (n, 7) N m; None where not logged.
        dahl: (n, 7, p) Dahl friction of unit level, for each of `PRESLIDINGS`.
        strained: (n, 7, p) decaying remainder of the friction from before the recording, for each of `PRESLIDINGS`.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array
    tau_ext: Array | None
    dahl: Array
    strained: Array

    def __len__(self) -> int:
        return len(self.t)

    @property
    def step(self) -> float:
        """s, time between rows."""
        return float(self.t[1] - self.t[0])

    @property
    def slip(self) -> Array:
        """(n, 7) rad/s, velocities minus the slope of the angles: an uneven clock makes them differ."""
        return self.dq - _slope(self.t, self.q)

    def between(self, first: int, last: int) -> JointMotion:
        """Rows from `first` up to, not including, `last`."""
        parts = {field.name: getattr(self, field.name) for field in fields(self)}
        rows = {name: part[first:last] for name, part in parts.items() if part is not None}
        return replace(self, **rows)


def stretches(log: ArmLog) -> tuple[list[JointMotion], list[JointMotion]]:
    """Split a recording at its gaps into stretches: its first part, `LEARNT`, and the held-out rest.

    Raises InputError: the recording is too short, has too few rows a second, or has gaps around its middle.
    """
    # Check the sample rate and the total duration.
    steps = np.diff(log.t)
    step = float(np.median(steps)) if len(steps) else np.inf
    if step > SLOWEST:
        raise InputError(
            f"{log.source} has a row every {step:.3g} s: log the arm at {1.0 / SLOWEST:g} Hz at least, "
            "better at 1 kHz"
        )
    whole = list(uniform_runs(log))
    seconds = sum(float(motion.t[-1] - motion.t[0]) + 2.0 * EDGE for motion in whole)
    if seconds < SHORTEST_LOG:
        raise InputError(
            f"{log.source} has {seconds:.1f} s without gaps: record at least {SHORTEST_LOG:g} s of free "
            "motion, better 60 s, in which every joint turns round often"
        )
    # Cut every run at the time that separates fitted and held-out parts.
    split = log.t[0] + LEARNT * (log.t[-1] - log.t[0])
    learnt: list[JointMotion] = []
    held_out: list[JointMotion] = []
    for motion in whole:
        middle = int((motion.t < split).sum())
        learnt += cut(motion, 0, middle)
        held_out += cut(motion, middle, len(motion))
    if not (learnt and held_out):
        raise InputError(f"{log.source} has gaps around its middle: cut it to a part without any")
    return learnt, held_out


def uniform_runs(log: ArmLog) -> Iterator[JointMotion]:
    """Yield the gapless runs of a recording longer than `SHORTEST_STRETCH`, on a uniform clock."""
    # A pause longer than `LOG_GAP` separates two runs.
    gaps: list[int] = (np.flatnonzero(np.diff(log.t) > LOG_GAP) + 1).tolist()
    for first, last in pairwise([0, *gaps, len(log)]):
        if log.t[last - 1] - log.t[first] > SHORTEST_STRETCH:
            yield _uniform(log, first, last)


def cut(
    motion: JointMotion, first: int, last: int, shortest: float = SHORTEST_STRETCH
) -> Iterator[JointMotion]:
    """Yield equal stretches of rows, each at most `STRETCH` s long; none if all rows span less than `shortest` s."""
    if last - first < 2:
        return
    seconds = float(motion.t[last - 1] - motion.t[first])
    if seconds < shortest:
        return
    # Equal parts, none longer than `STRETCH`.
    count = int(np.ceil(seconds / STRETCH))
    rows = (last - first) // count
    for start in range(first, first + count * rows, rows):
        yield motion.between(start, start + rows)


def _uniform(log: ArmLog, first: int, last: int) -> JointMotion:
    """Resample rows of a recording on a uniform clock and low-pass them."""
    # Uniform clock at the median step, and the decimation to at most `CLOCK` Hz.
    t = log.t[first:last]
    step = float(np.median(np.diff(t)))
    times = np.arange(t[0], t[-1], step)
    every = max(1, round(1.0 / (step * CLOCK)))

    def even(signal: Array) -> Array:
        """Signal (n, 7) interpolated to the uniform clock."""
        columns: list[Array] = [np.interp(times, t, column) for column in signal[first:last].T]
        return np.stack(columns, axis=1)

    # Low-pass every signal alike and decimate; friction states follow the smoothed angles.
    q = even(log.q)
    smooth, clock = _low_pass(q, step)[::every], times[::every]
    dq = _low_pass(even(log.dq), step)[::every]
    moved = np.diff(smooth, axis=0, prepend=smooth[:1])
    friction, strained = dahl(moved, np.array(PRESLIDINGS))
    found = JointMotion(
        t=clock,
        q=smooth,
        dq=dq,
        ddq=_slope(clock, dq),
        tau=_low_pass(even(log.tau), step)[::every],
        tau_ext=None if log.tau_ext is None else _low_pass(even(log.tau_ext), step)[::every],
        dahl=friction,
        strained=strained,
    )
    # Drop the edges: the filter lacks the samples before and after them.
    edge = int(np.ceil(EDGE / (clock[1] - clock[0])))
    return found.between(edge, len(clock) - edge)


def _low_pass(signal: Array, step: float) -> Array:
    """Low-pass a signal (n, 7) with steps of `step` s forwards and backwards, for zero phase."""
    from scipy.signal import butter, sosfiltfilt

    if MOTION_BAND * step >= 0.45:
        return signal
    # Butterworth filter of order 4, twice.
    filtered = butter(4, MOTION_BAND, fs=1.0 / step, output="sos")
    return sosfiltfilt(filtered, signal, axis=0)


def _slope(t: Array, signal: Array) -> Array:
    """Time derivative of a signal (n, 7), by cubic splines."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, signal)(t, 1), dtype=np.float64)


# Stretches with the same motion


ALIKE_ANGLES = 0.01
"""rad. Largest distance of the angles of two stretches, root mean square over rows and joints, that count as one
motion. Gear ripple repeats within some mrad; the noise of the difference is learned. Sensitive: no, from 0.004 to
0.02."""
COARSE = 20
"""Rows between those that a search for equal motions compares first."""
SHORTEST_PERIOD = 4.0
"""s. Shortest period of a motion; shorter stretches resolve too few frequencies. Sensitive: no."""
NEARLY_WHOLE = 0.8
"""Fraction of a period from which the last one counts as complete. Sensitive: no, from 0.7 to 0.9."""
CARRIED_SHORTEST = 0.5
"""s: shorter stretches with or without a load are left out. Not sensitive."""
OWN, MEAN, DIFFERENCE, REPEAT = 0, 1, 2, 3
"""Kinds of rows: of a stretch alone, of the mean of stretches with the same motion, of their difference with and
without the load, and of differences between repetitions."""


@dataclass(frozen=True, slots=True)
class EqualMotions:
    """Groups of stretches with the same motion, whose rows are combined by an orthonormal matrix.

    Errors of the arm's model that depend on the motion alone cancel in differences: ripple, friction that changes with
    the place, links. Source: the method of differences of torques at equal phase; J. Swevers, W. Verdonck and J. De
    Schutter, IEEE Control Systems Magazine 27(5), 2007.

    Attributes:
        groups: indices of the stretches of each group, with and without the load. Each stretch is in one.
    """

    groups: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]

    def combine(self, parts: Sequence[Array]) -> Array:
        """Combine the rows (k, …) of each stretch, group by group."""
        found: list[Array] = []
        for loaded, empty in self.groups:
            rows = np.stack([parts[i] for i in (*loaded, *empty)])
            found += [*np.tensordot(_combinations(len(loaded), len(empty))[0], rows, axes=1)]
        return np.concatenate(found)

    def spread(self, parts: Sequence[Array]) -> tuple[Array, Array]:
        """Values of each combined row: those of `parts` (k,) of its stretch, and its kind."""
        found: list[Array] = []
        kinds: list[Array] = []
        for loaded, empty in self.groups:
            for i, kind in zip(
                (*loaded, *empty), _combinations(len(loaded), len(empty))[1], strict=True
            ):
                found.append(parts[i])
                kinds.append(np.full(len(parts[i]), kind))
        return np.concatenate(found), np.concatenate(kinds)


def _combinations(loaded: int, empty: int) -> tuple[Array, list[int]]:
    """Orthonormal matrix (n, n) of the combinations of `loaded` and `empty` stretches, n in all, and their kinds."""
    count = loaded + empty
    if count == 1:
        return np.eye(1), [OWN]
    rows, kinds = [np.ones(count)], [MEAN]
    if loaded and empty:
        rows.append(np.array([*[1.0 / loaded] * loaded, *[-1.0 / empty] * empty]))
        kinds.append(DIFFERENCE)
    # Differences of each repetition from the mean of those before it (Helmert).
    for first, last in ((0, loaded), (loaded, count)):
        for i in range(first + 1, last):
            rows.append(np.zeros(count))
            rows[-1][first:i], rows[-1][i] = 1.0, float(first - i)
            kinds.append(REPEAT)
    found = np.array(rows)
    return found / np.linalg.norm(found, axis=1, keepdims=True), kinds


def equal_motions(
    loaded: Sequence[JointMotion], empty: Sequence[JointMotion]
) -> tuple[list[tuple[JointMotion, bool]], EqualMotions]:
    """Cut the motion with a load into stretches, and that of the empty hand into stretches of the same motions.

    Returns:
        All stretches, each with True if it is loaded.
        The groups of those with the same motion.
    """
    found = [(one, True) for motion in loaded for one in _periods(motion)]
    groups = list[tuple[list[int], list[int]]]()
    # Group loaded stretches of one motion.
    for i, (one, _) in enumerate(found):
        firsts = [found[group[0]][0] for group, _ in groups]
        alike = [
            len(one) == len(first) and _apart(one, first, 0) < ALIKE_ANGLES for first in firsts
        ]
        if any(alike):
            groups[alike.index(True)][0].append(i)
        else:
            groups.append(([i], []))
    # Find each motion with the empty hand, in rows that no other stretch has taken.
    for motion in empty:
        taken = np.zeros(len(motion), dtype=bool)
        for carried, alone in groups:
            if not carried:
                continue
            one = found[carried[0]][0]
            for first in _places(one, motion):
                if not taken[first : first + len(one)].any():
                    taken[first : first + len(one)] = True
                    alone.append(len(found))
                    found.append((motion.between(first, first + len(one)), False))
        edges = np.flatnonzero(np.diff(taken)) + 1
        for part in np.split(np.arange(len(motion)), edges):
            if len(part) and not taken[part[0]]:
                for rest in cut(motion, int(part[0]), int(part[-1]) + 1, CARRIED_SHORTEST):
                    groups.append(([], [len(found)]))
                    found.append((rest, False))
    return found, EqualMotions(tuple((tuple(a), tuple(b)) for a, b in groups))


def _periods(motion: JointMotion) -> Iterator[JointMotion]:
    """Cut a motion into its periods, or into equal stretches where it has none."""
    # The period is the least shift by which all of the motion repeats itself.
    shortest, n = round(SHORTEST_PERIOD / motion.step), len(motion)
    shifts = sorted(_places(motion.between(0, max(1, n // 3)), motion))
    period = next(
        (
            p
            for p in shifts
            if p >= shortest and _apart(motion.between(0, n - p), motion, p) < ALIKE_ANGLES
        ),
        n,
    )
    # A last period that is nearly complete shortens all; a shorter one is a stretch of its own.
    count, left = divmod(n, period)
    length = period
    if left > NEARLY_WHOLE * period:
        count, length = count + 1, left
    if period * motion.step > STRETCH:
        count = 0
    for first in range(0, count * period, period):
        yield motion.between(first, first + length)
    yield from cut(motion, min(count * period, n), n, CARRIED_SHORTEST)


def _apart(one: JointMotion, other: JointMotion, first: int, every: int = 1) -> float:
    """Distance (rad, root mean square) of the angles of `one` and of `other` from row `first` on."""
    rows = other.q[first : first + len(one)]
    if first < 0 or len(rows) < len(one) or abs(one.step - other.step) * len(one) > one.step:
        return np.inf
    return float(np.sqrt(np.mean((one.q[::every] - rows[::every]) ** 2)))


def _places(one: JointMotion, motion: JointMotion) -> list[int]:
    """List the first rows in `motion` of stretches with the motion of `one`, the most equal first."""
    # Compare every `COARSE` rows, and refine each local minimum.
    starts = range(0, len(motion) - len(one) + 1, COARSE)
    coarse = [np.inf, *(_apart(one, motion, first, COARSE) for first in starts), np.inf]
    found: list[tuple[float, int]] = []
    for place, first in enumerate(starts, 1):
        if coarse[place] <= min(coarse[place - 1], coarse[place + 1]) < np.inf:
            near = range(first - COARSE, first + COARSE + 1)
            found.append(min((_apart(one, motion, row), row) for row in near))
    return [row for apart, row in sorted(found) if apart < ALIKE_ANGLES]


# Signals of an arm in the frequency domain up to `BAND`, and the noise of a fit there


BAND = 5.0
"""Hz up to which torque is fitted: between 8 and 30 Hz the torque of a real FR3 does not follow M ddq. Sensitive: not
from 2.5 to 7 Hz; at 10 Hz, near the resonance of a soft loop, the hand's std is ×9."""
CORNERS = (0.1, 0.3, 1.0, 3.0)
"""Hz. Corner frequencies below which the residual is stronger. Sensitive: hand 0.2 σ, std ×0.8–1.0; others at most
1.1 σ, std ×0.8–1.2."""
WHITE_SHARES = (1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 10.0, 100.0)
"""White part of the residual relative to its low-frequency part. Each joint weights all pairs of corner and share by
likelihood; the last one is nearly white. Sensitive: hand 0.2 σ, std ×1.0–1.1; others at most 1.4 σ, std ×0.8–1.3;
mass std ×1.02 at `lab` without the last."""
SMALLEST_RESIDUAL = 1e-3
"""N m of a frequency coefficient. Smallest residual, finer than any sensor. Sensitive: no."""


def transform_signal(signal: Array, step: float) -> Array:
    """Cosine coefficients (k, 7, …) up to `BAND` of a signal (n, 7, …) with steps of `step` s."""
    basis = _cosines(len(signal), count_coefficients(len(signal), step))
    return (basis @ signal.reshape(len(signal), -1)).reshape(len(basis), *signal.shape[1:])


@lru_cache(8)
def _cosines(rows: int, count: int) -> Array:
    """First `count` rows of the orthonormal cosine transform (DCT-II) of `rows` rows.

    Only some per cent of the coefficients are needed, so that a product is faster than a fast transform.
    """
    found = np.cos(np.pi / rows * np.outer(np.arange(count), np.arange(rows) + 0.5))
    found *= np.sqrt(2.0 / rows)
    found[0] /= np.sqrt(2.0)
    return found


def count_coefficients(rows: int, step: float) -> int:
    """Number of coefficients up to `BAND` for `rows` rows with steps of `step` s."""
    return min(rows, int(2.0 * BAND * step * rows))


def frequencies(count: int, rows: int, step: float) -> Array:
    """Frequencies (count,), Hz, of the coefficients of a stretch of `rows`; the first is half a step, not zero."""
    return (np.arange(count, dtype=float) + 0.5) / (2.0 * rows * step)


@dataclass(frozen=True, slots=True, eq=False)
class SpectralNoise:
    """Independent noise of n rows."""

    std: Array  # (n,) N m
    freedom: float  # degrees of freedom of the noise estimate

    @property
    def volume(self) -> float:
        """Half of the log determinant of the covariance."""
        return float(np.log(self.std).sum())

    def white(self, rows: Array) -> Array:
        """Whiten rows (n, p), or (n,), to unit variance."""
        return (rows.T / self.std).T


@dataclass(frozen=True, eq=False)
class ResidualSpectrum:
    """Candidate spectra of the residual: white noise plus low-frequency noise.

    Drift, unmodelled friction and gear ripple have more power at low frequencies.
    """

    frequency: Array  # (k,) Hz
    # True for differences of equal motions. There the sensors' 1/f noise is left.
    is_difference: bool = False

    @cached_property
    def shapes(self) -> Array:
        """(s, k) power over frequency of each candidate."""
        falling = [1.0 / (1.0 + (self.frequency / corner) ** 2) for corner in CORNERS]
        if self.is_difference:
            falling.append(CORNERS[0] / self.frequency)
        shares = np.array(WHITE_SHARES)[:, None]
        return np.concatenate([shares + shape for shape in falling])

    def std(self, left: Array, known: Array) -> Array:
        """Standard deviations (k,) from the residual `left` (k,), N m, averaged over the candidate spectra.

        The fit absorbs a fraction `known` (k,) of each coefficient (restricted likelihood).
        """
        # Scale and log likelihood of each candidate, with the degrees of freedom that the fit left.
        freedom = np.maximum(1.0 - known, 0.02)
        scale = (left**2 / self.shapes).sum(axis=1) / freedom.sum()
        cost = np.log(scale) * freedom.sum() + np.log(self.shapes) @ freedom
        # Weight by likelihood: only few coefficients determine the corner at low frequencies.
        likely = np.exp(-0.5 * (cost - cost.min()))
        power = (likely * scale) @ self.shapes / likely.sum()
        return np.sqrt(power) + SMALLEST_RESIDUAL
