"""Holds of an object at rest in free air, level and tilted, and their load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.estimation.estimate import map_shared
from palpate.estimation.grip import Droop, PutDownRecord
from palpate.estimation.load_fit import LoadEstimate, fit_load
from palpate.estimation.load_noise import load_rows
from palpate.estimation.motion import at_rest, commanded_rows, mean_pose, runs
from palpate.estimation.segments import (
    NEAR,
    Segment,
    SegmentCut,
    Weighing,
    turn_bins,
    weigh_cuts,
    weighings,
)
from palpate.estimation.weighing import WHOLE_APART, whole_of
from palpate.mjcf.body import Body
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

AT_GRASP = 0.05
"""s before and after the hand closed, over which its pose is averaged. Sensitive: no."""
TILT_HELD = 0.5
"""s. Shortest rest that counts as a held tilt. Sensitive: no."""


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """Hold of an object at rest."""

    recording: Recording  # recording of the hold
    grasp: float  # s, time at which the hand had closed on the object
    pose_world_tcp: Pose  # mean pose of the hand during the hold
    # Pose of the object in the hand: its pose in the scene relative to the measured hand as it closed.
    pose_tcp_body: Pose
    droop: Droop  # rotation in the grip since the grasp
    swept: float  # rad, total angle by which tilts have turned the hand since the grasp

    @property
    def along(self) -> Array:
        """Direction (3,), world, along the fingers; closing fingers do not centre the object along it."""
        return self.pose_world_tcp.rotation[:, 0]


@dataclass(frozen=True, slots=True, eq=False)
class ObjectHolds:
    """All holds of one object, n of them."""

    load: LoadEstimate  # load on the hand; each of its `grasps` is one of the holds
    by_all_motion: bool  # True if the load is that of all free motion around the holds
    holds: Sequence[Hold]  # the holds, in the order of the load's grasps
    weighings: Sequence[Weighing]  # segments to which the load was fitted
    put_down: Sequence[PutDownRecord]  # ends of the grasps in which the object was held at rest

    @property
    def turned(self) -> bool:
        """True if the evidence includes a rotation about the vertical."""
        return any(segment.turns for weighing in self.weighings for segment in weighing.segments)

    def droop(self, grasp: float, time: float) -> Droop:
        """Droop of the object in a grasp at `time`, s."""
        moments = (hold.droop.moment for hold in self.holds if hold.grasp == grasp)
        return Droop.since(grasp, time, next(moments, 0.0))


def find_holds(trace: Trace, body: Body) -> ObjectHolds | None:
    """Find all holds of `body`; None if it was never held at rest in the air."""
    still = _recordings(trace, body.name, "still")
    if not still:
        return None
    # After a tilt or a swing the object may have rotated in the fingers.
    turned = [*_recordings(trace, body.name, "tilting"), *_recordings(trace, body.name, "swinging")]
    # The pose in the hand is known for the grasps with a recording at rest.
    shown = {grasp_time(trace, one, body): one for one in reversed(still)}
    # Keep the loaded segments of those grasps that precede any tilt or swing of the same grasp.
    level: list[Weighing] = []
    for weighed in weighings(trace, still[0]):
        kept: list[Segment] = []
        for segment in weighed.segments:
            since = [one for one in turned if segment.grasp < one.start < segment.start]
            if not segment.loaded or (segment.grasp in shown and not since):
                kept.append(segment)
        level.append(replace(weighed, segments=kept))
    # Fit one load to the level and tilted holds.
    recordings = [shown[grasp] for one in level for grasp in one.grasps]
    tilted = list(tilted_holds(trace, body.name))
    found = [*level, *(weighed for _, weighed in tilted)]
    load = fit_load(found, trace.gravity, trace.hand)
    keys = [grasp for one in found for grasp in one.grasps]
    by_key = dict(zip(keys, [*recordings, *(one for one, _ in tilted)], strict=True))
    # Pair each moment of the fit with its hold, and estimate the droop in the grip.
    holds: list[Hold] = []
    moments: dict[float, float] = {}
    for grasp, moment in zip(load.grasps, load.value[1:].reshape(-1, 2), strict=True):
        recording = by_key[grasp]
        here, time = mean_pose(trace.of(recording)), grasp_time(trace, recording, body)
        # Each grasp is held level before it is tilted, so that its first moment is the level one.
        closing = moments.setdefault(time, float(here.rotation[:2, 1] @ moment))
        middle = (recording.start + recording.end) / 2.0
        holds.append(
            Hold(
                recording,
                grasp=time,
                pose_world_tcp=here,
                pose_tcp_body=pose_in_hand(trace, recording, body),
                droop=Droop.since(time, middle, closing),
                swept=swept_angle(trace, body.name, time, middle),
            )
        )
    # Without tilts, all motion around the weighings may give a more precise load.
    put_down = tuple(_put_down(trace, body.name, holds))
    better = None if tilted else _of_whole(trace, still[0], found, load, holds)
    return ObjectHolds(better or load, better is not None, holds, found, put_down)


def _of_whole(
    trace: Trace,
    recording: Recording,
    found: Sequence[Weighing],
    load: LoadEstimate,
    holds: Sequence[Hold],
) -> LoadEstimate | None:
    """Load of level holds from all motion around their weighings.

    Returns None unless the result is more precise and agrees with the weighings in force and moments.
    """
    whole = whole_of(trace, recording, found, load)
    if whole is None:
        return None
    tools = [hold.pose_world_tcp.rotation for hold in holds]
    turned = whole.at([hold.grasp for hold in holds], tools)
    if turned is None:
        return None
    # Refer the load to the holds, and compare it with the weighings.
    value, covariance = turned @ whole.value, turned @ whole.covariance @ turned.T
    apart = np.abs(value - load.value) / np.sqrt(np.diag(load.covariance))
    if apart.max() > WHOLE_APART:
        return None
    return replace(
        load, value=value, covariance=covariance, shared=map_shared(whole.shared, turned)
    )


def _put_down(trace: Trace, name: str, holds: Sequence[Hold]) -> Iterator[PutDownRecord]:
    """Yield the end of each grasp after which the hand opened, in order."""
    changes = load_rows(trace, name).grasps
    first = {hold.grasp: hold for hold in reversed(holds)}
    for hold in sorted(first.values(), key=lambda each: each.grasp):
        opened = next((time for time in changes if time > hold.grasp), np.inf)
        if np.isfinite(opened):
            droop = Droop.since(hold.grasp, opened, hold.droop.moment)
            swept = swept_angle(trace, name, hold.grasp, opened)
            yield PutDownRecord(hold.grasp, hold.pose_tcp_body, droop, swept)


def swept_angle(trace: Trace, name: str, since: float, until: float) -> float:
    """Total angle, rad, by which tilts turned the hand with an object between two times, s, in either direction."""
    samples = trace.samples
    t, moving = samples.t, commanded_rows(samples)
    swept = 0.0
    # Integrate the rotation rate over the commanded parts of each tilt.
    for recording in _recordings(trace, name, "tilting"):
        start, end = max(since, recording.start), min(until, recording.end)
        rows = moving & (t >= start) & (t <= end)
        speeds = np.linalg.norm(samples.twist[rows, 3:], axis=1)
        swept += float(speeds @ np.gradient(t)[rows])
    return swept


def _recordings(trace: Trace, name: str, activity: str) -> list[Recording]:
    """Force recordings of an object held during an activity."""
    return [
        one
        for one in trace.recordings
        if one.buffer == FORCES and one.context.activity == activity and one.context.holding == name
    ]


def tilted_holds(trace: Trace, name: str) -> Iterator[tuple[Recording, Weighing]]:
    """Yield each part of a rotation to a tilt, and each rest there, as a recording with its weighing.

    The weighing compares it with the same part of the empty hand's rotation.
    """
    # Pair each loaded tilt with one of the empty hand that starts at the same pose.
    empty = [
        one
        for one in trace.recordings
        if one.context.activity == "tilting" and one.context.holding is None
    ]
    for recording in _recordings(trace, name, "tilting"):
        here = mean_pose(trace.of(recording).where(slice(0, 1)))
        for own in empty:
            there = mean_pose(trace.of(own).where(slice(0, 1)))
            if here.distance_to(there) < NEAR:
                yield from tilt_parts(trace, recording, own)
                break


def tilt_parts(
    trace: Trace, loaded: Recording, empty: Recording
) -> Iterator[tuple[Recording, Weighing]]:
    """Yield the parts that a loaded and an empty tilt share, each with its weighing."""
    # Weigh all parts that both tilts have, in one fit of their noise.
    t, own = trace.samples.t, _parts(trace, empty)
    mine = {kind: rows for kind, rows in _parts(trace, loaded).items() if kind in own}
    cuts = [SegmentCut(kind, True, rows) for kind, rows in mine.items()]
    cuts += [SegmentCut(kind, False, own[kind]) for kind in mine]
    together = weigh_cuts(trace, loaded.context.holding or "", cuts)
    context = replace(loaded.context, activity="still")
    for kind, rows in mine.items():
        start, end = float(t[rows.start]), float(t[rows.stop - 1])
        # A tilted hand has another moment, so each part counts as a grasp from its start.
        segments = [
            replace(segment, grasp=start) if segment.loaded else segment
            for segment in together.segments
            if segment.kind == kind
        ]
        part = replace(loaded, start=start, end=end, context=context)
        yield part, replace(together, segments=segments)


def _parts(trace: Trace, recording: Recording) -> dict[str, slice]:
    """Rows of a tilt recording by name: bins of each rotation, and each rest."""
    t = trace.samples.t
    # Bins of the rotations, and the rests that last long enough.
    inside = (t >= recording.start) & (t <= recording.end)
    parts = {f"tilt {i} {k}": rows for (i, k), rows in turn_bins(trace, recording).items()}
    rests = [
        rows
        for rows in runs(at_rest(trace.samples) & inside)
        if float(t[rows][-1] - t[rows][0]) > TILT_HELD
    ]
    return {**parts, **{f"rest {i}": rest for i, rest in enumerate(rests)}}


def pose_in_hand(trace: Trace, recording: Recording, body: Body) -> Pose:
    """Pose of the object in the hand: its pose where it stood relative to the measured hand as it closed."""
    time = grasp_time(trace, recording, body)
    if not np.isfinite(time):
        return mean_pose(trace.of(recording)).inverse() @ body.pose_at_rest
    at_grasp = trace.samples.between(time - AT_GRASP, time + AT_GRASP)
    return mean_pose(at_grasp).inverse() @ standing_pose(trace, body, time)


def standing_pose(trace: Trace, body: Body, until: float) -> Pose:
    """Pose (world) at which the object stands at a time, s: in the scene, then as each grasp has moved it.

    A grasp moves it by the commanded horizontal motion and turn about the vertical, from close to open. The support
    decides its height and its tilt.
    """
    pose, targets = body.pose_at_rest, trace.samples.target_world_tcp
    changes = [time for time in load_rows(trace, body.name).grasps if time <= until]
    rows = np.minimum(np.searchsorted(trace.t, changes), len(trace.t) - 1)
    # The changes alternate between closing and opening; the grasp at `until` has not opened.
    for closed, opened in zip(targets[rows][:-1:2], targets[rows][1::2], strict=False):
        start, end = Pose.of(closed[:3], closed[3:]), Pose.of(opened[:3], opened[3:])
        turned = end.rotation @ start.rotation.T
        yaw = np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1])
        turn = Pose.turn((0.0, 0.0, float(yaw)))
        shift = (end.position - turn.apply(start.position)) * (1.0, 1.0, 0.0)
        pose = turn.translate(shift) @ pose
    return pose


def grasp_time(trace: Trace, recording: Recording, body: Body) -> float:
    """Time, s, at which the hand closed on the object held in a recording; -inf if unknown."""
    grasps = load_rows(trace, body.name).grasps
    return max((time for time in grasps if time <= recording.start), default=-np.inf)
