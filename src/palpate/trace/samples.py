"""Samples of an execution, and the trace that holds them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

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
    q: Array  # (n, m) positions of m joints, rad
    dq: Array  # (n, m) joint velocities, rad/s
    tau_ext: Array  # (n, m) measured joint torques less nominal gravity and friction, N m
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
    def empty(cls, joints: int = 7) -> Samples:
        """Make samples without rows, of an arm with some joints."""
        scalars, each = np.empty(0), np.empty((0, joints))
        pose, wrench = np.empty((0, 7)), np.empty((0, 6))
        return cls(scalars, each, each, each, wrench, pose, wrench, pose, scalars)

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

        Raises Unavailable: pandas is not installed.
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
