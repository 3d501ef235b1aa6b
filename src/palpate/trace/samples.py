"""Samples of an execution, their valid part, and the part that concerns one object."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, NamedTuple, ParamSpec, Protocol, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from palpate.common.display import data_frame, table
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.trace.recording import Conversion, LeafRun, NominalHand, Recording

if TYPE_CHECKING:
    from pandas import DataFrame


FORCES = "gripper_forces"
POSE = "gripper_pose"


JOINTS, POSE_PARTS = "1 2 3 4 5 6 7", "x y z qw qx qy qz"
PARTS = {
    "q": ("q", JOINTS),
    "dq": ("dq", JOINTS),
    "tau_ext": ("tau_ext", JOINTS),
    "wrench": ("wrench_", "fx fy fz tx ty tz"),
    "wrench_sensor": ("sensor_", "fx fy fz tx ty tz"),
    "pose_world_tcp": ("tcp_", POSE_PARTS),
    "twist": ("twist_", "vx vy vz wx wy wz"),
    "target_world_tcp": ("target_", POSE_PARTS),
}
# Names of the columns of each signal that has several.
COLUMNS = {
    signal: tuple(f"{prefix}{part}" for part in parts.split())
    for signal, (prefix, parts) in PARTS.items()
}

# m/s^2: MuJoCo's default gravity. A scene with another value passes it on in the `Trace`.
STANDARD_GRAVITY = 9.81


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Samples:
    """Sensed signals, one row per log period (block means of the 1 kHz control loop)."""

    t: Array  # (n,) robot time, s
    q: Array  # (n, 7) joint positions, rad
    dq: Array  # (n, 7) joint velocities, rad/s
    tau_ext: Array  # (n, 7) measured joint torques less nominal gravity and friction, N m
    wrench: Array  # (n, 6) external wrench at the TCP in world axes (see the module's convention)
    pose_world_tcp: Array  # (n, 7) position (m) and quaternion wxyz of the TCP
    twist: Array  # (n, 6) linear (m/s) and angular (rad/s) velocity of the TCP, world axes
    target_world_tcp: Array  # (n, 7) the commanded equilibrium pose
    width: Array  # (n,) opening between the fingers, m
    # (n, 6) wrench of the six-axis sensor: N and N m that it exerts on everything below it, in its own axes about its
    # origin (`WrenchSensor`). (n, 0) for an arm without one.
    wrench_sensor: Array = field(default_factory=lambda: np.empty((0, 0)))

    def __post_init__(self) -> None:
        if not self.wrench_sensor.size:
            object.__setattr__(self, "wrench_sensor", np.empty((len(self.t), 0)))

    @classmethod
    def empty(cls) -> Samples:
        """Make samples without rows."""
        scalars, joints = np.empty(0), np.empty((0, 7))
        pose, wrench = np.empty((0, 7)), np.empty((0, 6))
        return cls(scalars, joints, joints, joints, wrench, pose, wrench, pose, scalars)

    @classmethod
    def concatenate(cls, parts: Iterable[Samples]) -> Samples:
        """Join the rows of `parts`, in order."""
        # Join every signal of the parts that have rows.
        parts = [part for part in parts if len(part)]
        if not parts:
            return cls.empty()
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def __len__(self) -> int:
        return len(self.t)

    def where(self, rows: NDArray[np.bool_] | slice) -> Samples:
        """Select rows by mask or slice."""
        return Samples(*(getattr(self, field.name)[rows] for field in fields(self)))

    def between(self, start: float, end: float) -> Samples:
        """Select the rows with start <= t <= end."""
        # Times are multiples of 5 ms except for rounding.
        first, last = np.searchsorted(self.t, [start, end + 1e-9])
        return self.where(slice(int(first), int(last)))


@dataclass(frozen=True, slots=True, eq=False, repr=False, weakref_slot=True)
class Trace:
    """The whole execution: samples, leaves, recordings, conversions, and the nominal hand."""

    samples: Samples
    leaves: tuple[LeafRun, ...]
    recordings: tuple[Recording, ...]
    conversions: tuple[Conversion, ...]
    hand: NominalHand
    gravity: float = STANDARD_GRAVITY

    @property
    def t(self) -> Array:
        """Robot time (n,), s."""
        return self.samples.t

    @property
    def wrench(self) -> Array:
        """External wrench (n, 6) at the TCP in world axes: N, N m (see the module's convention)."""
        return self.samples.wrench

    def columns(self) -> dict[str, Array]:
        """Return the columns of the samples by name, e.g. `t`, `q3`, `wrench_fz`, each (n,)."""
        # A signal with several components has one column for each.
        found: dict[str, Array] = {}
        for signal in fields(self.samples):
            values: Array = getattr(self.samples, signal.name)
            names = COLUMNS.get(signal.name, (signal.name,))
            # An arm without a sensor, or a recording without joints, has no columns of them.
            found |= zip(names, values.T if values.ndim > 1 else [values], strict=False)
        return found

    def to_dataframe(self) -> DataFrame:
        """Convert the samples to a pandas data frame, one row a sample, with the columns of `columns`.

        Raises:
            Unavailable: pandas is not installed.
        """
        return data_frame(self.columns())

    def __repr__(self) -> str:
        seconds = float(self.t[-1] - self.t[0]) if len(self.t) else 0.0
        recordings = "recording" if len(self.recordings) == 1 else "recordings"
        counts = f"{len(self.leaves)} actions, {len(self.recordings)} {recordings}"
        return f"<Trace: {seconds:.1f} s, {len(self.samples)} samples, {counts}>"

    def _repr_html_(self) -> str:
        rows = [(a.label, f"{a.start:.1f} s", f"{a.end:.1f} s", a.status) for a in self.leaves]
        return table(repr(self), ("action", "from", "to", "ended"), rows)

    def of(self, recording: Recording) -> Samples:
        """Return the samples of a recording."""
        return self.samples.between(recording.start, recording.end)

    def converted(self, parameter: Parameter) -> Recording | None:
        """Return the recording of the last conversion for `parameter`; None without one."""
        for conversion in reversed(self.conversions):
            if Parameter(conversion.object, conversion.quantity) == parameter:
                return conversion.recording
        return None

    def leaf_runs(self, *primitives: str, status: str = "SUCCESS") -> Sequence[LeafRun]:
        """Return the leaves of the named primitives that ended with `status`, in order of time."""
        return [a for a in self.leaves if a.primitive in primitives and a.status == status]

    def without(self, start: float, end: float) -> Trace:
        """Cut out the samples and recordings from robot time `start` to `end`; the leaves stay."""
        t = self.samples.t
        rest = self.samples.where((t < start) | (t > end))
        return self.part(rest, lambda one: one.end < start or one.start > end)

    def during(self, start: float, end: float) -> Trace:
        """Return the samples and recordings from robot time `start` to `end`, with the leaves that started by
        then.
        """
        part = self.part(
            self.samples.between(start, end), lambda one: start <= one.start and one.end <= end
        )
        return replace(part, leaves=tuple(leaf for leaf in self.leaves if leaf.start <= end))

    def part(self, samples: Samples, is_kept: Callable[[Recording], bool]) -> Trace:
        """Return the trace with some of its samples, and the recordings to keep with their conversions."""
        return replace(
            self,
            samples=samples,
            recordings=tuple(r for r in self.recordings if is_kept(r)),
            conversions=tuple(c for c in self.conversions if is_kept(c.recording)),
        )

    def until(self, time: float) -> Trace:
        """Return the part up to robot time `time`."""
        return replace(
            self,
            samples=self.samples.between(-np.inf, time),
            leaves=tuple(leaf for leaf in self.leaves if leaf.end <= time),
            recordings=tuple(r for r in self.recordings if r.end <= time),
            conversions=tuple(c for c in self.conversions if c.time <= time),
        )


K = TypeVar("K")
P = ParamSpec("P")
T = TypeVar("T")


def once(find: Callable[Concatenate[K, P], T]) -> Callable[Concatenate[K, P], T]:
    """Cache the results of `find` during the lifetime of its first argument: samples, a trace or similar.

    A result must not refer to that argument, which would then live for ever. The other arguments are
    hashable. A cached array is shared by all callers and therefore read-only.
    """
    known: WeakKeyDictionary[Any, dict[Hashable, T]] = WeakKeyDictionary()

    @wraps(find)
    def compute_once(of: K, *args: P.args, **named: P.kwargs) -> T:
        # Results are kept per first argument, by the other arguments.
        results = known.setdefault(of, {})
        key = (args, *sorted(named.items()))
        if key not in results:
            result = find(of, *args, **named)
            if isinstance(result, np.ndarray):
                result.flags.writeable = False
            results[key] = result
        return results[key]

    return compute_once


# Valid part of a trace: without the samples of failed actions, of parallel actions, and of all later
# actions until the plan was resumed.


# Prefix of a leaf's path in the plan of a later attempt or round; empty in the first.
ATTEMPT = re.compile(r"((replan|repeat)\[\d+\]\.)*")


class SpoiledSpan(NamedTuple):
    """Stretch of robot time, s, without evidence, and the action that spoiled it."""

    start: float
    end: float
    spoiled_by: LeafRun

    def touches(self, start: float, end: float) -> bool:
        """Test if the interval from `start` to `end` overlaps with it."""
        return end > self.start and start < self.end


def spoiled_spans(trace: Trace) -> tuple[SpoiledSpan, ...]:
    """Find the spans without evidence, one for each attempt that was broken off.

    A span extends from the first failed action to the start of the next attempt.
    """
    # Group the leaves by attempt, which ends where the next attempt starts.
    attempts: dict[str, list[LeafRun]] = {}
    for leaf in trace.leaves:
        prefix = ATTEMPT.match(leaf.node)
        attempts.setdefault(prefix.group() if prefix else "", []).append(leaf)
    starts = [min(leaf.start for leaf in leaves) for leaves in attempts.values()]
    ends = [*starts, math.inf][1:]
    found: list[SpoiledSpan] = []
    # The first failed action of an attempt spoils the rest of it.
    for leaves, end in zip(attempts.values(), ends, strict=True):
        failed = [leaf for leaf in leaves if leaf.status != "SUCCESS"]
        if failed:
            first = min(failed, key=lambda leaf: leaf.start)
            found.append(SpoiledSpan(parallel_start(first, leaves), end, first))
    return tuple(found)


def parallel_start(failed: LeafRun, leaves: Sequence[LeafRun]) -> float:
    """Return the start, s, of a leaf, or of the first leaf in parallel with it, transitively."""
    start = failed.start
    # Backwards in time: each overlapping leaf may move the start earlier.
    for leaf in sorted(leaves, key=lambda leaf: leaf.end, reverse=True):
        if leaf.end > start and leaf.start < failed.end:
            start = min(start, leaf.start)
    return start


def sound(trace: Trace) -> Trace:
    """Return the part of a trace that is evidence; the trace itself if nothing was broken off."""
    spans = spoiled_spans(trace)
    if not spans:
        return trace

    def is_kept(start: float, end: float) -> bool:
        return not any(span.touches(start, end) for span in spans)

    # Keep the rows outside of all spans, and the recordings that overlap with none.
    t = trace.samples.t
    rows = np.all([(t <= span.start) | (t >= span.end) for span in spans], axis=0)
    part = trace.part(trace.samples.where(rows), lambda one: is_kept(one.start, one.end))
    # A conversion is kept with its recording, unless it was made in the failed part itself.
    return replace(
        part,
        leaves=tuple(leaf for leaf in trace.leaves if is_kept(leaf.start, leaf.end)),
        conversions=tuple(c for c in part.conversions if is_kept(c.time, c.time)),
    )


# Part of a long trace that is evidence of one object.


# s before and after an object was in the hand. It is longer than the time around it from which an
# estimate takes the empty hand's motions (`estimation.load_blocks.WHOLE_AROUND`). The rms of z over
# 30 masses is .54; from all of their runs it is .59.
AROUND = 20.0


class Recorded(Protocol):
    """Leaves, recordings and conversions of a trace, complete or growing."""

    @property
    def leaves(self) -> Sequence[LeafRun]: ...
    @property
    def recordings(self) -> Sequence[Recording]: ...
    @property
    def conversions(self) -> Sequence[Conversion]: ...


def reach(of: Recorded, name: str) -> tuple[float, float] | None:
    """Find the first and last robot time, s, of the evidence of the object `name`.

    The evidence covers `AROUND` the time in which the object was in the hand, and the adjacent recordings
    of the empty hand. None if the object was never in the hand: any part may be evidence then.
    """
    # Leaves with the object in the hand, and recordings for its quantities.
    held = [leaf for leaf in of.leaves if leaf.context is not None and leaf.context.holding == name]
    if not held:
        return None
    used: list[Recording] = [one.recording for one in of.conversions if one.object == name]
    for nearby in (of.recordings, of.recordings[::-1]):
        # Approach the object's own recordings from both sides; a recording of another object restarts the
        # collection.
        empty: list[Recording] = []
        for recording in nearby:
            holding = recording.context.holding
            empty = [*empty, recording] if holding in (None, name) else []
            if holding == name:
                used, empty = [*used, *empty], []
    # The span of all evidence, with a margin on both sides.
    first = min(one.start for one in (*held, *used))
    return first - AROUND, max(one.end for one in (*held, *used)) + AROUND


_during = once(Trace.during)


def trace_around(trace: Trace, name: str) -> Trace:
    """Return the part of a trace that is evidence of the object `name`. Parts are cached, the whole trace is
    not.
    """
    # The whole trace if the evidence covers it.
    reached = reach(trace, name)
    if reached is None or not len(trace.t):
        return trace
    first, last = reached
    whole = first <= float(trace.t[0]) and float(trace.t[-1]) <= last
    return trace if whole else _during(trace, first, last)
