"""Cutting a trace into rests and passes: when the object hung on the hand, and when the arm was
where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.geometry.pose import Array, Pose
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace, once

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """Rows of a trace with and without the object in the hand; rows while the fingers move are in
    neither.

    `grasps` are the times at which the hand's content changed to or from the object.
    """

    loaded: Mask
    empty: Mask
    grasps: tuple[float, ...]


def load_of(trace: Trace, name: str | None) -> Load:
    """Times at which `name` was held, from the leaves' symbolic contexts."""
    t = trace.samples.t
    loaded, empty = np.zeros(len(t), dtype=bool), np.ones(len(t), dtype=bool)
    held: str | None = None
    grasps: list[float] = []
    for leaf in sorted(trace.leaves, key=lambda run: run.end):
        if leaf.context is None or leaf.context.holding == held:
            continue
        if name in (held, leaf.context.holding):
            grasps.append(leaf.end if leaf.context.holding else leaf.start)
        held = leaf.context.holding
        loaded[t >= leaf.start] = empty[t >= leaf.start] = False
        loaded[t > leaf.end] = held == name and held is not None
        empty[t > leaf.end] = held is None
    return Load(loaded, empty, tuple(grasps))


def mean_pose(samples: Samples) -> Pose:
    """Mean TCP pose (world) of samples that lie close together.

    Raises:
        ValueError: there are no samples.
    """
    if not len(samples):
        raise ValueError("no samples to average a pose over")
    quaternions = samples.pose_world_tcp[:, 3:]
    signs = np.where(quaternions @ quaternions[0] < 0, -1.0, 1.0)
    return Pose.of(
        samples.pose_world_tcp[:, :3].mean(axis=0), (quaternions * signs[:, None]).mean(axis=0)
    )


def runs(mask: Mask) -> Iterator[slice]:
    """The maximal stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(end))


@once
def at_rest(samples: Samples) -> Mask:
    """Rows where neither the commanded pose nor the arm moves, transients left out."""
    t = samples.t
    if len(t) < 2:
        return np.zeros(len(t), dtype=bool)
    changed = commanded(samples)
    # For every row, when the command changed last and when it will change next.
    last_change = np.maximum.accumulate(np.where(changed, t, -np.inf))
    next_change = np.minimum.accumulate(np.where(changed, t, np.inf)[::-1])[::-1]
    slow = np.linalg.norm(samples.twist[:, :3], axis=1) < tuning.STILL_SPEED
    slow &= np.linalg.norm(samples.twist[:, 3:], axis=1) < tuning.STILL_TURN
    return (t - last_change > tuning.SETTLE) & (next_change - t > tuning.START) & slow


@once
def acceleration(samples: Samples, over: float) -> Array:
    """(n, 3) m/s² of the TCP, world axes, from its velocity averaged over `over` s: encoders are
    noisy."""
    t = samples.t
    if len(t) < 2:
        return np.zeros((len(t), 3))
    return gained(samples.twist[:, :3], t, over)[1]


def gained(speeds: Array, t: Array, over: float) -> tuple[Array, Array]:
    """Speeds (n, k) averaged over `over` s at most, and what they gain a second; an odd number of rows,
    so that both are of the moment of the row they stand in."""
    half = max(0, round(over / max(float(np.median(np.diff(t))), 1e-9)) - 1) // 2
    smooth = np.column_stack([smoothed(speed, 2 * half + 1) for speed in speeds.T])
    return smooth, np.gradient(smooth, t, axis=0)


def smoothed(values: Array, rows: int) -> Array:
    """(n,) running mean of values (n,) over so many rows."""
    return np.convolve(values, np.ones(rows) / rows, mode="same")


@once
def commanded(samples: Samples) -> Mask:
    """Rows where the commanded pose moves or turns."""
    target = samples.target_world_tcp
    moved = np.linalg.norm(np.diff(target[:, :3], axis=0), axis=1)
    # A quaternion and its opposite are one orientation.
    turned = 1.0 - np.abs(np.sum(target[1:, 3:] * target[:-1, 3:], axis=1))
    return np.concatenate([[False], (moved > 1e-6) | (turned > 1e-12)])


def near(samples: Samples, pose: Pose) -> Mask:
    """Rows where the TCP is at `pose`, up to the sag of a loaded arm."""
    close = np.linalg.norm(samples.pose_world_tcp[:, :3] - pose.position, axis=1) < tuning.NEAR
    return close & aligned(samples, pose)


def aligned(samples: Samples, pose: Pose) -> Mask:
    """Rows where the TCP is oriented as in `pose`."""
    dots = np.abs(samples.pose_world_tcp[:, 3:] @ pose.quaternion)
    return 2.0 * np.arccos(np.minimum(dots, 1.0)) < tuning.NEAR_ANGLE


def turns(trace: Trace, recording: Recording) -> dict[tuple[int, int], slice]:
    """Rows of each turn of a recording in bins, the same of its way in every recording, as far as it is steady
    there: by its number, and the bin's."""
    samples, t = trace.samples, trace.samples.t
    inside = (t >= recording.start) & (t <= recording.end)
    edges = np.linspace(0.0, 1.0, tuning.TURN_BINS + 1)[1:-1]
    found: dict[tuple[int, int], slice] = {}
    for i, turn in enumerate(runs(commanded(samples) & inside)):
        if turn.stop - turn.start > tuning.TURN_BINS * tuning.REST_ROWS:
            cuts = _reached(samples.where(turn), edges) + turn.start
            for k, (first, last) in enumerate(pairwise(cuts.tolist())):
                if _turns_steadily(samples, slice(int(first), int(last))):
                    found[i, k] = slice(int(first), int(last))
    return found


def _turns_steadily(samples: Samples, rows: slice) -> bool:
    """The hand turns at a constant rate, so that no inertial moment adds to the weight's."""
    if rows.stop - rows.start < tuning.REST_ROWS:
        return False
    turning, t = samples.twist[rows, 3:], samples.t[rows]
    since = t - t.mean()
    trend = since @ turning / float(since @ since)
    return float(np.linalg.norm(trend)) < tuning.TURN_STEADY


def _reached(samples: Samples, shares: Array) -> NDArray[np.intp]:
    """Rows at which the given shares of a turn are completed."""
    quaternions = samples.pose_world_tcp[:, 3:]
    gone = 2.0 * np.arccos(np.minimum(np.abs(quaternions @ quaternions[0]), 1.0))
    progress = np.maximum.accumulate(gone)
    return np.asarray(np.searchsorted(progress, shares * progress[-1]), dtype=np.intp)


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """The straight line on which the object was lifted: from the grasp to where it was measured.

    Attributes:
        origin: (3,) world, the grasp.
        axis: (3,) unit.
        length: m.
        pose: where it was measured.
    """

    origin: Array
    axis: Array
    length: float
    pose: Pose

    def progress(self, samples: Samples) -> Array:
        """(n,) m along the line from its origin."""
        return (samples.pose_world_tcp[:, :3] - self.origin) @ self.axis

    def inside(self, samples: Samples) -> Mask:
        """Rows on the line, clear of the support, in the measured orientation."""
        relative = samples.pose_world_tcp[:, :3] - self.origin
        along = relative @ self.axis
        beside = np.linalg.norm(relative - along[:, None] * self.axis, axis=1)
        clearance = min(tuning.CLEARANCE, tuning.SHORT_LIFT * self.length)
        clear = (along > clearance) & (along < self.length)
        return clear & (beside < tuning.CORRIDOR) & aligned(samples, self.pose)


def lift_path(trace: Trace, recording: Recording, load: Load) -> Path | None:
    """The path of the lift before `recording`; None when the grasp is not in the trace or not
    elsewhere."""
    before = [time for time in load.grasps if time <= recording.start]
    window = trace.of(recording)
    if not before or not len(window):
        return None
    row = row_at(trace.samples, before[-1])
    grasp = trace.samples.pose_world_tcp[row, :3]
    measured = mean_pose(window)
    line = measured.position - grasp
    length = float(np.linalg.norm(line))
    if length <= tuning.LIFT_MIN:
        return None
    return Path(grasp, line / length, length, measured)


def row_at(samples: Samples, time: float) -> int:
    """The first row from `time` on, or the last there is."""
    return min(int(np.searchsorted(samples.t, time)), len(samples) - 1)
