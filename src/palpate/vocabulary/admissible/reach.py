"""Reach of the arm."""

from __future__ import annotations

from palpate.geometry.pose import Array, Pose
from palpate.robots.kinematics import reachable, within_joint_limits
from palpate.scene.symbols import PoseExpression
from palpate.vocabulary.state import HOME_CONFIG, SymbolicState
from palpate.vocabulary.violation import Violation

SHARES = (0.75, 0.5, 0.25, 0.1)
"""Of the offsets of a pose that is out of reach, which are tried instead."""


def out_of_reach(state: SymbolicState, pose_world_tcp: Pose, name: str) -> list[Violation]:
    """Violation for the pose called `name` beyond the arm's reach, or None."""
    if _reaches(state, pose_world_tcp):
        return []
    return [
        Violation(
            "unreachable",
            f"{too_far(pose_world_tcp, name)}; {_instead(state, name)}, or leave out what needs it "
            "and explain",
        )
    ]


def _instead(state: SymbolicState, name: str) -> str:
    """Advice for a pose expression out of reach: the same with smaller offsets."""
    symbols = state.scene.symbols
    expression = symbols.parse(name)
    for share in SHARES:
        terms = tuple((round(share * factor, 2), offset) for factor, offset in expression.terms)
        smaller = PoseExpression(expression.name, terms)
        if terms and _reaches(state, symbols.resolve(smaller, state.bound)):
            return f"write MovePose '{smaller}', which is within reach"
    return "choose a pose nearer to the base"


def too_far(pose_world_tcp: Pose, name: str) -> str:
    """Message for the pose called `name` beyond the arm's reach."""
    x, y, z = pose_world_tcp.position
    return f"'{name}' at ({x:.3f}, {y:.3f}, {z:.3f}) m is out of the arm's reach"


def beyond_joint_limits(state: SymbolicState, joints: Array) -> list[Violation]:
    """Violation for seven joint angles, rad, beyond the joint limits, or None."""
    if within_joint_limits(state.scene.arm, joints):
        return []
    shown = [round(angle, 3) for angle in joints.tolist()]
    return [
        Violation(
            "unreachable",
            f"joint angles {shown} rad are beyond the arm's limits; write MoveJoints '{HOME_CONFIG}'",
        )
    ]


def _reaches(state: SymbolicState, pose_world_tcp: Pose) -> bool:
    if state.reaches is not None:
        return state.reaches(pose_world_tcp)
    return reachable(state.scene.arm, pose_world_tcp, state.scene.pose_world_base)
