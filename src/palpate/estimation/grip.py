"""Widths of grasped objects, and their motion between the fingers: droop and slip."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.estimation.motion import mean_pose
from palpate.mjcf.body import Body
from palpate.trace.recording import LeafRun, Recording
from palpate.trace.samples import Samples, Trace

OPENING = 2e-4
"""m (1 sigma). Error of the measured finger opening, by backlash of the drives and wear of the pads. Sensitive: size
std ×0.6–1.8."""
OPENING_HELD = 1e-3
"""m (1 sigma). Error of an object's width from the opening after the grasp. Rubber pads and soft material compress by
so much under 50 N. Sensitive: no, where the first contact is seen."""
FIRST_SQUEEZE = 0.25
"""Fraction of the compression of a firm grasp (about 50 N) that occurs at first contact (10 N), and its 1 sigma.
Sensitive: size 0.5 σ."""
GRASPED = 0.05
"""s at the end of a grasp in which the fingers rest on the object. Sensitive: no."""
FIRST_MET = 0.9
"""Quantile of the resting openings that is the opening at first contact: the fingers rest twice, for 0.1 s or more.
Sensitive: no."""
FINGERS_REST = 2e-3
"""m/s. Finger speed below which the fingers are at rest. Sensitive: no."""
GRASP_YIELDS = 5e-3
"""m. Largest compression of a grasped object. Sensitive: no."""
ALIGNED = 0.98
"""Cosine above which two directions are the same: 11°, at which a width is wrong by 2 %. Sensitive: no."""

ROUND = frozenset(("cylinder", "sphere", "capsule"))
"""Shapes with the same width in all horizontal directions."""
CLOSING = "CloseGripper"
"""Name of the primitive whose leaf is a grasp."""


class Extent(NamedTuple):
    """Measured extent along an axis of the object, m, with its standard deviation."""

    axis: int
    value: float
    std: float


def widths(trace: Trace, held: Sequence[Recording], body: Body) -> Iterator[Extent]:
    """Yield widths of an object from the recordings `held`, made while it is held."""
    for recording in held:
        before = [leaf for leaf in trace.leaf_runs(CLOSING) if leaf.end <= recording.start]
        yield from extents_of(trace, trace.of(recording), before[-1] if before else None, body)


def widths_at_grasps(trace: Trace, body: Body) -> Iterator[Extent]:
    """Yield widths of an object from each of its grasps, as the fingers came to rest."""
    for leaf in trace.leaf_runs(CLOSING):
        if leaf.context is None or leaf.context.holding != body.name:
            continue
        # Samples at the end of the grasp, in which the fingers rest on the object.
        if len(samples := trace.samples.between(leaf.end - GRASPED, leaf.end)):
            yield from extents_of(trace, samples, leaf, body)


def extents_of(
    trace: Trace, samples: Samples, grasp: LeafRun | None, body: Body
) -> Iterator[Extent]:
    """Yield the widths of an object between the fingers in `samples`, after a `grasp`."""
    width, std = width_at(trace, float(np.median(samples.width)), grasp)
    for axis in axes_between(mean_pose(samples).rotation[:, 1], body):
        yield Extent(axis, width, std)


def axes_between(closing: Array, body: Body) -> list[int]:
    """Axes of an object whose extent is measured by fingers that close along `closing` (3,), world axes.

    It is one axis of the object, or both horizontal axes of a round object.
    """
    along = np.abs(body.pose_world.rotation.T @ closing)
    level = np.abs(body.pose_world.rotation[2]) < 1.0 - ALIGNED
    if body.words & ROUND and level.sum() == 2:
        return np.flatnonzero(level).tolist()
    return np.flatnonzero(along > ALIGNED).tolist()


def width_at(trace: Trace, held: float, grasp: LeafRun | None) -> tuple[float, float]:
    """Width of an object at a grasp, m, and its standard deviation.

    The finger opening at first contact is extrapolated to zero force. The compression between first contact and the
    firm grasp, at the opening `held`, m, gives the slope.
    """
    if grasp is None:
        return held, OPENING_HELD
    samples = trace.samples.between(grasp.start, grasp.end)
    # Openings at which the fingers rested on the object; the first contact is the widest of them.
    resting = np.abs(np.gradient(samples.width, samples.t)) < FINGERS_REST
    met = samples.width[resting & (samples.width < held + GRASP_YIELDS)]
    if not len(met):
        return held, OPENING_HELD
    # Extrapolate: at first contact, a share of the total compression had occurred.
    squeezed = max(float(np.quantile(met, FIRST_MET)) - held, 0.0)
    share = FIRST_SQUEEZE
    width = held + (1.0 + share) * squeezed
    return width, float(np.hypot(OPENING, share * squeezed))


# Motion of an object in the grip: droop about the closing axis, and slip along the pads


GRIP_TURN = 0.07
"""rad per N m (root mean square of a half-normal distribution). Rotation of a load between two pads by its moment. It
is that of silicone pads, 20 mm wide, 2 mm thick, with a shear modulus of 0.5 MPa. Sensitive: com z 0.4 σ, std
×0.97–1.1."""
GRIP_CREEP = 0.02
"""rad/s per N m (root mean square of a half-normal distribution). Creep of that rotation during a hold. No published
figure of a hand. In the simulation, a hammer held off its balance point turns by 0.018 rad between the 25th and the
43rd second (0.23 N m). The simulation's regularised friction always creeps. Recordings of tilts and swings show the
creep in their course. Sensitive: com z 0.5 σ, std ×0.9–1.25."""

LIKELY = np.array([GRIP_TURN, GRIP_CREEP])
"""(2,) rad per N m, and rad/s per N m: root mean squares of the unknown rotation and its rate."""

EXPECTED: Array = np.sqrt(2.0 / np.pi) * LIKELY
"""(2,) mean of the half-normal distribution."""

SPREAD: Array = np.sqrt(1.0 - 2.0 / np.pi) * LIKELY
"""(2,) standard deviation of the half-normal distribution."""


@dataclass(frozen=True, slots=True)
class Droop:
    """Causes of an object's rotation in the hand: its moment and the age of the grasp."""

    moment: float  # N m, moment of the level object about the closing axis of the fingers
    age: float  # s, since the fingers closed on it

    @classmethod
    def since(cls, grasp: float, time: float, moment: float) -> Droop:
        """Droop at `time`, s, of an object grasped at `grasp`, s; -inf means an unknown grasp."""
        return cls(moment, max(0.0, time - grasp) if np.isfinite(grasp) else 0.0)

    @property
    def turns(self) -> Array:
        """(2,) rad about the tool's y axis per unit of pad softness."""
        return -self.moment * np.array([1.0, self.age])

    def turned(self, pose_tcp_body: Pose, softness: Array) -> Pose:
        """Pose of the object in the hand after its rotation, for a `softness` (2,) of the pads."""
        half = float(self.turns @ softness) / 2.0
        turn = Pose.of(np.zeros(3), (np.cos(half), 0.0, np.sin(half), 0.0))
        return turn @ pose_tcp_body


@dataclass(frozen=True, slots=True)
class PutDownRecord:
    """End of a grasp."""

    grasp: float  # s, time at which the hand had closed on the object
    pose_tcp_body: Pose  # pose of the object in the hand at that time
    droop: Droop  # droop until the hand came down with the object
    swept: float  # rad, total angle by which tilts had turned the hand with it

    def displacement_std(self, body: Body) -> float:
        """Displacement along the fingers, m (1 sigma), as a drooped object is put down and levels.

        Its end may slide on the support as well, so this is no evidence of the droop.
        """
        # The foot of the object moves by its depth below the fingers times the droop angle.
        drooped = float(np.linalg.norm(self.droop.turns * LIKELY))
        signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
        corners = body.centre + signs * body.size
        # The tool axis points down, at the lowest corner of the object.
        height = float(max(self.pose_tcp_body.apply(corner)[2] for corner in corners))
        return height * drooped

    @property
    def slid(self) -> Array:
        """Displacement (3, 2), body frame, m per (m/rad) of slip along the tool's x and z.

        The part along z is reset when the object is put down.
        """
        along = self.pose_tcp_body.rotation[0]
        return np.column_stack([self.swept * along, np.zeros(3)])


def slid(pose_tcp_body: Pose, swept: float) -> Array:
    """Displacement (3, 2), m, body frame, in the present grasp per unit of slip (m/rad) along the tool's x and z."""
    return swept * pose_tcp_body.rotation[[0, 2]].T


def before(grasp: float, put_down: Iterable[PutDownRecord]) -> list[PutDownRecord]:
    """Select the put-downs before a grasp at `grasp`, s."""
    return [each for each in put_down if each.grasp < grasp]
