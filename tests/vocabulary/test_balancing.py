"""A pose that a run finds out: where an object balances."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from performing import make as make
from workbench import bench, plan, sequence

from palpate.estimation.estimate import Estimate, Verdict
from palpate.execution.runner import run
from palpate.planning.check.check import check
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.scene import Scene
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.motion import balancing
from palpate.vocabulary.motion.move_pose import MovePose
from palpate.vocabulary.state import SymbolicState

BAR = (
    '<body name="bar" pos="0.50 0.00 0.015"><freejoint/>{inertial}'
    '<geom type="box" size=".11 .012 .015" friction="0.7"/></body>'
)
UNKNOWN = BAR.format(inertial='<inertial pos="? ? ?" mass="?" diaginertia="? ? ?"/>')
POST = '<body name="post" pos="0.60 0.055 0.06"><geom type="box" size=".012 .012 .06"/></body>'
HEAVIER = 0.03
"""m along the bar, of the hidden centre of mass."""
TRUE = BAR.format(
    inertial=f'<inertial pos="{HEAVIER} 0 0" mass="0.3" diaginertia="1e-4 1e-3 1e-3"/>'
)
GRASP = ("CloseGripper", "MovePose {0} + z_offset", "MeasureForces", "MovePose {0}", "OpenGripper")


@pytest.fixture(scope="module")
def bar() -> Scene:
    return bench(UNKNOWN)


def estimated(along: float, std: float, verdict: Verdict = "identified") -> Any:
    """What is estimated in the place of any trace."""

    def all_of_them(parameters: Any, trace: Any, bodies: Any) -> tuple[Estimate]:
        (parameter,) = parameters
        value = np.array([along, 0.0, 0.0])
        return (Estimate.normal(parameter, "m", value, np.full(3, std), "told", verdict=verdict),)

    return all_of_them


def bound(scene: Scene, monkeypatch: pytest.MonkeyPatch, estimates: Any) -> Blackboard:
    """A blackboard on which a motion to the balance point has found out where that is."""
    monkeypatch.setattr(balancing, "estimate_all", estimates)
    recorder = SimpleNamespace(snapshot=lambda: None)
    blackboard = Blackboard(cast(Any, None), SymbolicState(scene), cast(Any, recorder))
    MovePose(pose="bar_balance + z_offset").bind(blackboard)
    return blackboard


def along(blackboard: Blackboard) -> float:
    """m from the bar's middle to where the motion goes, along the bar."""
    target = MovePose(pose="bar_balance").target(blackboard.state).position
    body = blackboard.scene.body("bar")
    return float(body.pose_world.local(target)[0])


def test_before_anything_is_measured_it_is_the_middle_and_says_so(bar, monkeypatch):
    found = bound(bar, monkeypatch, estimated(0.0, 0.0, "prior-dominated"))
    assert along(found) == pytest.approx(0.0, abs=1e-3)
    assert "as believed: prior-dominated so far" in found.bound["bar_balance"]


def test_afterwards_it_is_the_estimate_and_stays_so(bar, monkeypatch):
    found = bound(bar, monkeypatch, estimated(0.03, 0.002))
    assert along(found) == pytest.approx(0.03)
    assert "as measured to ± 2.0 mm" in found.bound["bar_balance"]
    monkeypatch.setattr(balancing, "estimate_all", estimated(-0.03, 0.001))
    MovePose(pose="bar_balance").bind(found)
    assert along(found) == pytest.approx(0.03)


def test_an_estimate_that_may_as_well_be_the_believed_place_is_not_gone_to(bar, monkeypatch):
    found = bound(bar, monkeypatch, estimated(0.03, 0.05))
    assert along(found) == pytest.approx(0.0, abs=1e-3)
    assert "± 50 mm" in found.bound["bar_balance"]


def test_it_stays_in_the_region_and_a_place_outside_is_refused(bar, monkeypatch):
    line = bar.symbols.lines["bar_balance"]
    found = bound(bar, monkeypatch, estimated(1.0, 0.002))
    assert max(abs(place - along(found)) for place in (line.least, line.most)) < 0.25
    assert found.state.bound["bar_balance"] in (line.least, line.most)
    outside = SymbolicState(bar, bound={"bar_balance": line.most + 0.001})
    (violation,) = MovePose(pose="bar_balance").requires(outside)
    assert "outside" in violation.message


def visit(pose: str) -> list[str]:
    above = f"MovePose {pose} + z_offset"
    return [above, f"MovePose {pose}", *(action.format(pose) for action in GRASP), above]


WEIGHED = sequence(
    "MoveJoints home_config",
    "OpenGripper",
    *visit("bar_pose"),
    *visit("bar_pose - x_offset"),
    *visit("bar_balance"),
    "MoveJoints home_config",
)


def test_a_plan_is_refused_where_a_part_of_the_region_does_not_pass(bar):
    assert check(plan(WEIGHED, "bar.com"), bar) == ()
    (finding,) = check(plan(WEIGHED, "bar.com"), bench(UNKNOWN, POST))
    assert finding.rule in ("blocked", "collision")
    assert "'bar_balance' is found out by running and may be anywhere" in finding.message
    assert "'post'" in finding.message


def test_a_bar_that_is_grasped_where_it_is_believed_to_balance_is_not_gone_to_again(bar):
    tree = SymbolicPlanner().plan("the mass and the centre of mass of the bar", bar).tree
    assert tree is not None
    assert not any("balance" in str(node.args) for _, node in tree.walk())


def test_a_plan_goes_to_where_the_run_finds_the_bar_to_balance(bar):
    world = bench(TRUE)
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm)
    tree = sequence(
        "MoveJoints home_config", "OpenGripper", *visit("bar_pose"), *visit("bar_balance")
    )
    done = run(plan(tree), bar, robot)
    assert done.stopped_by is None
    start = bar.body("bar").pose_world
    closed = list(done.trace.leaf_runs("CloseGripper"))[-1]
    tcp = done.trace.samples.between(closed.start, closed.end).pose_world_tcp[0, :3]
    assert start.local(tcp)[0] == pytest.approx(HEAVIER, abs=0.003)
    assert "as measured" in next(
        one.message for one in done.trace.leaves if one.label == "MovePose(bar_balance + z_offset)"
    )
