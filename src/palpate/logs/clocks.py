"""Clock and units of a log: seconds from 0 on, radians, no row twice; each repair is a note."""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate.estimation.motion import Mask
from palpate.geometry.pose import Array
from palpate.logs.columns import Angle, ColumnMap, Unit

SECONDS: dict[Unit, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STEPS = 3e-4, 100.0
"""s between rows of a recording."""
DATES = 0.95e9, 4.1e9
"""s since 1970, of this century."""
MOVING, FASTEST = 0.02, 6.0
"""rad/s of a joint in motion."""
SMOOTH = 0.5
"""Correlation of a smooth motion's successive steps; that of noise is -0.5."""
LONGEST = 3600.0
"""s that an arm at rest is recorded."""
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
    signals: dict[str, Array],
    columns: ColumnMap,
    source: str,
    unit: Unit | None = None,
    angles: Angle | None = None,
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Repair clock, repeated rows and units of signals (`t`, `q`, `tau`, perhaps `dq`, `tau_ext`).

    Args:
        unit: of the clock, in its column's name.
        angles: unit of the angles, in their columns' names.

    Raises:
        InputError: no number is left of more than half of the rows, or the clock does not run.
    """
    notes: list[str] = []
    whole = len(signals["t"])
    if whole < 2:
        raise InputError(f"{source} has {whole} rows; a recording has thousands")
    signals = dict(signals)
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
    beyond = np.abs(signals["q"]).max() > LARGEST_ANGLE
    if (columns.angles or angles or ("deg" if beyond else "rad")) == "deg":
        for name in {"q", "dq"} & set(signals):
            signals[name] = np.radians(signals[name])
        if columns.angles is None:
            notes.append("angles are in degrees")
    slope = _slope_unit(signals)
    if columns.time is None and unit and slope and slope != unit:
        raise InputError(
            f"{source}: the clock is named in {unit}, but the velocities fit one in {slope}; "
            f"state it in a file with 'time: {slope}', and give it as columns=MAP.yaml"
        )
    unit = columns.time or unit or slope or _likely_unit(signals)
    if unit != "s" and columns.time is None:
        notes.insert(0, f"the clock counts in {unit}")
    signals["t"] = (signals["t"] - signals["t"][0]) * SECONDS[unit]
    if "dq" not in signals:
        signals["dq"] = differentiated(signals["q"], signals["t"])
        notes.append("joint velocities are not logged: taken from the positions")
    return signals, tuple(notes)


def _slope_unit(signals: dict[str, Array]) -> Unit | None:
    """Unit of the clock in which the logged velocities are the slopes of the positions; None where neither
    moves enough."""
    if "dq" not in signals:
        return None
    steps, speeds = np.diff(signals["t"])[:, None], np.abs(signals["dq"][1:])
    moving = speeds > MOVING
    way = float(np.abs(np.diff(signals["q"], axis=0))[moving].sum())
    expected = float((speeds * steps)[moving].sum())
    ratios: dict[Unit, float] = {
        unit: way / (expected * size + 1e-12) for unit, size in SECONDS.items()
    }
    return next((unit for unit, ratio in ratios.items() if 1 / 3 < ratio < 3), None)


def _likely_unit(signals: dict[str, Array]) -> Unit:
    """Infer the unit of a clock from its steps and the positions alone; s where they leave it open."""
    t, moves = signals["t"], np.diff(signals["q"], axis=0)
    steps = np.diff(t)
    step, fastest = float(np.median(steps)), np.quantile(np.abs(moves).max(1) / steps, 0.999)
    fit: list[Unit] = [
        unit
        for unit, size in SECONDS.items()
        if STEPS[0] <= size * step <= STEPS[1] and fastest < FASTEST * size
    ]
    # A clock that runs since 1970 shows a date of this century.
    for unit in fit:
        if DATES[0] < SECONDS[unit] * t[0] < DATES[1]:
            return unit
    # Successive steps of a motion sampled densely are alike; steps between poses, and noise, are not.
    smooth = (moves[1:] * moves[:-1]).sum() > SMOOTH * (moves**2).sum()
    for unit in fit[::-1] if smooth else ():
        if fastest > MOVING * SECONDS[unit]:
            return unit
    return fit[-1] if fit and not ("s" in fit and t[-1] - t[0] < LONGEST) else "s"


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
