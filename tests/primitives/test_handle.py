"""Moving a drawer by its handle: what is admissible, and a run on the simulated arm."""

from __future__ import annotations

import pytest

import palpate as pp
from palpate.primitives.along import way_of
from palpate.primitives.gripper import OpenGripper
from palpate.primitives.handle import FindLimits, MoveHandle
from palpate.primitives.motion import MoveJoints, MovePose
from palpate.primitives.state import SymbolicState
from palpate.scene.load import load_scene, parse_scene
from palpate.studies.scenarios.catalogue import scenario

DRAWER = scenario("drawer").settings().scene
MUG = """<body name="mug" pos="{x} 0.1 {z}"><freejoint/>
  <geom type="cylinder" size=".03 .04" mass=".2"/></body></worldbody>"""


def at(scene, pose="drawer_pose"):
    state = SymbolicState(scene)
    for primitive in (MoveJoints(joints="home_config"), OpenGripper(), MovePose(pose=pose)):
        state = primitive.effects(state)
    return state


def rules(primitive, state):
    return [violation.rule for violation in primitive.violations(state)]


@pytest.fixture(scope="module")
def drawer():
    return load_scene(DRAWER)


def test_the_handle_is_moved_where_it_is_grasped_and_above_it(drawer):
    for pose in ("drawer_pose", "drawer_pose + z_offset"):
        assert rules(MoveHandle(), at(drawer, pose)) == []
    assert rules(FindLimits(), at(drawer)) == []
    assert rules(FindLimits(), at(drawer, "drawer_pose + z_offset")) == ["gripper-state"]
    assert rules(MoveHandle(), at(drawer, "cabinet_approach")) == ["gripper-state"]


def test_recordings_with_a_handle_are_of_the_fixture_or_the_empty_hand(drawer):
    held = MoveHandle().during(at(drawer)).context()
    assert (held.activity, held.holding) == ("working", "drawer")
    empty = MoveHandle().during(at(drawer, "drawer_pose + z_offset")).context()
    assert (empty.holding, empty.place_of) == (None, "drawer")


@pytest.mark.parametrize(
    ("x", "z", "where"), [(0.75, 0.115, "in it"), (0.565, 0.09, "in its path")]
)
def test_nothing_may_stand_in_it_or_in_its_way(drawer, x, z, where):
    text = drawer.text.replace("</worldbody>", MUG.format(x=x, z=z))
    (found,) = MoveHandle().violations(at(parse_scene(text)))
    assert found.rule == "blocked"
    assert where in found.message


def test_a_drawer_with_no_room_is_refused(drawer):
    text = drawer.text.replace('range="0 0.22"', 'range="0 0.02"')
    assert rules(MoveHandle(), at(parse_scene(text))) == ["unreachable"]


def test_a_handle_that_is_too_wide_is_refused(drawer):
    wide = drawer.text.replace('size="0.014 0.014 0.02"', 'size="0.05 0.06 0.02"')
    scene = parse_scene(wide)
    assert "drawer" in scene.symbols.ungraspable
    plan = pp.load(wide).plan(measure=["drawer.damping"])
    assert plan.tree is None
    assert "cannot be grasped" in plan.explanation


@pytest.mark.long
def test_a_drawer_is_measured_and_left_where_it_was():
    run = pp.run(DRAWER, "damping and friction of the drawer", noise="none", seed=1)
    assert run.status == "complete"
    for id in ("damping", "frictionloss"):
        found = run[f"drawer.{id}"]
        (true,) = run.truth[found.parameter]
        assert abs(found.value - true) < max(4.0 * found.std, 0.03 * true)
    # The force and the arm's own motion are of the same moments, or their difference is taken for inertia.
    assert run["drawer.damping"].parts["inertia"].value == pytest.approx(1.83, rel=0.3)
    joint = run.twin.mjmodel.joint("drawer_slide")
    assert joint.damping[0] == pytest.approx(run["drawer.damping"].value, rel=0.05)


def test_a_way_ends_short_of_a_limit_that_was_met(drawer):
    way = way_of(at(drawer), "drawer")
    met = way.start.translate((-0.05, 0.0, 0.0)).position
    assert way.shorten_to(met).length == pytest.approx(0.04)


@pytest.mark.long
def test_an_unstated_limit_is_approached_slowly_and_reported(tmp_path):
    """At 20 mm no pass is left: the handle is let go of where it was found."""
    given = scenario("drawer").settings()
    known = given.scene.read_text().replace('range="0 0.22"', 'range="0 ?"')
    assert way_of(at(parse_scene(known)), "drawer").is_unsure
    world = tmp_path / "world.xml"
    world.write_text(given.world.read_text().replace('range="0 0.22"', 'range="0 0.02"'))
    plan = pp.load(known).plan(measure=["drawer.damping"])
    run = plan.run(world=world, noise="none", fast=True)
    assert run.status == "aborted"
    assert "has a limit after 2" in run.execution.stopped_by
    assert run.execution.held.became == "put down"
