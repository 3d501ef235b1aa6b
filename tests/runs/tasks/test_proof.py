"""Tasks planned in prior and twin, carried out in a truth, on a box and on a tall cylinder."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, not_identified
from palpate.runs.proof import Proof, prove
from palpate.runs.tasks import DIRECTIONS, Slide, SpringPush, Throw, Topple
from palpate.runs.trial import trial_of
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

SCENE = """<mujoco><option timestep="0.002"/><worldbody>
  <site name="robot_base"/>
  <body name="desk" pos="0.4 0 0.47"><geom type="box" size=".6 .6 .03"/></body>
  <body name="block" pos="0.5 0.1 0.53"><freejoint/>
    <geom type="box" size=".04 .05 .03" mass="?" friction="? 0.005 0.0001"/></body>
  <body name="vase" pos="0.5 -0.2 0.6"><freejoint/>
    <geom type="cylinder" size=".03 .1" mass="0.4" friction="0.7 0.005 0.0001"/></body>
</worldbody></mujoco>
"""
MASS, FRICTION = Parameter("block.mass"), Parameter("block.friction")
TRUE = {MASS: (0.3,), FRICTION: (0.4,)}
X = DIRECTIONS[0]


@cache
def scene() -> Scene:
    return parse_scene(SCENE)


def measured(mass: float = 0.301, friction: float = 0.402) -> list[Estimate]:
    return [
        Estimate.normal(MASS, "kg", mass, 0.002, "weighed"),
        Estimate.normal(FRICTION, "1", friction, 0.004, "dragged"),
    ]


@cache
def proof() -> Proof:
    return prove(scene(), measured(), TRUE, draws=8)


def test_a_slide_goes_as_far_as_friction_lets_it() -> None:
    """After a push F for T, v = (F/m - mu g) T, and s = v T / 2 + v^2 / (2 mu g)."""
    world = trial_of(scene(), "block", TRUE)
    force = 2.5
    v = (force / 0.3 - 0.4 * 9.81) * 0.2
    expected = v * 0.2 / 2 + v**2 / (2 * 0.4 * 9.81)
    assert Slide(X).outcome(world, force) == pytest.approx(expected, rel=0.05)


def test_a_push_through_a_spring_stays_behind_by_friction_over_stiffness() -> None:
    world = trial_of(scene(), "block", TRUE)
    behind = 0.4 * 0.3 * 9.81 / SpringPush.stiffness
    on = SpringPush.speed**2 / (2 * 0.4 * 9.81)  # it slides on when the arm stops
    assert SpringPush(X).outcome(world, 0.1) == pytest.approx(0.1 - behind + on, abs=1e-3)


def test_a_box_tips_where_its_weight_leaves_its_foot() -> None:
    """F h = m g b / 2, for a box of height h and width b."""
    world = trial_of(scene(), "block", TRUE)
    assert Topple(X).plan(world) == pytest.approx(0.3 * 9.81 * 0.04 / 0.06, rel=0.06)


def test_a_throw_is_a_parabola() -> None:
    world = trial_of(scene(), "block", TRUE)
    force = Throw(X).plan(world)
    assert force is not None
    speed = force / np.sqrt(2) * 0.05 / 0.3 - np.array([0, 9.81 * 0.05])
    flight = (speed[1] + np.sqrt(speed[1] ** 2 + 2 * 9.81 * 0.53)) / 9.81
    assert speed[0] * flight == pytest.approx(0.5, rel=0.1)


def test_an_object_that_tips_when_stopped_is_pushed_through_a_spring() -> None:
    world = trial_of(scene(), "vase", {})
    assert Slide(X).plan(world) is None
    assert SpringPush(X).plan(world) is not None


def test_the_twin_lands_nearer_than_the_prior_and_within_its_promise() -> None:
    assert [row.task for row in proof().rows] == ["push to a mark", "topple", "throw to a mark"]
    assert {row.object for row in proof().rows} == {"block"}
    for row in proof().rows:
        assert row.depends
        (prior,), (twin,) = row.prior, row.twin
        low, high = row.promise
        assert abs(twin) < abs(prior) / 5
        assert low < twin < high


def test_draws_of_the_estimates_judge_without_a_truth() -> None:
    result = prove(scene(), measured()[:1], {}, draws=2)
    assert result.judge == "draws"
    for row in result.rows:
        assert len(row.twin) == len(row.prior) == len(row.drawn)


def test_a_task_on_which_nothing_measured_acts_says_so() -> None:
    friction = prove(scene(), measured()[1:], TRUE, draws=2)
    indifferent = [row.task for row in friction.rows if not row.depends]
    assert indifferent == ["topple", "throw to a mark"]
    assert "nothing measured matters" in str(friction)


def test_nothing_measured_is_nothing_to_prove() -> None:
    with pytest.raises(InputError, match="nothing to prove"):
        prove(scene(), [not_identified(MASS, "kg", "stopped")], TRUE)
