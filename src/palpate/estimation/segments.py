"""Segmentation of a trace into rests, passes and turns, with and without the load.

The sensed wrench is load + bias. The bias depends on the arm's configuration, on the direction in
which its joints slide, on how it came to rest, and on time. It is the same with and without the
object, on the same path in the same direction.

A trace is therefore cut into segments, each loaded or empty and each of a *kind*. Segments of one
kind are comparable. A *rest* is at the pose where the object was measured. A *pass* is along the
straight line on which it was lifted. A *turn* of the hand at the measured pose is a pass, too: the
moment of the load turns with the hand, the bias of the sensors does not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Pose
from palpate.estimation.coloured_residual import ColouredResidual, Spans
from palpate.estimation.evidence import once
from palpate.estimation.joint_causes import learn_arm_residual
from palpate.estimation.joint_friction import slip_states
from palpate.estimation.load_blocks import CLEARANCE, joint_travel, rows_in_free_air
from palpate.estimation.load_noise import (
    LoadRows,
    Rows,
    SignalLevels,
    block_noise,
    flicker,
    load_rows,
)
from palpate.estimation.motion import (
    NEAR_ANGLE,
    Mask,
    acceleration,
    aligned_rows,
    at_rest,
    commanded_rows,
    mean_pose,
    row_at,
    runs,
    smoothed_with_rate,
    steady,
)
from palpate.estimation.wrench_observation import FOLLOWED, WrenchObservation, observe
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Samples, Trace

TURN_BINS = 8
"""number of bins of a turn, to a tilt or about the vertical; the first and the last are left out. Not sensitive."""
TURN_STEADY = 0.5
"""rad/s²: largest angular acceleration of an even turn, 3 mN m for a load of 0.006 kg m². Not sensitive."""
NEAR = 0.012
"""m: distance from the measured pose up to which a rest counts as the same pose (a loaded arm sags
by m g / k). Not sensitive."""
CORRIDOR = 0.02
"""m: distance of a pass from the line between the grasp and the measured pose. Sensitive: mass 0.7 σ, std ×1.0–1.3."""
SHORT_LIFT = 0.4
"""fraction of the path left out near the support, where the lift is short. Not sensitive."""
COVERED = 0.4
"""fraction of the lift that a pass must cover, so that all passes have bins in common. Sensitive:
mass 1.5 σ, std ×1.0–1.5."""
DENSE = 0.1
"""fraction of the rows between its ends that a pass must have; a pass that changes its speed has 0.3. Not sensitive."""
LIFT_MIN = 0.02
"""m: shortest lift along which passes are compared. Not sensitive."""
REST_ROWS = 5
"""rows: shortest rest, so that its mean has a scatter. Sensitive: mass 0.08 σ."""
ARRIVAL = 0.02
"""m: last stretch before a rest. Its direction determines the friction in the joints. Not sensitive."""
ALONG = 0.7
"""cosine between that stretch and the path from which the rest was reached along the path.
Sensitive: mass 0.2 σ, std ×0.9–1.0."""
PASS_SPEED = 0.01
"""m/s along the path above which the joints certainly slide. Sensitive: mass 0.2 σ, std ×0.9–1.1;
com 0.1 σ, std ×1.0–1.1."""
ALIKE_SPEED = 0.5
"""fraction of the speed of the slowest pass above which noise in motion counts as that of the
passes. Chosen: it keeps the ramps of passes and leaves out descents of a tenth of their speed.
Sensitive: mass std ×1.0–1.3 at 0.3, none at 0.8."""
SAME_MOTION = 0.25
"""m/s², root mean square along the path: passes whose accelerations differ by more are not compared. Not sensitive."""
BINS = 10
"""number of bins along the path, so that passes are compared at the same configurations. Sensitive: mass 0.3 σ."""
PAUSE = 0.5
"""s: longest gap between two stretches of one pass. A motion changes its speed near objects. Not sensitive."""

TURN = "turn"
"""Prefix of the kinds of turns."""
LEVER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""Matrix from the lever of a weight to its moment about the TCP per newton, world axes."""


@dataclass(frozen=True, slots=True, eq=False)
class LiftPath:
    """Straight line of a lift, from the grasp to the measured pose."""

    origin: Array  # (3,) m, world, the grasp
    axis: Array  # (3,) unit vector
    length: float  # m
    pose: Pose  # of the measurement

    def progress(self, samples: Samples) -> Array:
        """Project the TCP onto the line: (n,) m from its origin."""
        return (samples.pose_world_tcp[:, :3] - self.origin) @ self.axis

    def inside(self, samples: Samples) -> Mask:
        """Return the rows on the line, clear of the support and in the measured orientation."""
        relative = samples.pose_world_tcp[:, :3] - self.origin
        # Position along the line, and distance from it.
        along = relative @ self.axis
        beside = np.linalg.norm(relative - along[:, None] * self.axis, axis=1)
        clearance = min(CLEARANCE, SHORT_LIFT * self.length)
        clear = (along > clearance) & (along < self.length)
        return clear & (beside < CORRIDOR) & aligned_rows(samples, self.pose)


def lift_path(trace: Trace, recording: Recording, load: LoadRows) -> LiftPath | None:
    """Find the path of the lift before `recording`; None where the grasp is not in the trace or at the same place."""
    before = [time for time in load.grasps if time <= recording.start]
    window = trace.of(recording)
    if not before or not len(window):
        return None
    grasp = trace.samples.pose_world_tcp[row_at(trace.samples, before[-1]), :3]
    measured = mean_pose(window)
    line = measured.position - grasp
    length = float(np.linalg.norm(line))
    if length <= LIFT_MIN:
        return None
    return LiftPath(grasp, line / length, length, measured)


def turn_bins(trace: Trace, recording: Recording) -> dict[tuple[int, int], slice]:
    """Cut each turn in a recording into bins of rotation.

    Bins are at the same shares of the turn in every recording. Bins with a changing rate of rotation are left out.

    Returns:
        Rows by the number of the turn and the number of the bin.
    """
    samples, t = trace.samples, trace.samples.t
    inside = (t >= recording.start) & (t <= recording.end)
    edges = np.linspace(0.0, 1.0, TURN_BINS + 1)[1:-1]
    found: dict[tuple[int, int], slice] = {}
    for i, turn in enumerate(runs(commanded_rows(samples) & inside)):
        if turn.stop - turn.start <= TURN_BINS * REST_ROWS:
            continue
        # Angle from the start of the turn, made monotonic, and the rows at the bin edges.
        quaternions = samples.pose_world_tcp[turn, 3:]
        angle = 2.0 * np.arccos(np.minimum(np.abs(quaternions @ quaternions[0]), 1.0))
        progress: Array = np.maximum.accumulate(angle)
        cuts: NDArray[np.intp] = np.asarray(
            np.searchsorted(progress, edges * progress[-1]), np.intp
        )
        for k, (first, last) in enumerate(pairwise((cuts + turn.start).tolist())):
            if last - first < REST_ROWS:
                continue
            # At a constant rate no inertial moment adds to that of the weight: fit its linear trend.
            since = t[first:last] - t[first:last].mean()
            trend = since @ samples.twist[first:last, 3:] / float(since @ since)
            if float(np.linalg.norm(trend)) < TURN_STEADY:
                found[i, k] = slice(first, last)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """Rest, or pass in k bins along the path."""

    # `up`, `down` (passes), `rest ...` with the direction of arrival, or `turn ...` with its number.
    kind: str
    loaded: bool  # with the object in the hand
    grasp: float  # s, last time at which the hand took or left an object
    # start, end: s
    start: float
    end: float
    t: Array  # (k,) mean time, s
    path: Array  # (k,) m along the path
    acceleration: Array  # (k,) vertical, m/s²
    speed2: Array  # (k,) m²/s², squared speed
    maps: Array  # (k, m, 6) m signals per unit wrench (`WrenchObservation.maps`)
    observed: Array  # (k, m) means of the signals
    variance: Array  # (k, m) variance of white noise in them
    # (k, m) N m that moved the arm's own links, already subtracted from `observed`; (k, 0) where the links are unknown.
    motion: Array
    # (k, m, 2 e) Dahl states of the joints (`joint_friction.slip_states`); (k, 0, 0) where the
    # signals are not joint torques.
    dahl: Array
    # (k,) rad, rotation of the hand about the vertical since the load was measured; the load and
    # the moments in `maps` turn with it.
    turned: Array
    spans: Spans  # stretches of motion that the bins average

    @property
    def at_rest(self) -> bool:
        """True for a rest."""
        return self.kind.startswith("rest")

    @property
    def turns(self) -> bool:
        """True for a turn."""
        return self.kind.startswith(TURN)


@dataclass(frozen=True, slots=True)
class SegmentCut:
    """Rows of one rest or pass; `kind` as that of a `Segment`."""

    kind: str
    loaded: bool
    rows: Rows


@dataclass(frozen=True, slots=True, eq=False)
class Weighing:
    """Segments of a trace with and without a load, along one path."""

    segments: Sequence[Segment]  # rests and passes with and without the load
    noise: SignalLevels  # of the signals
    scale: Array  # (m,) of the signals, see `WrenchObservation`
    # Residual of the arm's model with an empty hand; None where it was not recorded or not learned.
    left: ColouredResidual | None = None

    @property
    def spans(self) -> Spans:
        """Stretches of all bins, segment after segment."""
        return Spans.concatenate([segment.spans for segment in self.segments])

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise, the residual of the arm's model included."""
        if self.left is None:
            return self.noise.freedom
        # Mean variance of the sensor noise: white noise, and 1/f noise at zero lag.
        white = np.concatenate([segment.variance for segment in self.segments]).mean(axis=0)
        slow = self.noise.flicker * float(flicker(np.zeros(1))[0])
        return self.left.freedom_beside(white + slow, self.noise.freedom, self.spans)

    @property
    def grasps(self) -> Sequence[float]:
        """Times (s) of the grasps in which the load was weighed."""
        return sorted({segment.grasp for segment in self.segments if segment.loaded})


@once
def weighing(trace: Trace, recording: Recording, learned: bool = True) -> Weighing:
    """Find the rests and passes that weigh the load of `recording`, with and without it.

    Args:
        learned: learn the residual of the arm's model from motion of the empty hand.
    """
    load = load_rows(trace, recording.context.holding)
    path = lift_path(trace, recording, load)
    # Cut the trace into rests, passes and turns.
    rests = list(_rests(trace, recording, load, path))
    passes = [] if path is None else _passes(trace.samples, load, path)
    turned = list(_turns(trace, recording))
    signals = _Signals.of(trace, load, path, [*rests, *passes, *(cut for cut, _ in turned)])
    # Average them: rests without a commanded motion, and passes that have a comparable one.
    moving = commanded_rows(trace.samples)
    found = [signals.segment(cut, [cut.rows]) for cut in rests if not moving[cut.rows].any()]
    binned = _bin_passes(signals, passes)
    found += [one for one in binned if any(comparable_passes(one, other) for other in binned)]
    here = mean_pose(trace.of(recording))
    found += [_turn_segment(signals, *one, here, trace.gravity) for one in turned]
    if not any(segment.loaded for segment in found):
        # The object was recorded in motion only: keep all rests.
        found = [signals.segment(cut, [cut.rows]) for cut in rests]
    left = learn_arm_residual(trace, recording.context.holding or "") if learned else None
    return Weighing(found, signals.noise, signals.observed.scale, left)


def weigh_cuts(trace: Trace, name: str, cuts: Sequence[SegmentCut]) -> Weighing:
    """Weigh the load `name` from given cuts at one place; cuts are compared within each kind."""
    signals = _Signals.of(trace, load_rows(trace, name), None, cuts)
    found = [signals.segment(cut, [cut.rows]) for cut in cuts]
    return Weighing(found, signals.noise, signals.observed.scale, learn_arm_residual(trace, name))


def weighings(trace: Trace, recording: Recording, learned: bool = True) -> Sequence[Weighing]:
    """List the weighings of the object held during `recording`, see `weighing`.

    There is one per path on which the object was lifted and held still.
    """
    measured = [recording]
    for other in trace.recordings:
        still = other.buffer == FORCES and other.context.activity == "still"
        held = other.context.holding == recording.context.holding
        if still and held and not any(_same_place(trace, other, one) for one in measured):
            measured.append(other)
    return [weighing(trace, one, learned) for one in measured]


def _same_place(trace: Trace, one: Recording, other: Recording) -> bool:
    """Return true if two recordings belong to one lift, or to lifts along the same path."""
    if one is other:
        return True
    load = load_rows(trace, one.context.holding)
    first, second = lift_path(trace, one, load), lift_path(trace, other, load)
    if first is None or second is None:
        return first is second
    same_grasp = float(np.linalg.norm(first.origin - second.origin)) < NEAR
    return same_grasp and float(abs(first.axis @ second.axis)) > ALONG


def has_reference(found: Iterable[Segment]) -> bool:
    """Return true if at least one kind of segment was recorded with and without the load."""
    kinds = {(segment.kind, segment.loaded) for segment in found}
    return any((kind, not loaded) in kinds for kind, loaded in kinds)


@dataclass(frozen=True, slots=True, eq=False)
class _Signals:
    """Signals of a trace, row by row, that segments average."""

    samples: Samples
    observed: WrenchObservation
    net: Array
    motion: Array
    noise: SignalLevels
    acceleration: Array
    speed2: Array
    progress: Array
    grasps: tuple[float, ...]
    dahl: Array
    path: Array

    @classmethod
    def of(
        cls, trace: Trace, load: LoadRows, path: LiftPath | None, cuts: Iterable[SegmentCut]
    ) -> _Signals:
        """Prepare the signals of a trace; the torques that move the arm's links only in the rows of
        `cuts`."""
        samples, t = trace.samples, trace.samples.t
        observed, rising = observe(trace), acceleration(samples, FOLLOWED)[:, 2]
        used, cuts = np.zeros(len(samples), dtype=bool), tuple(cuts)
        for cut in cuts:
            used[cut.rows] = True
        # Torque that moves the arm's links, in the rows of the cuts.
        motion = observed.own_motion(samples, used, FOLLOWED)
        # Average the signals like the motion, so that fast changes do not show as a difference.
        net = smoothed_with_rate(observed.signals, t, FOLLOWED)[0]
        if motion.shape[1]:
            net = net - motion
        # Rows that show the sensor noise: rests, and steady motion about as fast as the passes. In
        # a slow guarded descent gear ripple would pass for 1/f noise of the passes.
        speed = np.linalg.norm(samples.twist[:, :3], axis=1)
        passes = [float(speed[cut.rows].mean()) for cut in cuts if cut.kind in ("up", "down")]
        moves = speed > max(PASS_SPEED, ALIKE_SPEED * min(passes, default=0.0))
        # Friction with a support is no noise of the sensors: motion counts in free air alone.
        moves &= steady(samples) & rows_in_free_air(trace)
        calm = (at_rest(samples) | moves) & (load.loaded | load.empty)
        joints = observed.chain is not None
        return cls(
            samples,
            observed,
            net,
            motion,
            noise=block_noise(observed.signals, t, rising, list(runs(calm))),
            acceleration=rising,
            speed2=(samples.twist[:, :3] ** 2).sum(axis=1),
            progress=path.progress(samples) if path is not None else np.zeros(len(samples)),
            grasps=load.grasps,
            dahl=slip_states(samples) if joints else np.zeros((len(samples), 0, 0)),
            path=joint_travel(samples),
        )

    def segment(self, cut: SegmentCut, bins: Sequence[Rows]) -> Segment:
        """Average a cut over `bins`."""
        samples, t = self.samples, self.samples.t[cut.rows]

        def means(signal: Array) -> Array:
            return np.array([signal[rows].mean(axis=0) for rows in bins])

        # The grasp is the last one before the cut; white noise averages out over the rows of a bin.
        return Segment(
            cut.kind,
            cut.loaded,
            grasp=max([time for time in self.grasps if time <= t[0]], default=-np.inf),
            start=float(t[0]),
            end=float(t[-1]),
            t=means(samples.t),
            path=means(self.progress),
            acceleration=means(self.acceleration),
            speed2=means(self.speed2),
            maps=self.observed.maps(means(samples.q)),
            observed=means(self.net),
            variance=np.array([self.noise.white / len(samples.t[rows]) for rows in bins]),
            motion=means(self.motion),
            dahl=means(self.dahl),
            turned=np.zeros(len(bins)),
            spans=Spans.of(self.samples.t, self.path, bins, self.samples.q),
        )


def comparable_passes(one: Segment, other: Segment) -> bool:
    """Return true if two passes, one loaded and one empty, have the same motion.

    The inertial force of the arm, far larger than that of the load, then cancels.
    """
    if one.kind != other.kind or one.loaded == other.loaded:
        return False
    # Root mean square difference of the accelerations at the same places.
    apart = one.acceleration - np.interp(one.path, other.path, other.acceleration)
    return float(np.sqrt(np.mean(apart**2))) < SAME_MOTION


def _rests(
    trace: Trace, recording: Recording, load: LoadRows, path: LiftPath | None
) -> Iterator[SegmentCut]:
    """Yield the rests at the pose of `recording`, and `recording` itself even if the arm oscillated."""
    samples, pose = trace.samples, mean_pose(trace.of(recording))
    measured = (samples.t >= recording.start) & (samples.t <= recording.end)
    # Rows near the measured pose, with a margin as a loaded arm sags.
    away = np.linalg.norm(samples.pose_world_tcp[:, :3] - pose.position, axis=1)
    near = (away < NEAR) & aligned_rows(samples, pose)
    here = (at_rest(samples) & near) | measured
    for loaded, mask in ((True, load.loaded), (False, load.empty)):
        for rows in runs(here & mask):
            if rows.stop - rows.start >= REST_ROWS:
                yield SegmentCut(f"rest {arrival(samples, rows.start, path)}", loaded, rows)


def arrival(samples: Samples, row: int, path: LiftPath | None) -> str:
    """Classify the arm's arrival at the rest at `row`: `up` or `down` the path, or `beside` it."""
    if path is None:
        return "beside"
    # Commanded motion over the last `ARRIVAL` metres before the rest.
    moved = samples.target_world_tcp[row, :3] - samples.target_world_tcp[: row + 1, :3]
    far = np.flatnonzero(np.linalg.norm(moved, axis=1) > ARRIVAL)
    if not len(far):
        return "beside"
    along = float(moved[far[-1]] @ path.axis) / ARRIVAL
    if along > ALONG:
        return "up"
    return "down" if along < -ALONG else "beside"


def _passes(samples: Samples, load: LoadRows, path: LiftPath) -> list[SegmentCut]:
    """Find the motions along the path that cover enough of it, up and down.

    Rows of constant speed are preferred. Rows of any speed are used where those cover too little of
    the path with or without the load.
    """
    # Place on the line and speed along it.
    progress, inside = path.progress(samples), path.inside(samples)
    speed = np.gradient(progress, samples.t)

    def motions(kind: str, which: Mask) -> Iterator[SegmentCut]:
        for loaded, mask in ((True, load.loaded), (False, load.empty)):
            for rows in _join_passes(inside & which & mask, samples.t):
                # A few rows far apart are no pass: they would leave the others hardly any common stretch.
                dense = len(rows) > DENSE * (rows[-1] - rows[0])
                if dense and np.ptp(progress[rows]) > COVERED * path.length:
                    yield SegmentCut(kind, loaded, rows)

    # Prefer steady rows for each direction.
    ways = {"up": speed > PASS_SPEED, "down": speed < -PASS_SPEED}
    found: list[SegmentCut] = []
    for kind, moving in ways.items():
        calm = list(motions(kind, moving & steady(samples)))
        both = {cut.loaded for cut in calm} == {True, False}
        found += calm if both else motions(kind, moving)
    return found


def _join_passes(moving: Mask, t: Array) -> list[NDArray[np.intp]]:
    """List the rows of each pass; join stretches with a short gap, where the arm changes its speed."""
    found: list[NDArray[np.intp]] = []
    for stretch in runs(moving):
        rows: NDArray[np.intp] = np.arange(stretch.start, stretch.stop, dtype=np.intp)
        if found and t[rows[0]] - t[found[-1][-1]] < PAUSE:
            found[-1] = np.concatenate([found[-1], rows])
        else:
            found.append(rows)
    return found


def _bin_passes(signals: _Signals, passes: Sequence[SegmentCut]) -> list[Segment]:
    """Average the passes in bins along the stretch of the path that all of them cover."""
    if not passes:
        return []
    progress = signals.progress
    # Common stretch of all passes, in equal bins.
    low = max(float(progress[cut.rows].min()) for cut in passes)
    high = min(float(progress[cut.rows].max()) for cut in passes)
    bins = np.digitize(progress, np.linspace(low, high, BINS + 1)) - 1
    found: list[Segment] = []
    for cut in passes:
        # Average the bins that hold rows of this pass.
        rows = np.arange(len(progress))[cut.rows]
        filled = [k for k in range(BINS) if np.any(bins[rows] == k)]
        if not filled:  # a change of speed within the common stretch
            continue
        found.append(signals.segment(cut, [rows[bins[rows] == k] for k in filled]))
    return found


def _turns(trace: Trace, recording: Recording) -> Iterator[tuple[SegmentCut, Sequence[slice]]]:
    """Yield each turn at the measured pose, with and without the object, in bins that all of them have."""
    context, here = recording.context, mean_pose(trace.of(recording))
    found: list[tuple[bool, dict[tuple[int, int], slice]]] = []
    # Turns of the empty hand or of the same object that begin at the measured pose.
    for one in trace.recordings:
        holding = one.context.holding
        if one.context.activity == "turning" and holding in (None, context.holding):
            begins = mean_pose(trace.of(one).where(slice(0, 1)))
            if begins.distance_to(here) < NEAR and begins.angle_to(here) < NEAR_ANGLE:
                found.append((holding is not None, turn_bins(trace, one)))
    if {loaded for loaded, _ in found} != {True, False}:
        return
    # Keep the bins that all recordings have in common.
    (_, first), *others = found
    common = [place for place in sorted(first) if all(place in bits for _, bits in others)]
    for loaded, bits in found:
        for number in sorted({turn for turn, _ in common}):
            bins = [bits[turn, place] for turn, place in common if turn == number]
            every = np.arange(len(trace.samples), dtype=np.intp)
            rows = np.concatenate([every[one] for one in bins])
            yield SegmentCut(f"{TURN} {number}", loaded, rows), bins


def _turn_segment(
    signals: _Signals, cut: SegmentCut, bins: Sequence[slice], here: Pose, gravity: float
) -> Segment:
    """Average a turn, with its moments in axes that turn with the hand from `here`.

    The centripetal force of the load is included.
    """
    segment, samples = signals.segment(cut, bins), signals.samples
    angles: list[float] = []
    maps = segment.maps.copy()
    for i, rows in enumerate(bins):
        # Rotation of the hand since the measured pose, and its rate about the vertical.
        now = mean_pose(samples.where(rows)).rotation @ here.rotation.T
        rate = float(samples.twist[rows, 5].mean())
        angles.append(float(np.arctan2(now[1, 0], now[0, 0])))
        # Moments in the turned axes, and the centripetal force m ω² r of the lever that belongs to them.
        inward = -(rate**2) / gravity * now @ LEVER
        maps[i, :, 3:] = maps[i, :, 3:] @ now + maps[i, :, :3] @ inward
    return replace(segment, maps=maps, turned=np.array(angles))
