"""Motions: preconditions, effects, what the arm does, and balance points bound in a run."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from performing import CELL, CUP, cell
from pydantic import ValidationError
from workbench import BAR, bench, plan, sequence, visit

from palpate.common.pose import Pose, rotations
from palpate.estimation.estimate import Estimate, Verdict
from palpate.execution.runner import run
from palpate.execution.simulated_cell import simulated_cell
from palpate.primitives import motion
from palpate.primitives.base import Blackboard
from palpate.primitives.contact import CONTACT_FORCE, FIRM_FORCE, PROBE_TRAVEL
from palpate.primitives.motion import POSITION_TOLERANCE, MovePose
from palpate.primitives.rules.grasp import most_sideways
from palpate.primitives.rules.support import clear_of_support
from palpate.primitives.state import SymbolicState
from palpate.robots.owner import load_description
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

HOME = load_description().home

LIFT, AT = ("MovePose", "cup_pose + z_offset"), ("MovePose", "cup_pose")
TO_TABLE = ("MovePose", "table_approach")

TABLE = """<mujoco><worldbody><site name="robot_base"/><body name="table" pos="0.62 0.09 {z}">
<geom type="box" size=".15 .2 .02"/></body></worldbody></mujoco>"""


def test_move_pose_names_what_it_cannot_read_or_reach(start, make) -> None:
    assert (
        "unknown pose 'teapot_pose'"
        in make("MovePose", pose="teapot_pose").requires(start)[0].message
    )
    assert "unknown offset 'w'" in make("MovePose", pose="cup_pose + w").requires(start)[0].message
    (far,) = make("MovePose", pose="cup_pose + 200*x_offset").requires(start)
    assert "is out of the arm's reach" in far.message


def test_move_pose_arrives_where_its_expression_says(start, make, after) -> None:
    state = after(start, LIFT)
    assert state.at == "cup_pose + z_offset"
    assert state.pose_world_tcp.distance_to(start.scene.symbols.resolve("cup_pose + z_offset")) == 0
    assert (state.activity, state.holding, state.moved) == ("still", None, {})
    assert make("MovePose", pose="cup_pose").during(state).activity == "moving"


def test_lifting_carries_the_object_and_setting_down_restores_it(start, after, reached) -> None:
    held = after(start, *reached, "CloseGripper")
    assert not held.lifted
    up = after(held, LIFT)
    height = (
        start.scene.symbols.resolve("cup_pose + z_offset").position[2]
        - start.scene.symbols.resolve("cup_pose").position[2]
    )
    assert up.lifted
    assert up.pose_of("cup").position == pytest.approx(
        start.pose_of("cup").position + np.array([0, 0, height])
    )
    assert up.activity == "still"
    down = after(up, AT)
    assert not down.lifted
    assert down.activity == "contact"
    assert down.displaced_objects() == {}


@pytest.mark.parametrize(
    ("slipped", "early"), [(0.004, 0.0), (0.006, 0.006), (0.019, 0.019), (0.021, None)]
)
def test_an_object_that_slipped_meets_its_support_early(
    start, make, after, reached, slipped: float, early: float | None
) -> None:
    """The cup hangs lower in the hand than where it was grasped; the motion down ends as it stands."""
    up = after(start, *reached, "CloseGripper", LIFT)
    assert up.pose_tcp_object is not None
    lower = up.pose_of("cup").translate((0.0, 0.0, -slipped))
    up = replace(up, pose_tcp_object=up.tcp.inverse() @ lower, moved=up.place_object("cup", lower))
    down = make("MovePose", pose="cup_pose")
    found = down.violations(up)
    if early is None:
        assert "mm into 'table'" in found[0].message
        return
    assert found == []
    there = up.after(down)
    above = there.tcp.position - start.scene.symbols.resolve("cup_pose").position
    assert above == pytest.approx([0.0, 0.0, early], abs=1e-6)
    assert not there.lifted
    assert make("OpenGripper").violations(there) == []


def test_sideways_on_the_support_is_a_slide_and_in_the_air_is_not(
    start, make, after, reached
) -> None:
    held = after(start, *reached, "CloseGripper")
    side = make("MovePose", pose="cup_pose + x_offset")
    assert side.slides(held)
    assert side.during(held).activity == "sliding"
    assert side.effects(held).displaced_objects().keys() == {"cup"}
    assert not make("MovePose", pose="cup_pose + z_offset").slides(held)
    up = after(held, LIFT)
    assert not make("MovePose", pose="cup_pose + z_offset + x_offset").slides(up)
    assert not side.slides(start)


def test_clear_of_support_takes_five_millimetres(start) -> None:
    held, at = replace(start, holding="cup"), start.pose_of("cup")
    assert not clear_of_support(held, "cup", at.translate((0, 0, 0.004)))
    assert clear_of_support(held, "cup", at.translate((0, 0, 0.006)))


@pytest.mark.parametrize(
    ("joints", "problem"),
    [
        ("elsewhere", "unknown joint configuration 'elsewhere'"),
        ([0.0, 1.0], "needs 7 angles, not 2"),
        ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "beyond the arm's limits"),
    ],
)
def test_move_joints_refuses(start, make, joints, problem: str) -> None:
    assert problem in make("MoveJoints", joints=joints).requires(start)[0].message


def test_move_joints_leaves_no_contact_and_the_arm_as_it_bent_it(start, make, after) -> None:
    touching = after(start, TO_TABLE, ("MoveUntilContact", "-z"))
    state = after(touching, ("MoveJoints", "home_config"))
    assert (state.at, state.contact, state.activity) == ("home_config", None, "still")
    assert state.is_bent
    assert state.q.tolist() == HOME.tolist()
    bent = make("MoveJoints", joints=[*HOME[:6], 0.0]).effects(touching)
    assert bent.at is None
    assert bent.pose_world_tcp.angle_to(state.pose_world_tcp) == pytest.approx(HOME[6])
    back = after(state, TO_TABLE)
    assert not back.is_bent
    assert back.q is not None
    assert make("MoveJoints", joints=HOME.tolist()).during(touching).contact is None


def test_a_probe_needs_a_place_a_surface_and_empty_fingers(start, make, after, reached) -> None:
    down = make("MoveUntilContact", axis="-z")
    assert "not at a known pose" in down.requires(start)[0].message
    beside = replace(
        start,
        at="nowhere",
        pose_world_tcp=start.scene.symbols.resolve("cup_pose").translate((2, 0, 0)),
    )
    assert "no surface or object is below 'nowhere'" in down.requires(beside)[0].message
    aside = make("MoveUntilContact", axis="+x").requires(beside)[0].message
    assert "no body within 0.30 m" in aside
    assert (
        "'cup' is in the gripper"
        in down.requires(after(start, *reached, "CloseGripper", LIFT))[0].message
    )
    touching = after(start, TO_TABLE, ("MoveUntilContact", "-z"))
    assert touching.context().support == "table"
    assert "already in contact with 'table'" in down.requires(touching)[0].message


def test_a_probe_ends_where_it_is_believed_to_touch(start, after) -> None:
    state = after(start, TO_TABLE, ("MoveUntilContact", "-z"))
    tip = state.pose_world_tcp.position[2] - start.scene.arm.tip
    assert tip == pytest.approx(0.0, abs=2e-3)
    assert state.at == "table_approach"


def test_a_sideways_probe_measures_no_height(start, make) -> None:
    low = replace(
        start, at="beside", gripper="closed", pose_world_tcp=Pose.top_down((0.65, 0.1, 0.08), 0.0)
    )
    assert not make("MoveUntilContact", axis="-x").requires(low)
    state = make("MoveUntilContact", axis="-x").effects(low)
    assert (state.contact, state.activity) == (None, "contact")


def test_the_arm_goes_home_and_to_the_pose_and_settles(perform, scene) -> None:
    done = perform(LIFT, ("MoveJoints", "home_config"), LIFT)
    assert done.execution.status == "complete"
    goal = scene.symbols.resolve("cup_pose + z_offset")
    assert done.robot.world.true_tcp().distance_to(goal) < 5e-4 < POSITION_TOLERANCE
    samples = done.execution.trace.samples
    home = done.execution.trace.leaf_runs("MoveJoints")[0].end
    assert samples.between(home - 0.01, home).q[-1] == pytest.approx(np.array(HOME), abs=2e-3)
    rest = samples.between(samples.t[-1] - 0.2, samples.t[-1])
    assert np.abs(rest.twist).max() < 3e-3


def test_speed_of_a_motion_may_be_low_but_not_so_that_joints_stick(perform, reached, make) -> None:
    done = perform(*reached, ("MovePose", {"pose": "cup_pose + z_offset", "speed": 0.03}))
    assert done.execution.status == "complete"
    slow = done.execution.trace.leaf_runs("MovePose")[-1]
    assert slow.label == "MovePose(cup_pose + z_offset, 0.03)"
    samples = done.execution.trace.samples.between(slow.start, slow.end)
    assert samples.twist[:, 2].max() == pytest.approx(0.03, rel=0.1)
    with pytest.raises(ValidationError, match="speed"):
        make("MovePose", pose="cup_pose", speed=0.001)


def test_a_slide_presses_hardest_halfway(perform, reached) -> None:
    """Distinguishes friction from a constant pull, and from one that grows with position."""
    side = ("MovePose", "cup_pose + 3*y_offset")
    done = perform(*reached, "CloseGripper", LIFT, AT, side)
    assert done.execution.status == "complete"
    slide = done.execution.trace.leaf_runs("MovePose")[-1]
    samples = done.execution.trace.samples.between(slide.start, slide.end)
    way = samples.target_world_tcp[:, 1] - samples.target_world_tcp[0, 1]
    part, pressing = way / way[-1], -samples.wrench[:, 2]
    first, halfway, last = (pressing[np.abs(part - at) < 0.05].mean() for at in (0.1, 0.5, 0.9))
    assert halfway > max(first, last) + 4.0


@pytest.mark.parametrize(("thick", "stopped"), [(0.010, False), (0.022, True)])
def test_a_contact_far_above_the_support_is_no_support(perform, scene, reached, thick, stopped):
    """A slab that no scene shows, where the cup is to stand: a believed pose is 20 mm off at most."""
    there = "cup_pose + 6*y_offset"
    x, y, _ = (scene.symbols.resolve(there)).position
    slab = f'<body pos="{x} {y} {thick / 2}"><geom type="box" size=".03 .02 {thick / 2}"/></body>'
    text = CELL.format(cup="0.5 0.1 0.05", table=-0.03, mass='mass="0.3"')
    world = parse_scene(text.replace("</worldbody>", slab + "</worldbody>"))
    over = ("MovePose", f"{there} + z_offset")
    done = perform(*reached, "CloseGripper", LIFT, over, ("MovePose", there), world=world)
    said = done.message("MovePose")
    assert ("touched a support 22 mm before" in said) == stopped
    assert ("set down" in said, done.execution.final_state.holding) == (not stopped, "cup")


def test_across_its_pads_a_hand_presses_no_harder_than_they_hold(reached, start, after) -> None:
    """An object dragged at its foot turns about the line between the pads."""
    held = after(start, *reached, "CloseGripper")
    along, across = held.pose_world_tcp.rotation[:, 1], held.pose_world_tcp.rotation[:, 0]
    assert most_sideways(held, along) > 1e3
    most = most_sideways(held, across)
    assert 0.0 < most < 60.0
    assert most_sideways(held, 0.05 * (along + across)) == pytest.approx(np.sqrt(2.0) * most)
    assert most_sideways(start, across) == np.inf, "nothing is held"


def test_a_slide_is_slow_while_it_presses_and_then_twice_as_fast(perform, reached) -> None:
    done = perform(*reached, "CloseGripper", LIFT, AT, ("MovePose", "cup_pose + 3*y_offset"))
    slide = done.execution.trace.leaf_runs("MovePose")[-1]
    samples = done.execution.trace.samples.between(slide.start, slide.end)
    way = samples.target_world_tcp[:, 1] - samples.target_world_tcp[0, 1]
    speed = np.abs(np.gradient(way, samples.t))
    first, last = (np.median(speed[np.abs(way / way[-1] - at) < 0.1]) for at in (0.25, 0.75))
    assert first == pytest.approx(0.02, rel=0.05)
    assert first < last <= 0.041


def test_a_probe_stops_at_its_threshold_on_the_surface(perform) -> None:
    done = perform("OpenGripper", TO_TABLE, ("MoveUntilContact", "-z"))
    assert done.execution.status == "complete"
    pressed = -done.execution.trace.samples.wrench[:, 2]
    assert CONTACT_FORCE < pressed.max() < done.robot.limits.force_max
    assert 2.0 < pressed[-40:].min() <= pressed[-40:].max() < CONTACT_FORCE, "it stays in contact"
    tip = done.robot.world.true_tcp().position[2] - done.robot.hand.tip_offset
    assert tip == pytest.approx(0.0, abs=2e-4)
    assert done.execution.final_state.contact == "table"
    found = done.execution.final_state.pose_world_tcp
    assert found.distance_to(done.robot.world.true_tcp()) < 1e-3, "where it was felt"


def test_a_probe_presses_firmly_where_one_finger_alone_stands_and_lightly_again(
    perform, scene
) -> None:
    """The hand leans over as far as it must for the other finger, or as far as that takes it."""
    approach = scene.symbols.resolve("table_approach")
    x, y, _ = approach.position + 0.045 * approach.rotation[:, 1]
    text = CELL.format(cup=" ".join(map(str, CUP)), table=-0.03, mass='mass="0.3"')
    board = (
        f'<body name="board" pos="{x} {y} 0.003"><geom type="box" size=".015 .015 .003"/></body>'
    )
    world = parse_scene(text.replace("</worldbody>", f"{board}</worldbody>"))
    done = perform("OpenGripper", TO_TABLE, ("MoveUntilContact", "-z"), world=world)
    assert done.execution.status == "complete"
    samples = done.execution.trace.samples
    pressed = -samples.wrench[:, 2]
    assert FIRM_FORCE - 2.0 < pressed.max() < FIRM_FORCE + 5.0
    assert 2.0 < pressed[-40:].min() <= pressed[-40:].max() < done.robot.limits.free_force
    leans = rotations(samples.pose_world_tcp[:, 3:])[:, 2, 1]
    assert abs(leans).max() > 3.3e-3 > 2 * abs(leans[-40:]).max()


def test_a_probe_that_meets_nothing_fails_at_its_travel_limit(perform) -> None:
    # The table that the scene has is half a metre lower in the world.
    from_above = perform(TO_TABLE, ("MoveUntilContact", "-z"), world=cell(table=-0.53))
    assert from_above.execution.status == "stopped"
    assert f"no contact within {PROBE_TRAVEL:.2f} m along -z" in from_above.execution.stopped_by


HEAVIER = 0.03
"""m along the bar, of the hidden centre of mass."""
TRUE = BAR.replace('"? ? ?" mass="?"', f'"{HEAVIER} 0 0" mass="0.3"').replace(
    '"? ? ?"', '"1e-4 1e-3 1e-3"'
)


@pytest.fixture(scope="module")
def bar() -> Scene:
    return bench(BAR)


def estimated(along: float, std: float, verdict: Verdict = "identified") -> Any:
    """Estimator with a fixed result for any trace."""

    def all_of_them(parameters: Any, trace: Any, bodies: Any) -> tuple[Estimate]:
        (parameter,) = parameters
        value = np.array([along, 0.0, 0.0])
        return (Estimate.normal(parameter, "m", value, np.full(3, std), "told", verdict=verdict),)

    return all_of_them


def bound(scene: Scene, monkeypatch: pytest.MonkeyPatch, estimates: Any) -> Blackboard:
    """A blackboard on which a motion to the balance point has found out where that is."""
    monkeypatch.setattr(motion, "estimate_all", estimates)
    recorder = SimpleNamespace(snapshot=lambda: None)
    blackboard = Blackboard(cast(Any, None), SymbolicState(scene), cast(Any, recorder))
    MovePose(pose="bar_balance + z_offset").bind(blackboard)
    return blackboard


def along(blackboard: Blackboard) -> float:
    """m from the bar's middle to where the motion goes, along the bar."""
    target = MovePose(pose="bar_balance").target(blackboard.state).position
    body = blackboard.scene.body("bar")
    return float(body.pose_world.local(target)[0])


def test_balance_point_without_a_measurement_is_the_middle_and_says_so(bar, monkeypatch):
    found = bound(bar, monkeypatch, estimated(0.0, 0.0, "prior-dominated"))
    assert along(found) == pytest.approx(0.0, abs=1e-3)
    assert "as believed: prior-dominated so far" in found.bound["bar_balance"]


def test_balance_point_is_bound_to_the_estimate_and_stays_bound(bar, monkeypatch):
    found = bound(bar, monkeypatch, estimated(0.03, 0.002))
    assert along(found) == pytest.approx(0.03)
    assert "as measured to ± 2.0 mm" in found.bound["bar_balance"]
    monkeypatch.setattr(motion, "estimate_all", estimated(-0.03, 0.001))
    MovePose(pose="bar_balance").bind(found)
    assert along(found) == pytest.approx(0.03)


def test_uncertain_estimate_leaves_the_balance_point_as_believed(bar, monkeypatch):
    found = bound(bar, monkeypatch, estimated(0.03, 0.05))
    assert along(found) == pytest.approx(0.0, abs=1e-3)
    assert "as believed: measured +30 ± 50 mm from there" in found.bound["bar_balance"]


def test_balance_point_stays_in_its_region_and_one_outside_is_refused(bar, monkeypatch):
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


def test_a_stretched_arm_is_not_stopped_by_what_its_joints_rub():
    text = TABLE.format(z="?")
    scene, world = parse_scene(text), parse_scene(TABLE.format(z=0.38))
    tree = sequence("MoveJoints home_config", "MovePose table_approach", "MoveJoints home_config")
    robot = simulated_cell(scene, world, noise="measured", seed=2008).robot()
    done = run(plan(tree), scene, robot)
    assert done.stopped_by is None
    felt = np.linalg.norm(done.trace.samples.wrench[:, :3], axis=1)
    assert felt.max() > robot.limits.free_force, "it looks like a contact"
