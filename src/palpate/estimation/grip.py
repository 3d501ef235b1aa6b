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
from palpate.trace.samples import Trace

OPENING = 2e-4
"""m (1 sigma): how well the fingers tell how far they are open: their drives' backlash and the pads' wear.
Sensitive: size std ×0.6–1.8."""
OPENING_HELD = 1e-3
"""m (1 sigma): how well that is an object's width once they have taken hold of it; rubber pads and what is between
them give way by so much under 50 N. Sensitive: no, where it is seen as they close."""
FIRST_SQUEEZE = 0.25
"""part of what gives way as the fingers take hold (with 50 N or so) that had given way as they met the object (with
10 N); its 1 sigma as well. Sensitive: size 0.5 σ."""
GRASPED = 0.05
"""s at the end of a grasp in which the fingers rest on what they hold. Sensitive: no."""
FIRST_MET = 0.9
"""quantile of the openings at which the fingers rested that is the first one: they rest twice for 0.1 s or more.
Sensitive: no."""
FINGERS_REST = 2e-3
"""m/s below which the fingers count as resting. Sensitive: no."""
GRASP_YIELDS = 5e-3
"""m that what is grasped gives way by at most. Sensitive: no."""
ALIGNED = 0.98
"""cosine from which two directions count as one; 11°, across which a width is 2 % wrong. Sensitive: no."""

ROUND = frozenset(("cylinder", "sphere", "capsule"))
"""Shapes of the same width in all horizontal directions."""
CLOSING = "CloseGripper"
"""The primitive whose leaf is a grasp."""


class Extent(NamedTuple):
    """Measured extent along an axis of the object, m, with its standard deviation."""

    axis: int
    value: float
    std: float


def widths(trace: Trace, held: Sequence[Recording], body: Body) -> Iterator[Extent]:
    """Widths of an object from recordings `held` while it is held."""
    for recording in held:
        samples = trace.of(recording)
        opening = float(np.median(samples.width))
        before = [leaf for leaf in trace.leaf_runs(CLOSING) if leaf.end <= recording.start]
        width, std = width_at(trace, opening, before[-1] if before else None)
        for axis in axes_between(mean_pose(samples).rotation[:, 1], body):
            yield Extent(axis, width, std)


def widths_at_grasps(trace: Trace, body: Body) -> Iterator[Extent]:
    """Widths of an object from every grasp of it, as the fingers came to rest."""
    for leaf in trace.leaf_runs(CLOSING):
        if leaf.context is None or leaf.context.holding != body.name:
            continue
        samples = trace.samples.between(leaf.end - GRASPED, leaf.end)
        if not len(samples):
            continue
        width, std = width_at(trace, float(np.median(samples.width)), leaf)
        for axis in axes_between(mean_pose(samples).rotation[:, 1], body):
            yield Extent(axis, width, std)


def axes_between(closing: Array, body: Body) -> list[int]:
    """Axes of an object along which fingers that close along `closing` (3,), world axes, measure it: one of its
    own, or both level ones of a round object."""
    along = np.abs(body.pose_world.rotation.T @ closing)
    level = np.abs(body.pose_world.rotation[2]) < 1.0 - ALIGNED
    if body.words & ROUND and level.sum() == 2:
        return np.flatnonzero(level).tolist()
    return np.flatnonzero(along > ALIGNED).tolist()


def width_at(trace: Trace, held: float, grasp: LeafRun | None) -> tuple[float, float]:
    """Width of an object at a grasp, m, with its standard deviation: the finger opening at first contact,
    extrapolated from the squeeze between that and the firm grasp with its opening `held`, m."""
    if grasp is None:
        return held, OPENING_HELD
    samples = trace.samples.between(grasp.start, grasp.end)
    resting = np.abs(np.gradient(samples.width, samples.t)) < FINGERS_REST
    met = samples.width[resting & (samples.width < held + GRASP_YIELDS)]
    if not len(met):
        return held, OPENING_HELD
    squeezed = max(float(np.quantile(met, FIRST_MET)) - held, 0.0)
    share = FIRST_SQUEEZE
    width = held + (1.0 + share) * squeezed
    return width, float(np.hypot(OPENING, share * squeezed))


# Motion of an object in the grip: droop about the closing axis, and slip along the pads.


GRIP_TURN = 0.07
"""rad per N m (root mean square of half a normal): rotation of a load between two pads by its moment, as of pads of
silicone, 20 mm wide, 2 mm thick, with a shear modulus of 0.5 MPa. Sensitive: com z 0.4 σ, std ×0.97–1.1."""
GRIP_CREEP = 0.02
"""rad/s per N m: likewise, rate of creep while it is held. No published figure of a hand. A hammer held beside its
balance point turns by 0.018 in the simulation (by a moment of 0.23 N m, from the 25th second to the 43rd), as its
regularised friction always creeps; recordings of tilts and swings show the creep in their run. Sensitive: com z 0.5
σ, std ×0.9–1.25."""

LIKELY = np.array([GRIP_TURN, GRIP_CREEP])
"""(2,) rad per N m, and rad/s per N m: root mean square of the unknown rotation and its rate."""

EXPECTED: Array = np.sqrt(2.0 / np.pi) * LIKELY
"""(2,) mean of half a normal distribution."""

SPREAD: Array = np.sqrt(1.0 - 2.0 / np.pi) * LIKELY
"""(2,) standard deviation of half a normal distribution."""


@dataclass(frozen=True, slots=True)
class Droop:
    """Cause of an object's rotation in the hand.

    Attributes:
        moment: N m of the level object about the axis along which the fingers close.
        age: s since the fingers closed on it.
    """

    moment: float
    age: float

    @classmethod
    def since(cls, grasp: float, time: float, moment: float) -> Droop:
        """Droop at `time`, s, of an object grasped at `grasp`, s; -inf is an unknown grasp."""
        return cls(moment, max(0.0, time - grasp) if np.isfinite(grasp) else 0.0)

    @property
    def turns(self) -> Array:
        """(2,) rad about the tool's y per unit of the softness of the pads."""
        return -self.moment * np.array([1.0, self.age])

    def turned(self, pose_tcp_body: Pose, softness: Array) -> Pose:
        """Pose of the object in the hand after the rotation, for `softness` (2,) of the pads."""
        half = float(self.turns @ softness) / 2.0
        turn = Pose.of(np.zeros(3), (np.cos(half), 0.0, np.sin(half), 0.0))
        return turn @ pose_tcp_body


@dataclass(frozen=True, slots=True)
class PutDownRecord:
    """End of a grasp.

    Attributes:
        grasp: s, when the hand had closed on the object.
        pose_tcp_body: of the object in the hand at that time.
        droop: until the hand came down with it.
        swept: rad by which tilts had turned the hand with it.
    """

    grasp: float
    pose_tcp_body: Pose
    droop: Droop
    swept: float

    def displacement_std(self, body: Body) -> float:
        """m (1 sigma), displacement along the fingers when a drooped object is put down and levels. Its end
        may slide on the support as well, so this is no evidence of the droop."""
        drooped = float(np.linalg.norm(self.droop.turns * LIKELY))
        signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
        corners = body.centre + signs * body.size
        # The object is gripped from above: the tool axis points at its lowest corner.
        height = float(max(self.pose_tcp_body.apply(corner)[2] for corner in corners))
        return height * drooped

    @property
    def slid(self) -> Array:
        """(3, 2) m per rad/rad, body frame: displacement by sliding along the tool's x and z. The part along
        z is reset when the object is put down."""
        along = self.pose_tcp_body.rotation[0]
        return np.column_stack([self.swept * along, np.zeros(3)])


def slid(pose_tcp_body: Pose, swept: float) -> Array:
    """(3, 2) m, body frame: displacement within the present grasp per metre of slip along the tool's x and z
    and radian of tilt."""
    return swept * pose_tcp_body.rotation[[0, 2]].T


def before(grasp: float, put_down: Iterable[PutDownRecord]) -> list[PutDownRecord]:
    """All put-downs before a grasp at `grasp`, s."""
    return [each for each in put_down if each.grasp < grasp]
