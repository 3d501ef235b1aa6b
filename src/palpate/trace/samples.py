"""Trace of an execution: timestamped samples, the runs of all leaves, and the recordings with their
context.

A `Trace` is all that estimation sees. It holds sensed values and the *nominal* robot's kinematics,
never the truth of a simulated world.

Wrench convention: force (N) then torque (N m) that the end effector exerts on what it touches, in
world axes about the TCP, from the paper's w = (J^T)^+ (tau - tau_gravity - tau_friction). A mass m
held still reads f_z = +m g; pressing down on a table reads f_z < 0.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from palpate.display import data_frame, table
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.trace.recording import Conversion, Hand, LeafRun, Recording

if TYPE_CHECKING:
    from pandas import DataFrame  # pyright: ignore[reportMissingModuleSource]

FORCES = "gripper_forces"
POSE = "gripper_pose"


JOINTS, POSE_PARTS = "1 2 3 4 5 6 7", "x y z qw qx qy qz"
PARTS = {
    "q": ("q", JOINTS),
    "dq": ("dq", JOINTS),
    "tau_ext": ("tau_ext", JOINTS),
    "wrench": ("wrench_", "fx fy fz tx ty tz"),
    "pose_world_tcp": ("tcp_", POSE_PARTS),
    "twist": ("twist_", "vx vy vz wx wy wz"),
    "target_world_tcp": ("target_", POSE_PARTS),
}
COLUMNS = {
    signal: tuple(f"{prefix}{part}" for part in parts.split())
    for signal, (prefix, parts) in PARTS.items()
}
"""Names of the columns of each signal that has several."""

STANDARD_GRAVITY = 9.81
"""m/s^2, MuJoCo's default gravity; a scene that sets another passes it on in the `Trace`."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Samples:
    """Sensed signals, one row per log period (block means of the 1 kHz control loop).

    Attributes:
        t: (n,) robot time, s.
        q: (n, 7) joint positions, rad.
        dq: (n, 7) joint velocities, rad/s.
        tau_ext: (n, 7) measured joint torques less nominal gravity and friction, N m.
        wrench: (n, 6) external wrench at the TCP in world axes (see the module's convention).
        pose_world_tcp: (n, 7) position (m) and quaternion wxyz of the TCP.
        twist: (n, 6) linear (m/s) and angular (rad/s) velocity of the TCP, world axes.
        target_world_tcp: (n, 7) the commanded equilibrium pose.
        width: (n,) opening between the fingers, m.
    """

    t: Array
    q: Array
    dq: Array
    tau_ext: Array
    wrench: Array
    pose_world_tcp: Array
    twist: Array
    target_world_tcp: Array
    width: Array

    @classmethod
    def empty(cls) -> Samples:
        """Samples without rows."""
        scalars, joints = np.empty(0), np.empty((0, 7))
        pose, wrench = np.empty((0, 7)), np.empty((0, 6))
        return cls(scalars, joints, joints, joints, wrench, pose, wrench, pose, scalars)

    @classmethod
    def concatenate(cls, parts: Iterable[Samples]) -> Samples:
        """Join the rows of `parts`, in order."""
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
        # Times are multiples of 5 ms up to rounding.
        first, last = np.searchsorted(self.t, [start, end + 1e-9])
        return self.where(slice(int(first), int(last)))


@dataclass(frozen=True, slots=True, eq=False, repr=False, weakref_slot=True)
class Trace:
    """The whole execution: samples, leaves, recordings, conversions, and the nominal hand."""

    samples: Samples
    leaves: tuple[LeafRun, ...]
    recordings: tuple[Recording, ...]
    conversions: tuple[Conversion, ...]
    hand: Hand
    gravity: float = STANDARD_GRAVITY

    @property
    def t(self) -> Array:
        """(n,) robot time, s."""
        return self.samples.t

    @property
    def wrench(self) -> Array:
        """(n, 6) external wrench at the TCP in world axes: N, N m (see the module's convention)."""
        return self.samples.wrench

    def columns(self) -> dict[str, Array]:
        """Columns of the samples by name, e.g. `t`, `q3`, `wrench_fz`, each (n,)."""
        found: dict[str, Array] = {}
        for signal in fields(self.samples):
            values: Array = getattr(self.samples, signal.name)
            names = COLUMNS.get(signal.name, (signal.name,))
            found |= zip(names, values.T if values.ndim > 1 else [values], strict=True)
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

        def outside(recording: Recording) -> bool:
            return recording.end < start or recording.start > end

        t = self.samples.t
        return replace(
            self,
            samples=self.samples.where((t < start) | (t > end)),
            recordings=tuple(r for r in self.recordings if outside(r)),
            conversions=tuple(c for c in self.conversions if outside(c.recording)),
        )

    def during(self, start: float, end: float) -> Trace:
        """Return the samples and recordings from robot time `start` to `end`, with the leaves up to then."""

        def inside(recording: Recording) -> bool:
            return start <= recording.start and recording.end <= end

        return replace(
            self,
            samples=self.samples.between(start, end),
            leaves=tuple(leaf for leaf in self.leaves if leaf.start <= end),
            recordings=tuple(r for r in self.recordings if inside(r)),
            conversions=tuple(c for c in self.conversions if inside(c.recording)),
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
    """Cache the results of `find` for as long as its first argument lives: samples, a trace or the like.

    A result must not refer to that argument, which would then live for ever. The other arguments are hashable. A
    cached array is shared by all callers and therefore read-only."""
    known: WeakKeyDictionary[Any, dict[Hashable, T]] = WeakKeyDictionary()

    @wraps(find)
    def found(of: K, *args: P.args, **named: P.kwargs) -> T:
        results = known.setdefault(of, {})
        key = (args, *sorted(named.items()))
        if key not in results:
            result = find(of, *args, **named)
            if isinstance(result, np.ndarray):
                result.flags.writeable = False
            results[key] = result
        return results[key]

    return found
