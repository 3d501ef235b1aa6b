"""Plans that go to poses which a run finds out: all of their regions must pass."""

from __future__ import annotations

import pytest
from workbench import BAR, BESIDE_ITS_END, bench, plan, sequence, visit

from palpate.planning.check.check import check
from palpate.scene.scene import Scene

START = ("MoveJoints home_config", "OpenGripper")
HOME = "MoveJoints home_config"


@pytest.fixture(scope="module")
def bar() -> Scene:
    return bench(BAR)


def test_a_plan_is_refused_where_a_part_of_the_region_does_not_pass(bar):
    three = [*visit("bar_pose"), *visit("bar_pose + x_offset"), *visit("bar_balance")]
    weighed = plan(sequence(*START, *three, HOME), "bar.com")
    assert check(weighed, bar) == ()
    (finding,) = check(weighed, bench(BAR, BESIDE_ITS_END))
    assert finding.rule in ("blocked", "collision")
    assert "'bar_balance' is estimated in the run, between" in finding.message
    assert "'post'" in finding.message


def test_an_object_put_down_elsewhere_than_its_grasp_is_not_restored(bar):
    carried = sequence(*START, *visit("bar_balance")[:5], *visit("bar_pose")[5:], HOME)
    by_name = {finding.rule: finding.message for finding in check(plan(carried), bar)}
    assert "estimated in the run" in by_name["not-restored"]


def test_a_motion_between_two_estimated_poses_is_refused():
    two = bench(BAR, BAR.replace("bar", "rod").replace("0.00", "0.20"))
    hop = sequence(
        *START, "MovePose bar_balance + z_offset", "MovePose rod_balance + z_offset", HOME
    )
    (finding,) = (item for item in check(plan(hop), two) if item.rule == "unknown-start")
    assert finding.path == "tree.children[3]"
    assert "MovePose to 'rod_pose + z_offset' first" in finding.message
