"""A width that is asked sets how often and how slowly an object is lifted."""

from __future__ import annotations

import pytest
from workbench import BOTTLE, CRATE, actions, bench

from palpate.common.parameter import Parameter
from palpate.estimation.quantities.mass import Mass
from palpate.estimation.quantities.quantity import Effort
from palpate.estimation.quantities.within import Within
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.planning.symbolic.efforts import site_of
from palpate.planning.symbolic.planner import SymbolicPlanner, assemble
from palpate.scene.scene import Scene

MASS = Parameter("bottle.mass")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return bench(BOTTLE, CRATE)


def planned(scene: Scene, request: str, **within: str) -> Plan:
    plan = SymbolicPlanner(within=Within.read(within)).plan(request, scene)
    assert check(plan, scene) == ()
    return plan


def speeds(plan: Plan) -> list[float]:
    """Those that are asked for, in order."""
    assert plan.tree is not None
    items = [dict(node.args).get("speed") for _, node in plan.tree.walk()]
    return [speed for speed in items if speed is not None]


def test_empty_and_loaded_passes_alternate_slowly(scene: Scene) -> None:
    plan = planned(scene, "how heavy is the bottle?", mass="1g")
    done = actions(plan.tree)
    grasps = done.count("CloseGripper")
    assert grasps == done.count("OpenGripper") - 1
    assert len(speeds(plan)) == 4 * grasps
    assert len(set(speeds(plan))) == 1
    assert speeds(plan)[0] < scene.arm.pace.speed
    assert done.count("Force2Mass") == 1


def test_a_plan_without_a_width_has_no_slow_passes(scene: Scene) -> None:
    plain = planned(scene, "how heavy is the bottle?")
    assert speeds(plain) == []
    assert planned(scene, "how heavy is the bottle?", height="1mm").tree == plain.tree


def test_a_narrower_width_takes_more_work(scene: Scene) -> None:
    site = site_of(scene, MASS)
    assert site is not None
    work: list[float] = []
    for std in (2e-3, 1e-3, 5e-4, 2.5e-4):
        effort = Mass().effort(site, std, None)
        assert effort.speed is not None
        work.append(effort.cycles / effort.speed)
    assert work == sorted(work)
    assert work[-1] > 4 * work[0]


def test_the_floor_of_a_mass_is_proportional_to_the_mass(scene: Scene) -> None:
    light, heavy = (site_of(scene, MASS, (mass,)) for mass in (0.2, 0.8))
    assert light is not None
    assert heavy is not None
    assert Mass().floor(heavy) == pytest.approx(4 * Mass().floor(light), rel=0.1)


def test_an_object_measured_several_times_is_put_back_in_between(scene: Scene) -> None:
    """Slid to the other side every other time; the check lets it pass where it is told why."""
    friction = Parameter("bottle.friction")
    assembly = assemble(scene, [MASS, friction], efforts={friction: Effort(times=3)})
    assert assembly.tree is not None
    done = actions(assembly.tree)
    assert done.count("Force2Mass") == 1
    assert done.count("CloseGripper") == done.count("OpenGripper") - 1 == 3
    aside = [
        str(dict(node.args).get("pose"))
        for _, node in assembly.tree.walk()
        if node.type == "MovePose"
    ]
    sides = [pose.split()[1] for pose in aside if pose.endswith("x_offset")]
    assert sides == ["+", "-", "+"]
    plan = Plan(assembly.measured, assembly.tree, "")
    assert check(plan, scene, remeasure=True, repeated=True) == ()
    assert {finding.rule for finding in check(plan, scene, remeasure=True)} == {"redundant"}


def test_objects_alone_are_lifted_and_as_often_as_the_effort_says(scene: Scene) -> None:
    """Of a surface nothing is lifted at all, and of an object as often as its effort says."""
    assert site_of(scene, Parameter("table.height")) is None
    assembly = assemble(scene, [MASS], efforts={MASS: Effort(3, 0.1)})
    assert assembly.tree is not None
    assert actions(assembly.tree).count("CloseGripper") == 3
    assert check(Plan(assembly.measured, assembly.tree, ""), scene) == ()
