"""Sweep: minimum distances of the arm, the hand and the held object along a path.

A path is sampled at moments. Between two of them no point of a shape travels farther than its
middle plus its radius times the turn; so two shapes that are farther apart at both moments than what
they travel do not meet in between. Bounding boxes rule out nearly all pairs, for all moments
together; the others are measured exactly, and the interval is halved until they are clear or hit
(conservative advancement).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array, Pose
from palpate.robots.trajectory import rotation_vector
from palpate.vocabulary.admissible.solids import Frames, Solids

STEP = 0.02  # m between two moments of a path
TURN = 0.1  # rad between two moments, of the tool or of a joint
CORRECTIONS = 3  # Newton steps from interpolated joint angles onto the straight line
DAMPING = 1e-6  # m^2, of a Newton step
FINEST = 0.002  # m of travel below which an interval is not halved again
SLACK = 0.001
"""m by which a pair that is too near at the start may come nearer: the tracking error of the arm."""
CURVED = 1.02
"""Arc length of a shape between two moments over its chord: no joint turns by more than 0.1 rad."""
Pairs = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class ArmPath:
    """Path of the arm, the hand and the fingers at n moments, evenly spaced; linear in between.

    Attributes:
        positions, quaternions: (n, 3) and (n, 4) of the TCP, world.
        widths: (n,) m between the fingers.
        q: (n, 7) rad; None where only the hand matters.
    """

    positions: Array
    quaternions: Array
    widths: Array
    q: Array | None = None

    @property
    def count(self) -> int:
        """Number of moments."""
        return len(self.positions)

    def rotations(self) -> Array:
        """(n, 3, 3) of the TCP."""
        out = np.empty((self.count, 9))
        for i, quaternion in enumerate(self.quaternions):
            mujoco.mju_quat2Mat(out[i], quaternion)
        return out.reshape(-1, 3, 3)

    def between(self, moment: float) -> ArmPath:
        """Interpolate one moment."""
        i = min(int(moment), self.count - 2)
        share = moment - i
        first, last = self.quaternions[i], self.quaternions[i + 1]
        # Quaternions of opposite sign are one rotation: interpolate the shorter way.
        turned = (1 - share) * first + np.copysign(share, first @ last) * last

        def linear(values: Array) -> Array:
            return ((1 - share) * values[i] + share * values[i + 1])[None]

        return ArmPath(
            linear(self.positions),
            (turned / np.linalg.norm(turned))[None],
            linear(self.widths),
            None if self.q is None else linear(self.q),
        )


def hand_path(start: Pose, end: Pose, width: float, step: float = STEP) -> ArmPath:
    """Straight path of the hand alone."""
    travel = end.position - start.position
    turn = rotation_vector(start.quaternion, end.quaternion)
    parts = max(np.linalg.norm(travel) / step, np.linalg.norm(turn) / TURN, 1.0)
    shares = np.linspace(0.0, 1.0, int(np.ceil(parts)) + 1)
    quaternions = np.empty((len(shares), 4))
    for i, share in enumerate(shares):
        quaternions[i] = start.quaternion
        mujoco.mju_quatIntegrate(quaternions[i], turn, share)
    positions = start.position + shares[:, None] * travel
    return ArmPath(positions, quaternions, np.full(len(shares), width))


def straight_path(
    solids: Solids, start: Pose, end: Pose, q: tuple[Array, Array], width: float
) -> ArmPath:
    """Straight path of the TCP, the arm going from joint angles `q[0]` to `q[1]` as the controller
    takes it: interpolated joint angles, corrected onto the line by damped Newton steps."""
    hand = hand_path(start, end, width)
    shares = np.linspace(0.0, 1.0, hand.count)[:, None]
    bent = (1 - shares) * q[0] + shares * q[1]
    for _ in range(CORRECTIONS):
        bent = bent + _newton_step(solids, hand, bent)
    return replace(hand, q=bent)


def joint_path(solids: Solids, start: Array, end: Array, width: float) -> ArmPath:
    """Path of a joint motion: all joints linearly from `start` to `end` (7,), rad."""
    farthest = float(np.abs(end - start).max())
    count = max(int(np.ceil(farthest / (TURN / 2))) + 1, 2)
    shares = np.linspace(0.0, 1.0, count)[:, None]
    q = (1 - shares) * start + shares * end
    poses = solids.arm.poses(q)
    return ArmPath(poses[:, :3], poses[:, 3:], np.full(count, width), q)


def finger_path(pose: Pose, start: float, end: float) -> ArmPath:
    """Path of the fingers alone, from one opening to another, m."""
    positions, quaternions = np.tile(pose.position, (2, 1)), np.tile(pose.quaternion, (2, 1))
    return ArmPath(positions, quaternions, np.array([start, end]))


def _newton_step(solids: Solids, hand: ArmPath, q: Array) -> Array:
    """(n, 7) rad, Jᵀ (J Jᵀ + λ I)⁻¹ e with the TCP's error e (n, 6) from the path of the hand."""
    poses, jacobian = solids.arm.stances(q)
    error = np.empty((len(q), 6))
    error[:, :3] = hand.positions - poses[:, :3]
    for i, (wanted, found) in enumerate(zip(hand.quaternions, poses[:, 3:], strict=True)):
        mujoco.mju_rotVecQuat(error[i, 3:], rotation_vector(found, wanted), found)
    transposed = jacobian.transpose(0, 2, 1)
    square = jacobian @ transposed + DAMPING * np.eye(6)
    return (transposed @ np.linalg.solve(square, error[:, :, None]))[:, :, 0]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A moving or static shape.

    Attributes:
        geom: its id in the compiled scene.
        kind: `hand`, `load`, a finger's side, `link`; else empty.
        owner: the body that it is part of.
    """

    geom: int
    kind: str
    owner: str


@dataclass(frozen=True, slots=True)
class Hit:
    """Two parts that come too near each other.

    Attributes:
        distance: m, negative where they overlap.
        where: (3,) m, world.
        share: of the path, from 0 to 1.
    """

    part: Part
    other: Part
    distance: float
    where: tuple[float, float, float]
    share: float

    @property
    def place(self) -> str:
        """Place of the contact, in words."""
        x, y, z = self.where
        return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


@dataclass(eq=False)
class Moment:
    """The shapes at one moment.

    Attributes:
        at: number of the moment; a fraction between two of the path.
        frames: poses of all parts.
        distances: m, measured so far, by the number of the pair.
    """

    at: float
    frames: Frames
    distances: dict[int, float] = field(default_factory=dict[int, float])


@dataclass(frozen=True, eq=False)
class Sweep:
    """A path with all that moves along it, among all that is static.

    Attributes:
        parts: moving parts, then static ones.
        moving: number of moving parts.
        place: frames of all parts along a path, in the order of `parts`.
        frames: frames of all parts along `path`.
        pairs: (p, 2) numbers of parts that may meet. The first of a pair moves; the pairs of two
            moving parts come last.
    """

    solids: Solids
    path: ArmPath
    parts: Sequence[Part]
    moving: int
    place: Callable[[ArmPath], Frames]
    frames: Frames
    pairs: Pairs

    def within(self, growth: float) -> Sweep:
        """The same sweep with only the pairs that may come within `growth` m, by the bounding boxes
        of each moving part's whole path and of each static part."""
        positions, turns = self.frames.positions, self.frames.rotations[0, self.moving :]
        low, high = positions[:, : self.moving].min(axis=0), positions[:, : self.moving].max(axis=0)
        # Between two moments a part is no farther from both than half of its travel.
        travel = self._travel(positions, self.frames.rotations)[:, : self.moving].max(axis=0)
        reach = growth + self._moving_radii + travel / 2
        middles, halves = self.solids.boxes
        static = self._geoms[self.moving :]
        middle = positions[0, self.moving :] + np.einsum("kij,kj->ki", turns, middles[static])
        half = np.einsum("kij,kj->ki", np.abs(turns), halves[static])
        before, behind = middle - half - high[:, None], low[:, None] - middle - half
        near = np.maximum(before, behind).max(axis=2) < reach[:, None]
        both_move = np.ones((self.moving, self.moving), dtype=np.bool_)
        may_meet = np.concatenate([both_move, near], axis=1)
        return replace(self, pairs=self.pairs[may_meet[self.pairs[:, 0], self.pairs[:, 1]]])

    def hits(self, margins: Array) -> Iterator[Hit]:
        """Pairs that come nearer than their margin (p,), m, each where it first does.

        A pair that is too near at the start may stay as near.
        """
        for found in self._hits_by_interval(margins):
            yield from found

    def first(self, margins: Array) -> Hit | None:
        """Earliest of the `hits`; the path behind it is not searched."""
        for found in self._hits_by_interval(margins):
            return min(found, key=lambda hit: hit.share)
        return None

    def overlaps(self) -> Iterator[Hit]:
        """Pairs that overlap at the start."""
        start = self._moment(0)
        for pair in np.flatnonzero(self.bounds[0] < 0.0).tolist():
            if self._distance(start, pair) < 0.0:
                yield self._hit(pair, start)

    def near(self, growth: float) -> NDArray[np.bool_]:
        """(n - 1,) mask of the intervals in which any pair may come within `growth` m."""
        doubtful = (self.bounds[:-1] + self.bounds[1:] - self.travels) / 2 < growth
        found = np.zeros(len(doubtful), dtype=np.bool_)
        for i in range(len(doubtful)):
            start, end = self._moment(i), self._moment(i + 1)
            for pair in np.flatnonzero(doubtful[i]).tolist():
                apart = self._distance(start, pair) + self._distance(end, pair)
                if (apart - self.travels[i, pair]) / 2 < growth:
                    found[i] = True
                    break
        return found

    @cached_property
    def bounds(self) -> Array:
        """(n, p) m, lower bounds of the distances of pairs: from the bounding sphere of the first to
        the bounding box of the second."""
        to_static = int((self.pairs[:, 1] >= self.moving).sum())
        static, moving = self.pairs[:to_static], self.pairs[to_static:]
        # A static part is at the first moment where it always is.
        parts = [self._to_box(static, slice(0, 1)), self._to_box(moving, slice(None))]
        return np.concatenate(parts, axis=1) - self.solids.radii[self._geoms[self.pairs[:, 0]]]

    @cached_property
    def travels(self) -> Array:
        """(n - 1, p) m, upper bounds of the relative travel of pairs between two moments."""
        each = self._travel(self.frames.positions, self.frames.rotations)
        return each[:, self.pairs[:, 0]] + each[:, self.pairs[:, 1]]

    @cached_property
    def _geoms(self) -> Pairs:
        return np.array([part.geom for part in self.parts])

    @cached_property
    def _moving_radii(self) -> Array:
        return self.solids.radii[self._geoms[: self.moving]]

    @cached_property
    def _moments(self) -> dict[int, Moment]:
        return {}

    def _moment(self, i: int) -> Moment:
        if i not in self._moments:
            self._moments[i] = Moment(float(i), self.frames.at(i))
        return self._moments[i]

    def _to_box(self, pairs: Pairs, moments: slice) -> Array:
        """(n, p) m from the centre of the first of each pair to the bounding box of the second, which
        is taken at these moments."""
        first, second = pairs[:, 0], pairs[:, 1]
        middles, halves = self.solids.boxes
        middle, half = middles[self._geoms[second]], halves[self._geoms[second]]
        x, y, z = (
            self.frames.positions[:, first, axis] - self.frames.positions[moments, second, axis]
            for axis in range(3)
        )
        turns, total = self.frames.rotations[moments, second], np.zeros(x.shape)
        for axis in range(3):
            turn = turns[:, :, :, axis]
            outside = x * turn[:, :, 0] + y * turn[:, :, 1] + z * turn[:, :, 2]
            outside = np.abs(outside - middle[:, axis]) - half[:, axis]
            total += np.maximum(outside, 0.0) ** 2
        return np.sqrt(total)

    def _hits_by_interval(self, margins: Array) -> Iterator[list[Hit]]:
        """Hits of each interval that has any, in the order of the path."""
        margins = margins.copy()
        for pair in np.flatnonzero(self.bounds[0] < margins).tolist():
            margins[pair] = min(margins[pair], self._distance(self._moment(0), pair) - SLACK)
        doubtful = (self.bounds[:-1] + self.bounds[1:] - self.travels) / 2 < margins
        met: set[int] = set()
        for i in np.flatnonzero(doubtful.any(axis=1)).tolist():
            found: list[Hit] = []
            left = [p for p in np.flatnonzero(doubtful[i]).tolist() if p not in met]
            for pair, moment in self._search(self._moment(i), self._moment(i + 1), left, margins):
                if pair not in met:
                    met.add(pair)
                    found.append(self._hit(pair, moment))
            if found:
                yield found

    def _search(
        self, low: Moment, high: Moment, pairs: list[int], margins: Array
    ) -> Iterator[tuple[int, Moment]]:
        """Pairs that come too near between two moments, with the moment; by bisection."""
        travels = self._travel(
            np.concatenate([low.frames.positions, high.frames.positions]),
            np.concatenate([low.frames.rotations, high.frames.rotations]),
        )[0]
        open_pairs: list[int] = []
        for pair in pairs:
            before, after = self._distance(low, pair), self._distance(high, pair)
            travel = travels[self.pairs[pair, 0]] + travels[self.pairs[pair, 1]]
            if min(before, after) < margins[pair]:
                yield pair, low if before < margins[pair] else high
            # The least distance in between is at least (before + after - travel) / 2.
            elif (before + after - travel) / 2 < margins[pair] and travel > FINEST:
                open_pairs.append(pair)
        if open_pairs:
            at = (low.at + high.at) / 2
            middle = Moment(at, self.place(self.path.between(at)))
            yield from self._search(low, middle, open_pairs, margins)
            yield from self._search(middle, high, open_pairs, margins)

    def _travel(self, positions: Array, rotations: Array) -> Array:
        """(n - 1, k) m, upper bound of the travel of any point of a shape between two moments."""
        travels = np.zeros((len(positions) - 1, len(self.parts)))
        positions, rotations = positions[:, : self.moving], rotations[:, : self.moving]
        moved = np.sqrt(((positions[1:] - positions[:-1]) ** 2).sum(axis=2))
        # The Frobenius norm of a change of rotation is √2 times the chord of its angle.
        turned = np.sqrt(((rotations[1:] - rotations[:-1]) ** 2).sum(axis=(2, 3)) / 2)
        travels[:, : self.moving] = CURVED * (moved + self._moving_radii * turned)
        return travels

    def _distance(self, moment: Moment, pair: int) -> float:
        if pair not in moment.distances:
            i, j = map(int, self.pairs[pair])
            first, second = self.parts[i].geom, self.parts[j].geom
            moment.distances[pair] = self.solids.distance(first, second, moment.frames, i, j)
        return moment.distances[pair]

    def _hit(self, pair: int, moment: Moment) -> Hit:
        # Measured again: `between` belongs to the last distance.
        moment.distances.pop(pair, None)
        distance = self._distance(moment, pair)
        x, y, z = self.solids.between().tolist()
        i, j = map(int, self.pairs[pair])
        share = moment.at / (self.path.count - 1)
        return Hit(self.parts[i], self.parts[j], distance, (x, y, z), share)
