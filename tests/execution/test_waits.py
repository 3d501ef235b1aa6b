"""Leaves that need no look at a simulated robot let it run on; the run stays the same."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from palpate.execution import runner
from palpate.planning.plan import Node, Plan
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.load import parse_scene

SCENE = parse_scene("""<mujoco><worldbody>
<body name="table" pos="0.5 0 0.05"><geom type="box" size="0.3 0.4 0.05"/></body>
<body name="cup" pos="0.5 0.1 0.15"><freejoint/><geom type="box" size="0.02 0.03 0.05" mass="0.3"/></body>
</worldbody></mujoco>""")


def leaf(kind: str, **args: object) -> Node:
    return Node(kind, tuple(args.items()))


PLAN = Plan(
    (),
    Node(
        "Sequence",
        (),
        (
            leaf("OpenGripper"),
            leaf("MovePose", pose="table_approach"),
            leaf("MoveUntilContact", axis="-z"),
            leaf("MovePose", pose="table_approach"),
            leaf("MeasureForces"),
            leaf("MoveJoints", joints="home_config"),
        ),
    ),
    "touch the table",
)


class _Counted(MujocoRobot):
    """Counts what is asked of it."""

    asked = 0

    def advance(self, duration: float) -> None:
        self.asked += 1
        super().advance(duration)


def executed(longest: float) -> tuple[runner.Execution, int]:
    robot = _Counted(SCENE.spec(), SCENE.pose_world_base, SCENE.arm)
    with patch.object(runner, "LONGEST_WAIT", longest):
        return runner.run(PLAN, SCENE, robot, noiseless=True), robot.asked


def test_a_run_that_waits_is_the_same_run_with_fewer_looks() -> None:
    (ticked, every), (waited, asked) = executed(0.0), executed(runner.LONGEST_WAIT)
    assert (ticked.status, waited.status) == ("complete", "complete")
    assert asked < 0.75 * every
    for one, other in zip(ticked.trace.leaves, waited.trace.leaves, strict=True):
        assert one.label == other.label
        assert other.end - other.start == pytest.approx(one.end - one.start, abs=0.0401)
    heights = [run.trace.samples.pose_world_tcp[:, 2].min() for run in (ticked, waited)]
    assert heights[0] == pytest.approx(heights[1], abs=1e-4)
    pressed = [run.trace.wrench[:, 2].min() for run in (ticked, waited)]
    assert pressed[0] == pytest.approx(pressed[1], abs=1.0)
    assert np.diff(waited.trace.t) == pytest.approx(0.005, abs=1e-9)
