"""Rests and passes of a trace that tell about the load on the hand, with and without it.

The sensed wrench is load + bias, and the bias depends on where the arm is, which way its joints
slide, how it came to rest, and on time. All of that is the same with and without the object on the
same path in the same direction. So a trace is cut into *rests* at the pose where the object was
measured and *passes* along the straight line on which it was lifted, each loaded or empty, and each
of a *kind*: what makes two of them comparable.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.windows import (
    Load,
    Mask,
    Path,
    at_rest,
    commanded,
    lift_path,
    load_of,
    mean_pose,
    near,
    runs,
)
from palpate.geometry.pose import Array
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace

Rows = NDArray[np.intp] | slice
"""Rows of a trace's samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A rest, or a pass in k bins along the path.

    Attributes:
        kind: `up`, `down` (passes) or `rest ...` with how the arm came to rest.
        loaded: with the object in the hand.
        t: mean time, s. start, end: s.
        path: (k,) position along the path, -1 to 1.
        acceleration: (k,) vertical, m/s². speed2: (k,) m²/s², squared speed.
        mean, variance: (k, 6) of the wrench.
    """

    kind: str
    loaded: bool
    t: float
    start: float
    end: float
    path: Array
    acceleration: Array
    speed2: Array
    mean: Array
    variance: Array

    @property
    def at_rest(self) -> bool:
        return self.kind.startswith("rest")


@dataclass(frozen=True, slots=True)
class _Cut:
    """Rows of one rest or pass."""

    kind: str
    loaded: bool
    rows: Rows


def segments(trace: Trace, recording: Recording) -> list[Segment]:
    """All rests and passes that tell about the load of `recording`, with and without it."""
    load = load_of(trace, recording.context.holding)
    path = lift_path(trace, recording, load)
    samples = trace.samples
    told = commanded(samples)
    rests = list(_rests(trace, recording, load, path))
    quiet = [cut for cut in rests if not told[cut.rows].any()]
    noise = _noise_density(samples, [cut.rows for cut in quiet] or list(runs(at_rest(samples))))
    found = _at(samples, quiet, noise)
    if path is not None:
        passes = _binned(samples, _passes(trace, load, path), path, noise)
        found += [one for one in passes if _has_counterpart(one, passes)]
    if not any(segment.loaded for segment in found):
        return _at(samples, rests, noise)  # a recording of a motion is all there is
    return found


def _at(samples: Samples, rests: Iterable[_Cut], noise: Array) -> list[Segment]:
    return [_segment(samples, cut, np.zeros(1), [cut.rows], noise) for cut in rests]


def referenced(found: Iterable[Segment]) -> bool:
    """Whether some kind of segment was seen both with and without the load."""
    loaded: set[str] = set()
    empty: set[str] = set()
    for segment in found:
        (loaded if segment.loaded else empty).add(segment.kind)
    return bool(loaded & empty)


def _has_counterpart(one: Segment, found: Iterable[Segment]) -> bool:
    return any(_comparable(one, other) for other in found)


def _comparable(one: Segment, other: Segment) -> bool:
    """Whether two passes, one with the load and one without, were the same motion: else the arm's
    own inertia, which is far larger than a load's, does not cancel."""
    if one.kind != other.kind or one.loaded == other.loaded:
        return False
    apart = one.acceleration - np.interp(one.path, other.path, other.acceleration)
    return float(np.sqrt(np.mean(apart**2))) < tuning.SAME_MOTION


def _loaded_and_empty(load: Load) -> tuple[tuple[bool, Mask], tuple[bool, Mask]]:
    return (True, load.loaded), (False, load.empty)


def _rests(trace: Trace, recording: Recording, load: Load, path: Path | None) -> Iterator[_Cut]:
    """Rests at the pose of `recording`, and `recording` itself, however much the arm swung."""
    samples = trace.samples
    measured = (samples.t >= recording.start) & (samples.t <= recording.end)
    here = (at_rest(samples) & near(samples, mean_pose(trace.of(recording)))) | measured
    for loaded, mask in _loaded_and_empty(load):
        for rows in runs(here & mask):
            if rows.stop - rows.start >= tuning.REST_ROWS:
                yield _Cut(f"rest {_arrival(samples, rows.start, path)}", loaded, rows)


def _arrival(samples: Samples, row: int, path: Path | None) -> str:
    """How the arm came to rest at `row`: `up` or `down` the path, or `beside` it."""
    if path is None:
        return "beside"
    moved = samples.target_world_tcp[row, :3] - samples.target_world_tcp[: row + 1, :3]
    far = np.flatnonzero(np.linalg.norm(moved, axis=1) > tuning.ARRIVAL)
    if not len(far):
        return "beside"
    along = float(moved[far[-1]] @ path.axis) / tuning.ARRIVAL
    if along > tuning.ALONG:
        return "up"
    return "down" if along < -tuning.ALONG else "beside"


def _passes(trace: Trace, load: Load, path: Path) -> list[_Cut]:
    """Motions along the path that cover enough of it, up and down; where the arm goes steadily, if
    that is enough of it both with the load and without."""
    speed = np.gradient(path.progress(trace.samples), trace.samples.t)
    steady = np.abs(np.gradient(speed, trace.samples.t)) < tuning.STEADY
    found = list(_motions(trace.samples, load, path, speed, steady))
    if {cut.loaded for cut in found} == {True, False}:
        return found
    return list(_motions(trace.samples, load, path, speed, np.ones_like(steady)))


def _motions(samples: Samples, load: Load, path: Path, speed: Array, which: Mask) -> Iterator[_Cut]:
    progress, inside = path.progress(samples), path.inside(samples) & which
    ways = (("up", speed > tuning.PASS_SPEED), ("down", speed < -tuning.PASS_SPEED))
    for kind, moving in ways:
        for loaded, mask in _loaded_and_empty(load):
            for rows in _joined(inside & moving & mask, samples.t):
                if np.ptp(progress[rows]) > tuning.COVERED * path.length:
                    yield _Cut(kind, loaded, rows)


def _joined(moving: Mask, t: Array) -> Iterator[NDArray[np.intp]]:
    """Rows of each pass: stretches with a pause between them, where the arm changes its speed, are
    one."""
    found: list[NDArray[np.intp]] = []
    for stretch in runs(moving):
        rows: NDArray[np.intp] = np.arange(stretch.start, stretch.stop, dtype=np.intp)
        if found and t[rows[0]] - t[found[-1][-1]] < tuning.PAUSE:
            found[-1] = np.concatenate([found[-1], rows])
        else:
            found.append(rows)
    yield from found


def _binned(samples: Samples, passes: Sequence[_Cut], path: Path, density: Array) -> list[Segment]:
    """Passes in bins along the stretch of the path that all of them cover."""
    if not passes:
        return []
    progress = path.progress(samples)
    low = max(float(progress[cut.rows].min()) for cut in passes)
    high = min(float(progress[cut.rows].max()) for cut in passes)
    bins = np.digitize(progress, np.linspace(low, high, tuning.BINS + 1)) - 1
    found: list[Segment] = []
    for cut in passes:
        rows = np.arange(len(samples))[cut.rows]
        filled = [k for k in range(tuning.BINS) if np.any(bins[rows] == k)]
        centres = 2.0 * (np.array(filled) + 0.5) / tuning.BINS - 1.0
        rows_of_bins = [rows[bins[rows] == k] for k in filled]
        found.append(_segment(samples, cut, centres, rows_of_bins, density))
    return found


def _segment(
    samples: Samples, cut: _Cut, path: Array, bins: Sequence[Rows], density: Array
) -> Segment:
    """A cut's means over `bins`, which lie at `path`; `density` is the wrench's noise of a row."""
    acceleration = np.gradient(samples.twist[:, 2], samples.t)
    speed2 = (samples.twist[:, :3] ** 2).sum(axis=1)
    t = samples.t[cut.rows]
    return Segment(
        cut.kind,
        cut.loaded,
        float(t.mean()),
        float(t[0]),
        float(t[-1]),
        path,
        _means(acceleration, bins),
        _means(speed2, bins),
        _means(samples.wrench, bins),
        np.array([density / len(samples.t[rows]) for rows in bins]),
    )


def _means(signal: Array, bins: Sequence[Rows]) -> Array:
    return np.array([signal[rows].mean(axis=0) for rows in bins])


def _noise_density(samples: Samples, rests: Sequence[Rows]) -> Array:
    """(6,) variance that the mean of n rows has, times n: from means over blocks of rests, trend
    removed.

    Means over blocks, because neighbouring rows are correlated: the variance of a mean then falls
    more slowly than with the number of rows (batch means, e.g. Law, Simulation Modeling and
    Analysis, section 9.5).
    """
    pooled: Array = np.zeros(6)
    freedom = 0
    for rows in rests:
        y, t = samples.wrench[rows], samples.t[rows]
        size = max(1, round(tuning.BLOCK * (len(t) - 1) / max(float(t[-1] - t[0]), 1e-9)))
        count = len(t) // size
        if count <= tuning.TREND + 1:
            continue
        blocks = y[: count * size].reshape(count, size, 6).mean(axis=1)
        basis = np.vander(np.linspace(-1.0, 1.0, count), tuning.TREND + 1)
        residual: Array = blocks - basis @ (np.linalg.pinv(basis) @ blocks)
        pooled = pooled + size * (residual**2).sum(axis=0)
        freedom += count - tuning.TREND - 1
    if not freedom:
        return np.full(6, tuning.UNKNOWN_NOISE)
    return pooled / freedom
