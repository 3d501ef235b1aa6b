"""Reach of the arm, and room for it at `home_config`, where every plan begins."""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.robots.accuracy import mistaken_moment
from palpate.robots.description import RobotDescription
from palpate.robots.kinematics import within_joint_limits
from palpate.robots.nominal import SWUNG
from palpate.scene.scene import Scene
from palpate.scene.symbols import PoseExpression
from palpate.vocabulary.admissible.collision_geometry import LINK, arm_sweep
from palpate.vocabulary.admissible.path import joint_path
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.state import HOME_CONFIG, SymbolicState, pose_of_joints
from palpate.vocabulary.violation import PRECONDITION, Violation

APART = 0.05
"""rad of any joint between two configurations of a joint motion."""
NONSENSE = 0.1  # rad beyond the joint limits from which on no way is judged
UNFELT = 12.0
"""N m: moment on the hand that errors of the joints' torques look like, from which on a contact is not felt."""
SHARES = (0.75, 0.5, 0.25, 0.1)
"""Parts of the offsets of a pose out of reach that are tried as a remedy."""


def out_of_reach(state: SymbolicState, pose_world_tcp: Pose, name: str) -> list[Violation]:
    """Violation for the pose called `name` beyond the arm's reach; empty within it."""
    if reaches(state, pose_world_tcp):
        return []
    problem = (
        f"{too_far(pose_world_tcp, name)}; {_nearer(state, name)}, or leave out what needs it "
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
    """True for joint angles (7,), rad, within the joint limits or close to them. A path is sampled in even steps:
    one from or to angles far beyond would have any number of them."""
    return within_joint_limits(arm, joints, -NONSENSE)


def swings(start: Pose | None, end: Pose) -> bool:
    """True if the tool's axis turns so far between two poses that a straight way could fold the wrist."""
    return start is not None and float(start.rotation[:, 2] @ end.rotation[:, 2]) < SWUNG


def joints_between(start: Array, end: Array) -> Array:
    """(n, 7) rad, joint angles on the way of a joint motion, its ends included."""
    count = int(np.ceil(float(np.abs(end - start).max()) / APART)) + 1
    return np.linspace(start, end, max(count, 2))


def unfelt(state: SymbolicState, joints: Array) -> list[Violation]:
    """Violation for a joint motion between a level hand and one that points down, through a configuration in which a
    contact is not felt: with the wrist in line, errors of the torques look like any moment."""
    arm, start = state.scene.arm, state.q
    pose = pose_of_joints(state.scene, joints)
    if start is None or not swings(state.pose_world_tcp, pose):
        return []
    if not is_a_posture(arm, start):
        return []
    if max(mistaken_moment(arm, q) for q in joints_between(start, joints)) < UNFELT:
        return []
    problem = (
        "between a level hand and one that points down, the wrist is turned first, and the arm moved then: "
        "MoveJoints to the fixture's `_level` in between"
    )
    return [Violation(PRECONDITION, problem)]


def require_room(scene: Scene) -> None:
    """Require that nothing overlaps the arm at home: no plan could avoid that.

    Raises:
        InputError: something overlaps a link, the hand or a closed finger there.
    """
    home = scene.symbols.joints(HOME_CONFIG)
    still = joint_path(solids(scene), home, home, width=0.0)
    overlaps = arm_sweep(SymbolicState(scene), still, 0.0).overlaps()
    found = [hit for hit in overlaps if hit.other.kind != LINK]
    if not found:
        return
    deepest = min(found, key=lambda hit: hit.distance)
    part, name = deepest.part.owner, deepest.other.owner
    raise InputError(
        "the arm has no room in this scene: at 'home_config', where every plan begins, its "
        f"{part} is {-1e3 * deepest.distance:.1f} mm inside '{name}', at {deepest.place}; correct "
        f"where '{name}' is or how large it is, or where the arm stands"
    )
