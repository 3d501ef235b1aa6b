"""Collision geometry of a sweep, and reach of the arm at `home_config`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, Frames, Pose
from palpate.primitives.rules.arrangement import ShapePart, arrangement
from palpate.primitives.rules.clearance import ArmPath, hand_path, joint_path
from palpate.primitives.rules.grip import grip
from palpate.primitives.rules.solids import SIDES, ShapeGroup, Solids, solids
from palpate.primitives.rules.sweep import Sweep
from palpate.primitives.state import (
    HOME_CONFIG,
    PRECONDITION,
    SymbolicState,
    Violation,
    pose_of_joints,
)
from palpate.robots.description import RobotDescription
from palpate.robots.kinematics import within_joint_limits
from palpate.robots.nominal import SWUNG
from palpate.robots.pace import mistaken_moment
from palpate.scene.scene import Scene
from palpate.scene.symbols import PoseExpression

HAND = "hand"
LOAD = "load"
LINK = "link"  # Kinds of parts of the arm, besides the two fingers
# Joints between two parts of the arm, up to which the pair is not tested. Parts so close in the
# chain either cannot touch, or always nearly do.
NEIGHBOURS = 2
SPACING = 0.01  # m between two moments of `near_spans`


def hand_sweep(state: SymbolicState, path: ArmPath, growth: float) -> Sweep:
    """Sweep of the hand, its fingers and the load, among everything within `growth` m but the load."""
    return _sweep(state, path, growth, {}, {})


def arm_sweep(
    state: SymbolicState, path: ArmPath, growth: float, higher: Mapping[str, float] | None = None
) -> Sweep:
    """Sweep of the whole arm with hand and load along a path with joint angles.

    It is tested against everything within `growth` m but the load, and against its own links. Each
    object in `higher` is tested at a second pose as well, raised by that many m.
    """
    return _sweep(state, path, growth, higher or {}, solids(state.scene).links)


def near_spans(
    state: SymbolicState, start: Pose, end: Pose, growth: float
) -> tuple[tuple[float, float], ...]:
    """Shares (first, last) of a straight path on which anything may be within `growth` m.

    The TCP goes from `start` to `end` (world) with hand, fingers and load. The spans are in order
    and disjoint.
    """
    path = hand_path(solids(state.scene), start, end, opening(state), SPACING)
    near = hand_sweep(state, path, growth).near(growth)
    # Edges of a mask: where it changes between False and True.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    spans = (edges / len(near)).reshape(-1, 2).tolist()
    return tuple((first, last) for first, last in spans)


def opening(state: SymbolicState) -> float:
    """Believed opening of the fingers, m; open where nothing is known."""
    if state.holding is not None and state.pose_tcp_object is not None:
        held = grip(solids(state.scene), state.holding, state.pose_tcp_object)
        return held.width if held is not None else 0.0
    return 0.0 if state.gripper == "closed" else state.scene.arm.hand.opening


@dataclass(frozen=True, slots=True, eq=False)
class ToolShapes:
    """Shapes that move with the tool: the hand, the closed fingers and the held object."""

    # parts, group: the shapes, in the tool frame
    parts: tuple[ShapePart, ...]
    group: ShapeGroup
    sides: Array  # (k,) displacement of each shape along the tool's y per metre of opening

    def at(self, path: ArmPath) -> Frames:
        """Frames along a path."""
        # The fingers move along the tool's y axis with half the opening each.
        rotations = path.rotations()
        hand = self.group.at(path.positions, rotations)
        beside = path.widths[:, None, None] * self.sides[:, None] * rotations[:, None, :, 1]
        return Frames(hand.positions + beside, hand.rotations)


def _sweep(
    state: SymbolicState,
    path: ArmPath,
    growth: float,
    higher: Mapping[str, float],
    joints: Mapping[int, int],
) -> Sweep:
    """Return the cached sweep of a path, reversed or not; `joints` are the links' geoms with joint numbers."""
    if path.forth is not None:
        return _sweep(state, path.forth, growth, higher, joints).back()
    if not path.key:
        return _new_sweep(state, path, growth, higher, joints)
    # The key has the path and all poses of objects and of the load.
    load = state.pose_tcp_object and state.pose_tcp_object.digits
    around = (state.holding, load, *state.others(state.holding), *sorted(higher.items()))
    key = ("sweep", *path.key, growth, *around)
    return solids(state.scene).recent(key, lambda: _new_sweep(state, path, growth, higher, joints))


def _new_sweep(
    state: SymbolicState,
    path: ArmPath,
    growth: float,
    higher: Mapping[str, float],
    joints: Mapping[int, int],
) -> Sweep:
    # The moving parts are hand, fingers and load, then the links of the arm.
    shapes, still, carried = solids(state.scene), arrangement(state, higher), _carried_load(state)
    links = [ShapePart(geom, LINK, shapes.owners[geom]) for geom in joints]
    # Number of the joint before each part: 0 for the base, -inf for bodies that are not of the arm.
    # A pair is tested if more than NEIGHBOURS joints lie between its parts.
    last = len(state.scene.arm.joints) + 1
    before = np.array([*[last] * len(carried.parts), *joints.values()], dtype=float)
    fixed = np.where(still.owners == state.scene.arm.base, 0.0, -np.inf)
    meets = before[:, None] - np.concatenate([before, fixed]) > NEIGHBOURS

    def place(path: ArmPath) -> Frames:
        if not links:
            return carried.at(path)
        assert path.q is not None
        return Frames.concatenate([carried.at(path), path.links or shapes.links_at(path.q)])

    return Sweep(shapes, path, (*carried.parts, *links), place, still, meets, growth)


def _carried_load(state: SymbolicState) -> ToolShapes:
    """Shapes of the hand and the held object, in the tool frame."""
    # The hand with closed fingers is the same in all states: compute it once.
    shapes, held = solids(state.scene), state.pose_tcp_object
    hand = shapes.get_or_compute("hand", lambda: _hand(shapes))
    if state.holding is None or held is None:
        return hand
    load = shapes.objects[state.holding]
    # The load's shapes, transformed from the object's frame into the tool frame.
    there = load.at(held.position[None], held.rotation[None])
    group = ShapeGroup(
        (*hand.group.geoms, *load.geoms),
        np.concatenate([hand.group.positions, there.positions[0]]),
        np.concatenate([hand.group.rotations, there.rotations[0]]),
    )
    parts = (*hand.parts, *(ShapePart(geom, LOAD, state.holding) for geom in load.geoms))
    return ToolShapes(parts, group, np.concatenate([hand.sides, np.zeros(len(load.geoms))]))


def _hand(shapes: Solids) -> ToolShapes:
    """Shapes of the hand with closed fingers, and the side to which each finger opens."""
    parts = [ShapePart(geom, HAND, HAND) for geom in shapes.hand.geoms]
    found = list(shapes.hand)
    for side, finger in shapes.fingers.items():
        parts += [ShapePart(geom, side, side) for geom in finger.geoms]
        found += finger
    sides = np.array([SIDES.get(part.kind, 0.0) for part in parts]) / 2
    return ToolShapes(tuple(parts), ShapeGroup.of(found), sides)


# Reach of the arm, and its clearance at `home_config`, where every plan begins.


APART = 0.05  # rad, largest step of any joint between two samples of a joint motion
NONSENSE = 0.1  # rad beyond the joint limits from which on no path is judged
# N m. Errors of the joint torques can look like a moment on the hand. From this moment on, a
# contact is not detected.
UNFELT = 12.0
# Factors on the offsets of a pose out of reach that are tried as a remedy.
SHARES = (0.75, 0.5, 0.25, 0.1)


def out_of_reach(state: SymbolicState, pose_world_tcp: Pose, name: str) -> list[Violation]:
    """Violation for the pose called `name` beyond the arm's reach; empty within it."""
    if reaches(state, pose_world_tcp):
        return []
    problem = (
        f"{too_far(pose_world_tcp, name)}; {_nearer(state, name)}, or remove what needs it "
        "and explain"
    )
    return [Violation("unreachable", problem)]


def reaches(state: SymbolicState, pose_world_tcp: Pose) -> bool:
    """True if the arm reaches a pose."""
    if state.reaches is not None:
        return state.reaches(pose_world_tcp)
    return solids(state.scene).reaches(pose_world_tcp)


def _nearer(state: SymbolicState, name: str) -> str:
    """Remedy for a pose expression out of reach: the same with smaller offsets."""
    symbols = state.scene.symbols
    expression = symbols.parse(name)
    for share in SHARES:
        # Scale all offsets of the expression by the same factor.
        terms = tuple((round(share * factor, 2), offset) for factor, offset in expression.terms)
        smaller = PoseExpression(expression.name, terms)
        if reaches(state, symbols.resolve(smaller, state.bound)):
            return f"write MovePose '{smaller}', which is within reach"
    return "choose a pose nearer to the base"


def too_far(pose_world_tcp: Pose, name: str) -> str:
    """Message for the pose called `name` beyond the arm's reach."""
    x, y, z = pose_world_tcp.position
    return f"'{name}' at ({x:.3f}, {y:.3f}, {z:.3f}) m is out of the arm's reach"


def beyond_joint_limits(state: SymbolicState, joints: Array) -> list[Violation]:
    """Violation for joint angles (7,), rad, beyond the joint limits; empty within them."""
    if within_joint_limits(state.scene.arm, joints):
        return []
    shown = [round(angle, 3) for angle in joints.tolist()]
    problem = (
        f"joint angles {shown} rad are beyond the arm's limits; write MoveJoints '{HOME_CONFIG}'"
    )
    return [Violation("unreachable", problem)]


def is_a_posture(arm: RobotDescription, joints: Array) -> bool:
    """True for joint angles (7,), rad, within the joint limits or close to them.

    A path is sampled in even steps. Angles far beyond the limits would need an unbounded number.
    """
    return within_joint_limits(arm, joints, -NONSENSE)


def swings(start: Pose | None, end: Pose) -> bool:
    """True if the tool's axis turns so far between two poses that a straight path could fold the wrist."""
    return start is not None and float(start.rotation[:, 2] @ end.rotation[:, 2]) < SWUNG


def joints_between(start: Array, end: Array) -> Array:
    """(n, 7) rad, joint angles of a joint motion, at most `APART` rad apart, both ends included."""
    count = int(np.ceil(float(np.abs(end - start).max()) / APART)) + 1
    return np.linspace(start, end, max(count, 2))


def unfelt(state: SymbolicState, joints: Array) -> list[Violation]:
    """Violation for a joint motion on which a contact would not be detected.

    Between a level hand and one that points down, the wrist may come into line. Errors of the joint
    torques then look like a large moment on the hand (`mistaken_moment`).
    """
    # Only a large turn of the tool's axis can bring the wrist into line.
    arm, start = state.scene.arm, state.q
    pose = pose_of_joints(state.scene, joints)
    if start is None or not swings(state.pose_world_tcp, pose):
        return []
    if not is_a_posture(arm, start):
        return []
    if max(mistaken_moment(arm, q) for q in joints_between(start, joints)) < UNFELT:
        return []
    problem = (
        "between a level hand and one that points down, the wrist turns before the arm moves: "
        "MoveJoints to the fixture's `_level` in between"
    )
    return [Violation(PRECONDITION, problem)]


def require_room(scene: Scene) -> None:
    """Require that nothing overlaps the arm at `home_config`; no plan could avoid that.

    Raises InputError: something overlaps a link, the hand or a closed finger there.
    """
    home = scene.symbols.joints(HOME_CONFIG)
    # A path of zero length, with the fingers closed: only overlaps at its start matter.
    still = joint_path(solids(scene), home, home, width=0.0)
    overlaps = arm_sweep(SymbolicState(scene), still, 0.0).overlaps()
    # Overlaps between links are a matter of the arm's description, not of the scene.
    found = [hit for hit in overlaps if hit.other.kind != LINK]
    if not found:
        return
    deepest = min(found, key=lambda hit: hit.distance)
    part, name = deepest.part.owner, deepest.other.owner
    raise InputError(
        f"the arm collides with the scene at 'home_config', where every plan starts: its {part} is "
        f"{-1e3 * deepest.distance:.1f} mm inside '{name}', at {deepest.place}; correct the pose or "
        f"size of '{name}', or the place of the arm"
    )
