"""Segmentation of a trace into rests, passes and turns, with and without the load.

The sensed wrench is load + bias, and the bias depends on where the arm is, which way its joints
slide, how it came to rest, and on time. All of that is the same with and without the object on the
same path in the same direction. So a trace is cut into *rests* at the pose where the object was
measured and *passes* along the straight line on which it was lifted, each loaded or empty, and each
of a *kind*: what makes two of them comparable. A *turn* of the hand where the object was measured is a pass,
too, along which the moment of what hangs on it turns, and what the sensors are off by does not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.load.dahl import dahl_states
from palpate.estimation.load.noise import Noise, Rows, block_noise
from palpate.estimation.load.observation import WrenchObservation, observe
from palpate.estimation.windows import (
    Load,
    Mask,
    Path,
    acceleration,
    at_rest,
    commanded,
    gained,
    lift_path,
    load_of,
    mean_pose,
    near,
    runs,
    turns,
)
from palpate.geometry.pose import Array, Pose
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Samples, Trace, once


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """Rest, or pass in k bins along the path.

    Attributes:
        kind: `up`, `down` (passes), `rest ...` with how the arm came to rest, or `turn ...` with its number.
        loaded: with the object in the hand.
        grasp: s, when the hand took or left something last.
        start, end: s.
        t: (k,) mean time, s.
        path: (k,) m along the path.
        acceleration: (k,) vertical, m/s².
        speed2: (k,) m²/s², squared speed.
        maps: (k, m, 6) m signals per unit wrench (`estimation.load.observation`).
        observed, variance: (k, m) means of the signals, and the variance of white noise in them.
        motion: (k, m) N m that the arm's own links took to move, which is out of `observed`; nothing, (k, 0),
            where it is not known.
        dahl: (k, m, 2) Dahl states of the joints (`estimation.load.dahl`); (k, 0, 2) where the signals
            are no joint torques.
        turned: (k,) rad by which the hand is turned about the vertical from where the load was measured; what
            hangs on it turns with it, and so do the moments that `maps` are of.
    """

    kind: str
    loaded: bool
    grasp: float
    start: float
    end: float
    t: Array
    path: Array
    acceleration: Array
    speed2: Array
    maps: Array
    observed: Array
    variance: Array
    motion: Array
    dahl: Array
    turned: Array

    @property
    def at_rest(self) -> bool:
        return self.kind.startswith("rest")

    @property
    def turns(self) -> bool:
        return self.kind.startswith(TURN)


TURN = "turn"
"""Prefix of the kinds of turns."""
LEVER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""Matrix from the lever of a weight to its moment about the TCP per newton, world axes."""


@dataclass(frozen=True, slots=True)
class Cut:
    """Rows of one rest or pass; `kind` as a `Segment`'s."""

    kind: str
    loaded: bool
    rows: Rows


@dataclass(frozen=True, slots=True, eq=False)
class Weighing:
    """Segments of a trace with and without a load, along one path.

    Attributes:
        segments: rests and passes with the load and without.
        noise: of the signals.
        scale: (m,) of the signals, see `estimation.load.observation`.
    """

    segments: Sequence[Segment]
    noise: Noise
    scale: Array

    @property
    def grasps(self) -> Sequence[float]:
        """s, of each grasp with which the load was weighed on it."""
        return sorted({segment.grasp for segment in self.segments if segment.loaded})

    def only(self, at_rest: bool) -> Weighing:
        """Its rests, or its passes, alone."""
        kept = [segment for segment in self.segments if segment.at_rest == at_rest]
        return replace(self, segments=kept)


@dataclass(frozen=True, slots=True, eq=False)
class _Signals:
    """A trace's signals with what its segments are made of, row by row."""

    samples: Samples
    observed: WrenchObservation
    net: Array
    motion: Array
    noise: Noise
    acceleration: Array
    speed2: Array
    progress: Array
    grasps: tuple[float, ...]
    dahl: Array


@once
def weighing(trace: Trace, recording: Recording) -> Weighing:
    """Find the rests and passes that weigh the load of `recording`, with and without it."""
    load = load_of(trace, recording.context.holding)
    path = lift_path(trace, recording, load)
    samples = trace.samples
    told, steady = commanded(samples), _steady(samples)
    rests = list(_rests(trace, recording, load, path))
    quiet = [cut for cut in rests if not told[cut.rows].any()]
    passes = _passes(trace, load, path, steady) if path is not None else []
    turned = list(_turns(trace, recording))
    signals = _signals(trace, load, path, [*rests, *passes, *(cut for cut, _ in turned)])
    found = [_segment(signals, cut, [cut.rows]) for cut in quiet]
    binned = _binned(signals, passes)
    found += [one for one in binned if _has_counterpart(one, binned)]
    here = mean_pose(trace.of(recording))
    found += [
        _turned(_segment(signals, *one), signals, one[1], here, trace.gravity) for one in turned
    ]
    if not any(segment.loaded for segment in found):
        # A recording of a motion is all there is.
        found = [_segment(signals, cut, [cut.rows]) for cut in rests]
    return Weighing(found, signals.noise, signals.observed.scale)


def compared(trace: Trace, name: str, cuts: Sequence[Cut]) -> Weighing:
    """Weighing of the load `name` from given cuts, which are compared within each kind, at one
    place each."""
    signals = _signals(trace, load_of(trace, name), None, cuts)
    found = [_segment(signals, cut, [cut.rows]) for cut in cuts]
    return Weighing(found, signals.noise, signals.observed.scale)


def _signals(trace: Trace, load: Load, path: Path | None, cuts: Iterable[Cut]) -> _Signals:
    """Row-wise signals of a trace; expensive ones only in the rows of `cuts`."""
    samples = trace.samples
    observed, rising = observe(trace), acceleration(samples, tuning.SPEED_SHORT)[:, 2]
    used = np.zeros(len(samples), dtype=bool)
    for cut in cuts:
        used[cut.rows] = True
    motion = observed.own_motion(samples, used)
    calm = (at_rest(samples) | (_steady(samples) & _moves(samples))) & (load.loaded | load.empty)
    calm &= ~_dragged(trace)
    return _Signals(
        samples,
        observed,
        _net(observed, samples, motion),
        motion,
        block_noise(observed.signals, samples.t, rising, list(runs(calm))),
        rising,
        (samples.twist[:, :3] ** 2).sum(axis=1),
        path.progress(samples) if path is not None else np.zeros(len(samples)),
        load.grasps,
        _rubbed(observed, samples),
    )


def _dragged(trace: Trace) -> Mask:
    """Rows between the first and the last slide of an object along its support, which the noise
    estimate leaves out."""
    t = trace.samples.t
    slides = [one for one in trace.recordings if one.context.activity == "sliding"]
    if not slides:
        return np.zeros(len(t), dtype=bool)
    first, last = min(one.start for one in slides), max(one.end for one in slides)
    return (first <= t) & (t <= last)


def _net(observed: WrenchObservation, samples: Samples, motion: Array) -> Array:
    """(n, m) signals without the torque that moves the arm's own links."""
    if not motion.shape[1]:
        return observed.signals
    # Averaged as the motion is, lest what is faster shows as a difference.
    return gained(observed.signals, samples.t, tuning.SPEED_SHORT)[0] - motion


def _rubbed(observed: WrenchObservation, samples: Samples) -> Array:
    """(n, m, 2) Dahl states of the joints; (n, 0, 2) where the signals are no joint torques."""
    if observed.chain is None:
        return np.zeros((len(samples), 0, 2))
    return _joint_rubbing(samples)


@once
def _joint_rubbing(samples: Samples) -> Array:
    return dahl_states(samples.q)


def weighings(trace: Trace, recording: Recording) -> Sequence[Weighing]:
    """All weighings of the object held during `recording`, one per path on which it was lifted and
    held still."""
    measured = [recording]
    for other in trace.recordings:
        still = other.buffer == FORCES and other.context.activity == "still"
        held = other.context.holding == recording.context.holding
        if still and held and not any(_same_place(trace, other, one) for one in measured):
            measured.append(other)
    return [weighing(trace, one) for one in measured]


def _same_place(trace: Trace, one: Recording, other: Recording) -> bool:
    """Two recordings belong to one lift, or to lifts along the same path."""
    if one is other:
        return True
    load = load_of(trace, one.context.holding)
    paths = lift_path(trace, one, load), lift_path(trace, other, load)
    if paths[0] is None or paths[1] is None:
        return paths[0] is paths[1]
    same_grasp = float(np.linalg.norm(paths[0].origin - paths[1].origin)) < tuning.NEAR
    return same_grasp and float(abs(paths[0].axis @ paths[1].axis)) > tuning.ALONG


def referenced(found: Iterable[Segment]) -> bool:
    """At least one kind of segment was recorded both with and without the load."""
    loaded: set[str] = set()
    empty: set[str] = set()
    for segment in found:
        (loaded if segment.loaded else empty).add(segment.kind)
    return bool(loaded & empty)


def _has_counterpart(one: Segment, found: Iterable[Segment]) -> bool:
    return any(_comparable(one, other) for other in found)


def _comparable(one: Segment, other: Segment) -> bool:
    """Two passes, one with the load and one without, have the same motion, so that the inertia of
    the arm, far larger than the load's, cancels."""
    if one.kind != other.kind or one.loaded == other.loaded:
        return False
    apart = one.acceleration - np.interp(one.path, other.path, other.acceleration)
    return float(np.sqrt(np.mean(apart**2))) < tuning.SAME_MOTION


def _loaded_and_empty(load: Load) -> tuple[tuple[bool, Mask], tuple[bool, Mask]]:
    return (True, load.loaded), (False, load.empty)


def _rests(trace: Trace, recording: Recording, load: Load, path: Path | None) -> Iterator[Cut]:
    """Rests at the pose of `recording`, and `recording` itself, however much the arm swung."""
    samples = trace.samples
    measured = (samples.t >= recording.start) & (samples.t <= recording.end)
    here = (at_rest(samples) & near(samples, mean_pose(trace.of(recording)))) | measured
    for loaded, mask in _loaded_and_empty(load):
        for rows in runs(here & mask):
            if rows.stop - rows.start >= tuning.REST_ROWS:
                yield Cut(f"rest {_arrival(samples, rows.start, path)}", loaded, rows)


def _turns(trace: Trace, recording: Recording) -> Iterator[tuple[Cut, Sequence[slice]]]:
    """Each turn where the object was measured, with it and without, in bins that all of them have."""
    context, here = recording.context, mean_pose(trace.of(recording))
    found: list[tuple[bool, dict[tuple[int, int], slice]]] = []
    for one in trace.recordings:
        holding = one.context.holding
        if one.context.activity == "turning" and holding in (None, context.holding):
            begins = mean_pose(trace.of(one).where(slice(0, 1)))
            if begins.distance_to(here) < tuning.NEAR and begins.angle_to(here) < tuning.NEAR_ANGLE:
                found.append((holding is not None, turns(trace, one)))
    if {loaded for loaded, _ in found} != {True, False}:
        return
    (_, first), *others = found
    common = [place for place in sorted(first) if all(place in bits for _, bits in others)]
    for loaded, bits in found:
        for number in sorted({turn for turn, _ in common}):
            bins = [bits[turn, place] for turn, place in common if turn == number]
            every = np.arange(len(trace.samples), dtype=np.intp)
            yield (
                Cut(f"{TURN} {number}", loaded, np.concatenate([every[one] for one in bins])),
                bins,
            )


def _turned(
    segment: Segment, signals: _Signals, bins: Sequence[slice], here: Pose, gravity: float
) -> Segment:
    """A turn, its moments in axes that turn with the hand from `here`, with what keeps the load on its circle."""
    samples = signals.samples
    angles: list[float] = []
    maps = segment.maps.copy()
    for i, rows in enumerate(bins):
        now = mean_pose(samples.where(rows)).rotation @ here.rotation.T
        rate = float(samples.twist[rows, 5].mean())
        angles.append(float(np.arctan2(now[1, 0], now[0, 0])))
        inward = -(rate**2) / gravity * now @ LEVER
        maps[i, :, 3:] = maps[i, :, 3:] @ now + maps[i, :, :3] @ inward
    return replace(segment, maps=maps, turned=np.array(angles))


def _arrival(samples: Samples, row: int, path: Path | None) -> str:
    """Direction of the arm's arrival at the rest at `row`: `up` or `down` the path, or `beside` it."""
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


@once
def _steady(samples: Samples) -> Mask:
    """Rows where the arm does not change its speed."""
    change = acceleration(samples, tuning.SPEED_SMOOTH)
    return np.linalg.norm(change, axis=1) < tuning.STEADY


@once
def _moves(samples: Samples) -> Mask:
    return np.linalg.norm(samples.twist[:, :3], axis=1) > tuning.PASS_SPEED


def _passes(trace: Trace, load: Load, path: Path, steady: Mask) -> list[Cut]:
    """Motions along the path that cover enough of it, up and down; where the arm goes steadily, if
    that is enough of this way both with the load and without."""
    samples, anyhow = trace.samples, np.ones_like(steady)
    speed = np.gradient(path.progress(samples), samples.t)
    ways = {"up": speed > tuning.PASS_SPEED, "down": speed < -tuning.PASS_SPEED}
    found: list[Cut] = []
    for kind, moving in ways.items():
        calm = list(_motions(samples, load, path, kind, moving & steady))
        if {cut.loaded for cut in calm} == {True, False}:
            found += calm
        else:
            found += _motions(samples, load, path, kind, moving & anyhow)
    return found


def _motions(samples: Samples, load: Load, path: Path, kind: str, which: Mask) -> Iterator[Cut]:
    progress, inside = path.progress(samples), path.inside(samples) & which
    for loaded, mask in _loaded_and_empty(load):
        for rows in _joined(inside & mask, samples.t):
            if np.ptp(progress[rows]) > tuning.COVERED * path.length:
                yield Cut(kind, loaded, rows)


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


def _binned(signals: _Signals, passes: Sequence[Cut]) -> list[Segment]:
    """Passes in bins along the stretch of the path that all of them cover."""
    if not passes:
        return []
    progress = signals.progress
    low = max(float(progress[cut.rows].min()) for cut in passes)
    high = min(float(progress[cut.rows].max()) for cut in passes)
    bins = np.digitize(progress, np.linspace(low, high, tuning.BINS + 1)) - 1
    found: list[Segment] = []
    for cut in passes:
        rows = np.arange(len(progress))[cut.rows]
        filled = [k for k in range(tuning.BINS) if np.any(bins[rows] == k)]
        found.append(_segment(signals, cut, [rows[bins[rows] == k] for k in filled]))
    return found


def _segment(signals: _Signals, cut: Cut, bins: Sequence[Rows]) -> Segment:
    """A cut's means over `bins`."""
    samples, t = signals.samples, signals.samples.t[cut.rows]
    return Segment(
        cut.kind,
        cut.loaded,
        max([time for time in signals.grasps if time <= t[0]], default=-np.inf),
        float(t[0]),
        float(t[-1]),
        _means(samples.t, bins),
        _means(signals.progress, bins),
        _means(signals.acceleration, bins),
        _means(signals.speed2, bins),
        signals.observed.maps(_means(samples.q, bins)),
        _means(signals.net, bins),
        np.array([signals.noise.white / len(samples.t[rows]) for rows in bins]),
        _means(signals.motion, bins),
        _means(signals.dahl, bins),
        np.zeros(len(bins)),
    )


def _means(signal: Array, bins: Sequence[Rows]) -> Array:
    return np.array([signal[rows].mean(axis=0) for rows in bins])
