"""Travel of a fixture along its joint, with the hand on its handle, or the reasons against it.

The hand keeps its pose relative to the handle, and the fixture moves as a whole:

        +-----------+--+                +-----------+--+
        |  cabinet  |==|o   hand  ->    |  cabinet      |==|o   hand
        +-----------+--+                +-----------+--+

The travel ends within the joint's limits and the arm's reach. Nothing comes near the hand, and no
object comes near the fixture: such an object is in it, on it, or in its way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array, Frames, Joint, Pose
from palpate.primitives.rules.arrangement import ShapePart
from palpate.primitives.rules.clearance import ArmPath, arm_path
from palpate.primitives.rules.collision import ARM, BESIDE, FIXED, carry_away
from palpate.primitives.rules.collision_geometry import LINK, arm_sweep, reaches
from palpate.primitives.rules.solids import ShapeGroup, Solids, solids
from palpate.primitives.state import SymbolicState, Violation
from palpate.robots.kinematics import LIMIT_MARGIN, within_joint_limits

FARTHEST = 0.15  # m, largest travel of a handle: passes take some seconds at hand speeds
NOT_SURE = 0.06  # m, largest travel where the limit is only believed
SEARCHED = 0.35  # m, largest travel in search of a limit
BEYOND = 0.05  # m, search distance beyond a stated or believed limit
SHARES = (1.0, 0.75, 0.5, 0.35, 0.25)  # Fractions of the largest travel that are tried in order
LEAST = 0.025  # m, least length of a pass that shows how friction depends on speed
SPARE = 0.01  # m of clearance to a limit, so that the arm does not run into it
STEP = 0.01  # m between two samples of the path
# rad of a joint between two moments of a way: more, and the elbow or the wrist is another
FOLDED = 0.4
CLEAR = 0.005  # m between fixture and object: with less, the object is on it, in it, or in its way


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Travel of a handle along its joint from where the hand is."""

    joint: Joint
    start: Pose  # pose of the TCP (world) on, or above, the handle
    travel: float  # of the joint, m or rad; signed
    is_unsure: bool = False  # its limit is only believed to be farther away

    def at(self, share: float) -> Pose:
        """Pose of the TCP after a share of the travel."""
        return self.joint.motion(share * self.travel) @ self.start

    @property
    def length(self) -> float:
        """Length of the TCP's path, m."""
        return abs(self.travel) * self.joint.lever(self.start.position)

    def shorten_to(self, position: Array) -> Way:
        """The way that ends `SPARE` before a limit that the TCP met at a position (3,), world."""
        there = float(self.joint.travels(self.start, position[None])[0])
        spare = np.copysign(SPARE / self.joint.lever(self.start.position), self.travel)
        return replace(self, travel=there - float(spare))

    @property
    def shares(self) -> list[float]:
        """Moments along it, from 0 to 1."""
        return np.linspace(0.0, 1.0, max(int(np.ceil(self.length / STEP)), 1) + 1).tolist()


def way_of(state: SymbolicState, name: str) -> Way | list[Violation]:
    """The longest way of a fixture from the hand's pose that stays clear of its limits.

    It goes towards the farther limit: a closed drawer opens. If even the shortest way is inadmissible,
    its violations are returned.
    """
    joint = state.scene.body(name).joint
    assert joint is not None
    # Direction with more room; a believed limit permits less travel than a stated one.
    sign = 1.0 if joint.room(1.0) >= joint.room(-1.0) else -1.0
    is_unsure = joint.open[int(sign > 0.0)]
    farthest = NOT_SURE if is_unsure else FARTHEST
    most = joint.room(sign) * joint.lever(state.tcp.position) - SPARE
    return _admissible_way(state, name, sign, min(farthest, most), is_unsure)


def way_to_limit(state: SymbolicState, name: str, sign: float) -> Way | list[Violation]:
    """Find the longest admissible way of a fixture beyond its upper (1) or lower limit (-1), else violations."""
    joint = state.scene.body(name).joint
    assert joint is not None
    most = joint.room(sign) * joint.lever(state.tcp.position) + BEYOND
    return _admissible_way(state, name, sign, min(SEARCHED, most), is_unsure=False)


def _admissible_way(
    state: SymbolicState, name: str, sign: float, farthest: float, is_unsure: bool
) -> Way | list[Violation]:
    """The longest admissible way of at most `farthest` m at the handle, tried by `SHARES`."""
    pose, joint = state.tcp, state.scene.body(name).joint
    assert joint is not None
    lever = max(joint.lever(pose.position), 1e-6)
    # Shorter passes do not show how friction depends on speed.
    if farthest < LEAST:
        problem = (
            f"'{name}' can move by {1e3 * max(farthest, 0.0):.0f} mm at its handle, and the measurement "
            f"needs {1e3 * LEAST:.0f} mm; remove it, and explain"
        )
        return [Violation("unreachable", problem)]

    def compute() -> Way | list[Violation]:
        found: list[Violation] = []
        for share in SHARES:
            way = Way(joint, pose, sign * max(share * farthest, LEAST) / lever, is_unsure)
            found = list(_violations(state, name, way))
            if not found:
                return way
        return found

    key = ("way", name, sign, farthest, is_unsure, *state.arrangement)
    return solids(state.scene).get_or_compute(key, compute)


def _violations(state: SymbolicState, name: str, way: Way) -> Iterator[Violation]:
    """Violations of a way: out of reach, the arm collides, or an object is near the fixture."""
    poses = [way.at(share) for share in way.shares]
    if not _bends_along(state, poses):
        problem = f"the arm does not reach the whole path of the handle of '{name}'; remove it, and explain"
        yield Violation("unreachable", problem)
        return
    yield from _hand_hits(state, name, poses)
    yield from _objects_met(state, name, way)


def _bends_along(state: SymbolicState, poses: list[Pose]) -> bool:
    """True if the arm passes all poses within its joint limits and on one branch of its kinematics."""
    # Test the end and the middle first: most ways out of reach fail there.
    if not (reaches(state, poses[-1]) and reaches(state, poses[len(poses) // 2])):
        return False
    bent = [solids(state.scene).configuration(pose) for pose in poses]
    found = np.array([q for q in bent if q is not None])
    if len(found) < len(bent) or np.abs(np.diff(found, axis=0)).max() > FOLDED:
        return False
    return all(within_joint_limits(state.scene.arm, q, LIMIT_MARGIN) for q in found)


def _hand_hits(state: SymbolicState, name: str, poses: list[Pose]) -> Iterator[Violation]:
    """Violation for a way on which the arm would meet a body other than the fixture itself."""
    shapes = solids(state.scene)
    ends = shapes.configuration(poses[0]), shapes.configuration(poses[-1])
    if ends[0] is None or ends[1] is None:
        return
    # Path of the open hand on the handle, and of the arm that carries it.
    hand = ArmPath(
        np.array([pose.position for pose in poses]),
        np.array([pose.quaternion for pose in poses]),
        np.full(len(poses), state.scene.arm.hand.opening),
    )
    swept = arm_sweep(state, arm_path(shapes, hand, (ends[0], ends[1])), ARM)
    pairs = list(map(swept.of, range(len(swept.pairs))))
    margins = np.array([_margin(state, name, *pair) for pair in pairs])
    hit = swept.first(margins) if len(margins) else None
    if hit is not None:
        yield Violation(
            "collision",
            f"on the path of '{name}' the arm's {hit.part.owner} would come too near to "
            f"'{hit.other.owner}' at {hit.place}; choose another pose, or remove it, and explain",
        )


def _margin(state: SymbolicState, name: str, part: ShapePart, other: ShapePart) -> float:
    """Least allowed distance of two parts, m."""
    if other.owner == name:
        return -np.inf  # it moves with the hand
    if LINK in (part.kind, other.kind):
        return ARM
    return BESIDE if other.owner in state.scene.objects else FIXED


def _objects_met(state: SymbolicState, name: str, way: Way) -> Iterator[Violation]:
    """Violation for the first object that is near the fixture anywhere on its way."""
    shapes = solids(state.scene)
    # Shapes of the fixture, moved as a rigid body along its joint.
    own = [shape for shape in shapes.fixed if shapes.owners[shape.geom] == name]
    moving = ShapeGroup.of(own)
    motions = [way.joint.motion(share * way.travel) for share in way.shares]
    for other in state.scene.objects:
        place = state.pose_of(other)
        there = shapes.objects[other].at(place.position[None], place.rotation[None])
        for i, motion in enumerate(motions):
            here = moving.at(motion.position[None], motion.rotation[None])
            if _near(shapes, moving.geoms, shapes.objects[other].geoms, here, there):
                where = "in its path" if i else "in it or on it"
                yield Violation(
                    "blocked", f"'{other}' is {where} as '{name}' moves; {carry_away(other)}"
                )
                return


def _near(
    shapes: Solids, some: Sequence[int], others: Sequence[int], here: Frames, there: Frames
) -> bool:
    """True if a geom of `some`, at `here`, is within `CLEAR` of a geom of `others`, at `there`."""
    for i, geom in enumerate(some):
        for j, other in enumerate(others):
            # Bounding spheres rule out most pairs; the others are measured exactly.
            apart = np.linalg.norm(here.positions[0, i] - there.positions[0, j])
            if apart - shapes.radii[geom] - shapes.radii[other] > CLEAR:
                continue
            if shapes.distance(geom, here, i, other, there, j) < CLEAR:
                return True
    return False
