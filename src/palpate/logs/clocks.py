"""Clock and units of a log: seconds from 0 on, radians, no row twice; each repair is a note."""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate.estimation.motion import Mask
from palpate.geometry.pose import Array
from palpate.logs.columns import ColumnMap

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
FAST = {"s": 0.0, "ms": 0.3, "us": 300.0, "ns": 3e5}
"""Median step from which a clock counts in each unit: an arm is logged at 3 Hz to 3 kHz."""
STUCK = 5
"""Rows after which equal ones are an arm at rest in a world without noise, not a late sensor."""
LARGEST_ANGLE = 7.0
"""rad; no joint of an arm turns further, so that larger numbers are degrees."""
MOST_LOST = 0.5
"""Share of rows that may be left out."""
RATE_WINDOW = 0.04
"""s; half width of the polynomial that differentiates positions."""
BLOCK = 10_000
"""Rows that are differentiated at a time, which bounds the memory."""


def cleaned(
    signals: dict[str, Array], columns: ColumnMap, source: str
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Repair clock, repeated rows and units of signals (`t`, `q`, `tau`, perhaps `dq`, `tau_ext`).

    Raises:
        InputError: no number is left of more than half of the rows, or the clock does not run.
    """
    notes: list[str] = []
    whole = len(signals["t"])
    if whole < 2:
        raise InputError(f"{source} has {whole} rows; a recording has thousands")
    signals = dict(signals) | {"t": _seconds(signals["t"], columns, notes)}
    for kept, why in (
        (_finite, "without a number"),
        (_forward, "out of the order of time"),
        (_fresh, "that repeat the one before them"),
    ):
        rows = kept(signals)
        lost = int((~rows).sum())
        if lost:
            notes.append(f"{lost} rows ({100 * lost / whole:.1f} %) {why} are left out")
            signals = {name: values[rows] for name, values in signals.items()}
        if len(signals["t"]) < max(2, MOST_LOST * whole):
            raise InputError(f"{source}: {notes[-1]}: more than half; mend the recording")
    signals["t"] = signals["t"] - signals["t"][0]
    _radians(signals, columns, notes)
    if "dq" not in signals:
        signals["dq"] = differentiated(signals["q"], signals["t"])
        notes.append("joint velocities are not logged: taken from the positions")
    return signals, tuple(notes)


def _seconds(t: Array, columns: ColumnMap, notes: list[str]) -> Array:
    steps = np.diff(t)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    typical = float(np.median(steps)) if len(steps) else 0.0
    unit = columns.time or [name for name, least in FAST.items() if typical >= least][-1]
    if unit != "s" and columns.time is None:
        notes.append(f"the clock counts in {unit}")
    return (t - t[np.isfinite(t)][:1].sum()) * SECONDS[unit]


def _finite(signals: dict[str, Array]) -> Mask:
    return np.logical_and.reduce(
        [np.isfinite(values).reshape(len(values), -1).all(axis=1) for values in signals.values()]
    )


def _forward(signals: dict[str, Array]) -> Mask:
    t = signals["t"]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(t)[:-1]])
    return t > before


def _fresh(signals: dict[str, Array]) -> Mask:
    """Rows whose positions and torques differ from those of the row before, or have not changed for long."""
    now = np.column_stack([signals["q"], signals["tau"]])
    same = np.concatenate([[False], (now[1:] == now[:-1]).all(axis=1)])
    count = np.arange(len(same))
    since = count - np.maximum.accumulate(np.where(same, 0, count))
    until = (np.minimum.accumulate(np.where(same, len(same), count)[::-1])[::-1]) - count
    return ~same | (since + until > STUCK)


def _radians(signals: dict[str, Array], columns: ColumnMap, notes: list[str]) -> None:
    degrees = bool(np.abs(signals["q"]).max() > LARGEST_ANGLE)
    if columns.angles is None and degrees:
        notes.append("angles are in degrees")
    if columns.angles == "deg" or (columns.angles is None and degrees):
        for name in {"q", "dq"} & set(signals):
            signals[name] = np.radians(signals[name])


def differentiated(q: Array, t: Array) -> Array:
    """(n, k) rates of q (n, k) per second, by a local quadratic around each row (Savitzky and Golay, 1964),
    for rows that need not be equally far apart."""
    half = max(1, round(RATE_WINDOW / max(float(np.median(np.diff(t))), 1e-6)))
    shifts = np.arange(-half, half + 1)
    out = np.empty(q.shape)
    for start in range(0, len(t), BLOCK):
        middle = np.arange(start, min(start + BLOCK, len(t)))[:, None]
        rows = np.clip(middle + shifts, 0, len(t) - 1)
        inside = (middle + shifts == rows).astype(float)
        since = t[rows] - t[middle]
        powers = inside[:, :, None] * np.stack([np.ones_like(since), since, since**2], axis=2)
        moments = powers.transpose(0, 2, 1) @ powers
        # Two rows at an end determine no quadratic: the ridge leaves them a straight line.
        moments += 1e-12 * moments[:, :1, :1] * np.eye(3)
        right = powers.transpose(0, 2, 1) @ q[rows]
        out[middle[:, 0]] = np.linalg.solve(moments, right)[:, 1]
    return out
