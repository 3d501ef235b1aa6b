"""A pose that a run finds out: where an object balances."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from workbench import BAR, bench, plan, sequence, visit

from palpate.estimation.estimate import Estimate, Verdict
from palpate.execution.runner import run
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.scene import Scene
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.motion import balancing
from palpate.vocabulary.motion.move_pose import MovePose
from palpate.vocabulary.state import SymbolicState

HEAVIER = 0.03
"""m along the bar, of the hidden centre of mass."""
TRUE = BAR.replace('"? ? ?" mass="?"', f'"{HEAVIER} 0 0" mass="0.3"').replace(
    '"? ? ?"', '"1e-4 1e-3 1e-3"'
)


@pytest.fixture(scope="module")
def bar() -> Scene:
    return bench(BAR)


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
    assert "as believed: measured +30 ± 50 mm from there" in found.bound["bar_balance"]


def test_it_stays_in_the_region_and_a_place_outside_is_refused(bar, monkeypatch):
    line = bar.symbols.lines["bar_balance"]
    for far, end in ((1.0, line.most), (-1.0, line.least)):
        found = bound(bar, monkeypatch, estimated(far, 0.002))
        assert found.state.bound["bar_balance"] == pytest.approx(end)
        assert MovePose(pose="bar_balance").requires(found.state) == []
    outside = SymbolicState(bar, bound={"bar_balance": line.most + 0.001})
    (violation,) = MovePose(pose="bar_balance").requires(outside)
    assert "outside" in violation.message


def test_poses_may_name_another_pose_so():
    told = bench(BAR, poses="places: {bar_balance: {pos: [0.52, 0.0, 0.02]}}")
    assert "bar_balance" not in told.symbols.lines
    assert told.symbols.resolve("bar_balance").position[0] == pytest.approx(0.52)


def test_a_plan_goes_to_where_the_run_finds_the_bar_to_balance(bar):
    world = bench(TRUE)
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm)
    tree = sequence(
        "MoveJoints home_config", "OpenGripper", *visit("bar_pose"), *visit("bar_balance")
    )
    done = run(plan(tree), bar, robot)
    assert done.stopped_by is None
    closed = list(done.trace.leaf_runs("CloseGripper"))[-1]
    tcp = done.trace.samples.between(closed.start, closed.end).pose_world_tcp[0, :3]
    assert bar.body("bar").pose_world.local(tcp)[0] == pytest.approx(HEAVIER, abs=0.003)
    told = [leaf.label for leaf in done.trace.leaves if "as measured" in leaf.message]
    assert told == ["MovePose(bar_balance + z_offset)"]
