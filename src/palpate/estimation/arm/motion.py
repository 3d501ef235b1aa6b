"""Motion of an arm on a uniform clock, with its derivatives and the state of its joint friction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np

from palpate.errors import InputError
from palpate.estimation import tuning
from palpate.estimation.joint_friction import dahl
from palpate.geometry.pose import Array
from palpate.trace.log import ArmLog


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Joint signals at n uniform times, low-passed without a shift in time.

    Attributes:
        t: (n,) s.
        q, dq, ddq: (n, 7) rad, rad/s, rad/s².
        tau, tau_ext: (n, 7) N m; None where not logged.
        dahl: (n, 7, p) friction of unit level by Dahl's model, for each of `tuning.PRESLIDINGS`.
        strained: (n, 7, p) what is left of the friction at the start of the recording, likewise.
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
        """Time from row to row, s."""
        return float(self.t[1] - self.t[0])

    @property
    def rows(self) -> int:
        """Coefficients of each joint up to `tuning.BAND`."""
        return min(len(self), int(2.0 * tuning.BAND * self.step * len(self)))

    @property
    def slip(self) -> Array:
        """(n, 7) rad/s by which the velocities differ from the slope of the angles: uneven clocks."""
        return self.dq - _slope(self.t, self.q)

    def between(self, first: int, last: int) -> Motion:
        """Rows from `first` up to `last`."""
        parts = {field.name: getattr(self, field.name) for field in fields(self)}
        rows = {name: part[first:last] for name, part in parts.items() if part is not None}
        return replace(self, **rows)


def stretches(log: ArmLog) -> tuple[list[Motion], list[Motion]]:
    """Stretches of a recording without gaps: its first part, `tuning.LEARNT`, and the held-out rest.

    Raises:
        InputError: too short, or too few rows a second.
    """
    steps = np.diff(log.t)
    step = float(np.median(steps)) if len(steps) else np.inf
    if step > tuning.SLOWEST:
        raise InputError(
            f"{log.source} has a row every {step:.3g} s: log the arm at {1.0 / tuning.SLOWEST:g} Hz at least, "
            "better at 1 kHz"
        )
    whole = list(uniform_runs(log))
    seconds = sum(float(motion.t[-1] - motion.t[0]) + 2.0 * tuning.EDGE for motion in whole)
    if seconds < tuning.SHORTEST_LOG:
        raise InputError(
            f"{log.source} has {seconds:.1f} s without gaps: record at least {tuning.SHORTEST_LOG:g} s of free "
            "motion, better 60 s, in which every joint turns round often"
        )
    split = log.t[0] + tuning.LEARNT * (log.t[-1] - log.t[0])
    learnt: list[Motion] = []
    held_out: list[Motion] = []
    for motion in whole:
        middle = int((motion.t < split).sum())
        learnt += cut(motion, 0, middle)
        held_out += cut(motion, middle, len(motion))
    if not (learnt and held_out):
        raise InputError(f"{log.source} has gaps around its middle: cut it to a part without any")
    return learnt, held_out


def uniform_runs(log: ArmLog) -> Iterator[Motion]:
    """Yield the runs of a recording without gaps, but for short ones."""
    gaps: list[int] = (np.flatnonzero(np.diff(log.t) > tuning.LOG_GAP) + 1).tolist()
    for first, last in pairwise([0, *gaps, len(log)]):
        if log.t[last - 1] - log.t[first] > tuning.SHORTEST_STRETCH:
            yield _uniform(log, first, last)


def cut(
    motion: Motion, first: int, last: int, shortest: float = tuning.SHORTEST_STRETCH
) -> Iterator[Motion]:
    """Yield equal stretches of rows, none longer than `tuning.STRETCH`; none of less than `shortest` s."""
    if last - first < 2:
        return
    seconds = float(motion.t[last - 1] - motion.t[first])
    if seconds < shortest:
        return
    edges = (
        np.linspace(first, last, int(np.ceil(seconds / tuning.STRETCH)) + 1).astype(int).tolist()
    )
    for start, end in pairwise(edges):
        yield motion.between(start, end)


def _uniform(log: ArmLog, first: int, last: int) -> Motion:
    """Bring rows of a recording to a uniform clock."""
    t = log.t[first:last]
    step = float(np.median(np.diff(t)))
    times = np.arange(t[0], t[-1], step)
    every = max(1, round(1.0 / (step * tuning.CLOCK)))

    def even(signal: Array) -> Array:
        columns: list[Array] = [np.interp(times, t, column) for column in signal[first:last].T]
        return np.stack(columns, axis=1)

    q = even(log.q)
    smooth, clock = _low_pass(q, step)[::every], times[::every]
    dq = _low_pass(even(log.dq), step)[::every]
    moved = np.diff(smooth, axis=0, prepend=smooth[:1])
    friction, strained = dahl(moved, np.array(tuning.PRESLIDINGS))
    found = Motion(
        t=clock,
        q=smooth,
        dq=dq,
        ddq=_slope(clock, dq),
        tau=_low_pass(even(log.tau), step)[::every],
        tau_ext=None if log.tau_ext is None else _low_pass(even(log.tau_ext), step)[::every],
        dahl=friction,
        strained=strained,
    )
    # A filter does not know what came before and after.
    edge = int(np.ceil(tuning.EDGE / (clock[1] - clock[0])))
    return found.between(edge, len(clock) - edge)


def _low_pass(signal: Array, step: float) -> Array:
    """Low-pass (n, 7) at `step` s forwards and backwards, so that nothing is late."""
    from scipy.signal import butter, sosfiltfilt

    if tuning.MOTION_BAND * step >= 0.45:
        return signal
    filtered = butter(4, tuning.MOTION_BAND, fs=1.0 / step, output="sos")
    return sosfiltfilt(filtered, signal, axis=0)


def _slope(t: Array, signal: Array) -> Array:
    """Time derivative (n, 7), by cubic splines."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, signal)(t, 1), dtype=np.float64)
