from __future__ import annotations

import numpy as np
import pytest
from standin import CELL, IN_HAND, TICK, StandIn

from palpate.primitives.base import Blackboard, Recorder
from palpate.primitives.guarding import SET_DOWN, lower, wait_guarded_span
from palpate.primitives.load import FingerLoad
from palpate.primitives.motion import MovePose
from palpate.primitives.rules.profile import PathSpan
from palpate.primitives.state import SymbolicState
from palpate.scene.load import parse_scene

DOWN = np.array([0.0, 0.0, -0.05])


def lowered(robot: StandIn, rest: float) -> bool:
    """True if the cup in the fingers counts as set down before the end of its way down; the empty hand read
    `rest`, N, before it took the cup."""
    start = robot.state.pose_world_tcp
    span = PathSpan(start, start.translate(DOWN), guarded=True)
    state = SymbolicState(parse_scene(CELL), holding="cup", pose_tcp_object=IN_HAND)
    blackboard = Blackboard(robot, state, Recorder(robot))
    blackboard.load = FingerLoad(empty=np.array([0.0, 0.0, rest, 0.0, 0.0, 0.0]))
    robot.put(gripping=True)
    robot.gripping_after = True
    robot.move_pose(span.end, 0.02)
    steps = wait_guarded_span(blackboard, span, 0.0, True, "cup_pose")
    while True:
        try:
            next(steps)
        except StopIteration as done:
            return done.value
        robot.advance(TICK)


@pytest.mark.parametrize("rest", [0.0, 8.0])
def test_friction_that_a_rest_kept_is_no_support(rest):
    robot = StandIn()
    robot.weight, robot.force = 0.3, np.array([0.0, 0.0, -2.5, 0.0, 0.0, 0.0])
    assert not lowered(robot, rest)


@pytest.mark.parametrize("rest", [-8.0, 0.0, 8.0])
def test_a_support_that_is_met_early_ends_the_way_down(rest):
    robot = StandIn()
    robot.weight, robot.support_z = 0.3, robot.state.pose_world_tcp.position[2] - 0.02
    assert lowered(robot, rest)
    pressed = robot.weight - robot.state.wrench[2]
    assert SET_DOWN < pressed < SET_DOWN + max(-rest, 0.0) + 4.0


def test_a_force_above_that_of_carrying_means_a_pressed_object():
    robot = StandIn()
    robot.weight, robot.support_z = 12.0, robot.state.pose_world_tcp.position[2] - 0.001
    state = SymbolicState(parse_scene(CELL), holding="cup", pose_tcp_object=IN_HAND, lifted=True)
    blackboard, leaf = Blackboard(robot, state, Recorder(robot)), MovePose(pose="cup_pose")
    blackboard.load = FingerLoad(
        empty=np.zeros(6), hanging=np.array([0.0, 0.0, 12.0, 0.0, 0.0, 0.0])
    )
    robot.put(gripping=True)
    robot.gripping_after = True
    said: dict[bool, set[bool]] = {False: set(), True: set()}
    for _ in lower(blackboard, "cup_pose"):
        moving = robot.state.moving
        rubs = -38.0 if moving else 0.0
        robot.force = np.array([0.0, 0.0, rubs, 0.0, 0.0, 0.0])
        robot.advance(TICK)
        said[moving].add(leaf.unsafe(blackboard) is None)
    assert said == {False: {True}, True: {True}}
    robot.force = np.array([0.0, 0.0, -38.0, 0.0, 0.0, 0.0])
    robot.advance(TICK)
    assert "unexpected contact" in str(leaf.unsafe(blackboard))
    interrupted = lower(blackboard, "cup_pose")
    robot.support_z -= 0.01
    robot.force = np.zeros(6)
    while blackboard.state.lifted:
        next(interrupted)
        robot.advance(TICK)
    interrupted.close()
    assert blackboard.state.lifted
