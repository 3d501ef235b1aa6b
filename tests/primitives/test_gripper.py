"""Opening and closing: typestate, and what real fingers meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from performing import sequence

from bench.faults.faulty import FaultyRobot
from bench.harm.judge import harm
from palpate.execution.runner import run
from palpate.execution.witness import Witness
from palpate.planning.plan import Plan
from palpate.primitives.state import SymbolicState
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

CAN = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 {table}"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="can" pos="{x} 0.1 {z}"><freejoint/>
    <geom type="cylinder" size=".031 .06" mass="0.3" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>"""


def can(x: float = 0.5, lower: float = 0.0) -> Scene:
    """A can on a table, `lower` m lower than at z = 0."""
    return parse_scene(CAN.format(x=x, z=0.06 - lower, table=-0.03 - lower))


LIFT, AT = ("MovePose", "cup_pose + z_offset"), ("MovePose", "cup_pose")


def test_fingers_close_only_when_open_and_on_something(start, make, after, reached) -> None:
    close = make("CloseGripper")
    assert "must be open before it closes" in close.requires(start)[0].message
    assert "not at a grasp pose" in close.requires(after(start, "OpenGripper"))[0].message
    assert (
        "no object is between the fingers at 'cup_pose + z_offset'"
        in close.requires(after(start, *reached[:2]))[0].message
    )
    assert close.requires(after(start, *reached)) == []


def test_too_wide_an_object_is_refused_with_the_reason(start, make, after) -> None:
    (reason,) = make("CloseGripper").requires(
        after(start, "OpenGripper", ("MovePose", "crate_pose"))
    )
    assert reason.message.startswith("'crate' cannot be grasped: ")


def test_closing_makes_the_object_part_of_the_hand(start, after, reached) -> None:
    state = after(start, *reached, "CloseGripper")
    assert (state.gripper, state.holding, state.grasp, state.lifted) == (
        "closed",
        "cup",
        "cup_pose",
        False,
    )
    grasp = state.pose_world_tcp @ state.pose_tcp_object
    assert grasp.distance_to(state.pose_of("cup")) == pytest.approx(0.0, abs=1e-12)
    assert grasp.angle_to(state.pose_of("cup")) == pytest.approx(0.0, abs=1e-7)


def test_closing_on_nothing_has_no_effect_but_closed_fingers(start, make) -> None:
    state = make("CloseGripper").effects(start)
    assert (state.gripper, state.holding) == ("closed", None)


def test_opening_does_not_drop(start, make, after, reached) -> None:
    up = after(start, *reached, "CloseGripper", LIFT)
    assert (
        "'cup' is lifted and would fall; MovePose it onto its support first, e.g. to 'cup_pose'"
        in make("OpenGripper").requires(up)[0].message
    )
    let_go = after(up, AT, "OpenGripper")
    assert (let_go.gripper, let_go.holding, let_go.grasp, let_go.pose_tcp_object) == (
        "open",
        None,
        None,
        None,
    )
    assert let_go.activity == "still"


def test_opening_on_a_surface_keeps_the_contact(start, after) -> None:
    touching = after(start, ("MovePose", "table_approach"), ("MoveUntilContact", "-z"))
    assert after(touching, "OpenGripper").context().support == "table"


def test_the_hand_grasps_the_cup_at_its_width_and_opens_again(perform, scene) -> None:
    done = perform("OpenGripper", LIFT, AT, "CloseGripper", LIFT, AT, "OpenGripper")
    assert done.execution.status == "complete"
    assert done.message("CloseGripper") in (
        "grasped at 39.9 mm",
        "grasped at 40.0 mm",
        "grasped at 40.1 mm",
    )
    assert done.message("OpenGripper") == "open to 80 mm"
    assert (
        done.robot.world.true_poses(["cup"])["cup"].distance_to(scene.body("cup").pose_world) < 1e-3
    )


def test_closing_on_nothing_fails_and_says_so(perform, scene) -> None:
    text = scene.text.replace('name="cup" pos="0.5 0.1', 'name="cup" pos="0.3 0.4')
    done = perform("OpenGripper", LIFT, AT, "CloseGripper", world=parse_scene(text))
    assert (
        done.execution.stopped_by
        == "CloseGripper(): the fingers met no resistance: no object is between them"
    )
    state: SymbolicState = done.execution.final_state
    assert state.holding is None


def test_an_empty_grasp_of_a_seen_object_names_its_place(perform, scene) -> None:
    text = scene.text.replace('name="cup" pos="0.5 0.1', 'name="cup" pos="0.3 0.4')
    seen = {name: replace(body, seen=True) for name, body in scene.bodies.items()}
    pictured = replace(scene, bodies=seen)
    steps = ("OpenGripper", LIFT, AT, "CloseGripper")
    done = perform(*steps, scene=pictured, world=parse_scene(text))
    assert str(done.execution.stopped_by).endswith(
        "no object is between them; in the picture 'cup' is 60 x 40 x 100 mm, at "
        "(0.500, 0.100) m: take a new picture, or state its pose in poses.yaml"
    )


def test_object_of_another_width_than_believed_is_released_before_it_is_lifted(
    perform, scene
) -> None:
    slimmer = parse_scene(
        scene.text.replace('size=".03 .02 .05"', 'size=".03 .016 .05" mass="0.3"')
    )
    done = perform("OpenGripper", LIFT, AT, "CloseGripper", LIFT, world=slimmer)
    assert done.execution.stopped_by == (
        "CloseGripper(): the fingers closed to 32.0 mm instead of the expected 40.0 mm, "
        "-20 %: the object is not at its believed pose; look again"
    )
    assert done.robot.state.width == pytest.approx(0.08, abs=1e-4)
    assert (
        done.robot.world.true_poses(["cup"])["cup"].distance_to(scene.body("cup").pose_world) < 1e-3
    )


def test_a_can_between_the_edges_of_the_pads_is_let_go_where_it_stands(perform) -> None:
    """Grasped there it is squeezed out of the fingers as soon as it is lifted."""
    believed, true = can(), can(0.52)
    above, at = ("MovePose", "can_pose + z_offset"), ("MovePose", "can_pose")
    steps = ("OpenGripper", above, at, "CloseGripper", above)
    done = perform(*steps, scene=believed, world=true)
    assert "instead of the expected 62.0 mm" in str(done.execution.stopped_by)
    stands = done.robot.world.true_poses(["can"])["can"]
    assert stands.rotation[2, 2] > 0.999
    assert stands.distance_to(true.body("can").pose_world) < 5e-3


@pytest.mark.parametrize(
    ("lower", "said"),
    [
        (0.0404, "MovePose(can_pose + x_offset): slip: the fingers closed from 61."),
        (0.0407, "CloseGripper(): the object yielded from 61.2 to 5"),
    ],
)
def test_a_can_taken_by_its_rim_is_let_go_where_it_stands(lower, said) -> None:
    """Fingers that closed on as it slips out of them would tip it over."""
    believed, true = can(), can(lower=lower)
    robot = MujocoRobot(true.spec(), true.pose_world_base, true.arm)
    witness = Witness.of(robot.world)
    above, at = ("MovePose", "can_pose + z_offset"), ("MovePose", "can_pose")
    steps = ("OpenGripper", above, at, "CloseGripper", ("MovePose", "can_pose + x_offset"))
    done = run(Plan((), sequence(*steps), "drag it"), believed, robot)
    robot.advance(0.5)
    assert str(done.stopped_by).startswith(said)
    assert done.final_state.holding is None
    assert robot.state.width == pytest.approx(0.08, abs=1e-4)
    assert robot.world.true_poses(["can"])["can"].rotation[2, 2] > 0.9999
    assert not harm(witness, ["can"]).fates


@pytest.mark.parametrize("beside", [0.010, 0.012])
def test_a_can_off_the_middle_of_the_pads_is_carried_as_grasped(perform, beside) -> None:
    """The pads' edges have it, and friction holds it: it meets them at 10 degrees at most."""
    believed, true = can(), can(0.5 + beside)
    above, at = ("MovePose", "can_pose + z_offset"), ("MovePose", "can_pose")
    steps = ("OpenGripper", above, at, "CloseGripper", above, at, "OpenGripper", above)
    done = perform(*steps, scene=believed, world=true)
    assert done.execution.status == "complete"
    stands = done.robot.world.true_poses(["can"])["can"]
    assert stands.rotation[2, 2] > 0.9999
    assert stands.distance_to(true.body("can").pose_world) < 1e-3


def test_folded_fingers_touch_the_top_of_what_is_narrower_than_they_open(perform, scene) -> None:
    above = ("MovePose", "cup_top")
    done = perform("OpenGripper", above, "FoldFingers", ("MoveUntilContact", "-z"))
    assert done.execution.status == "complete"
    assert done.execution.final_state.contact == "cup"
    tip = done.robot.world.true_tcp().position[2] - done.robot.hand.tip_offset
    assert tip == pytest.approx(0.1, abs=5e-4)


def test_fingers_fold_on_nothing_alone(start, make, after) -> None:
    fold = make("FoldFingers")
    at = after(start, "OpenGripper", ("MovePose", "cup_pose + z_offset"), ("MovePose", "cup_pose"))
    assert "an object is between the fingers" in fold.requires(at)[0].message
    folded = after(start, "OpenGripper", ("MovePose", "cup_top"), "FoldFingers")
    assert (folded.gripper, folded.holding) == ("closed", None)
    assert "must be open" in fold.requires(folded)[0].message


def test_folded_fingers_do_not_open_on_what_they_press(start, make, after) -> None:
    """They would push it aside, or over."""
    opening, touch = make("OpenGripper"), ("MoveUntilContact", "-z")
    pressing = after(start, "OpenGripper", ("MovePose", "cup_top"), "FoldFingers", touch)
    (found,) = opening.requires(pressing)
    assert found.rule == "gripper-state"
    assert "press on 'cup'" in found.message
    assert "MovePose to 'cup_top + z_offset' first" in found.message
    assert not opening.requires(after(pressing, ("MovePose", "cup_top")))


@pytest.mark.parametrize(
    ("stiffness", "size", "reason"),
    [
        (2000, 0.03, None),
        (40, 0.03, "the object"),
        (2000, 0.026, "instead of the expected 60.0 mm"),
    ],
    ids=["sponge", "cotton", "narrow sponge"],
)
def test_a_soft_object_is_recognised_by_its_width_without_a_force(stiffness, size, reason) -> None:
    """Two forces tell the width without any; the full force compresses it as a spring."""
    soft = f'solref="-{stiffness} -20" priority="2" friction="1"'
    text = CAN.replace('type="cylinder" size=".031 .06"', 'type="box" size=".04 {half} .03"')
    text = text.replace('friction="0.6 0.005 0.0001"/></body>\n</world', "{soft}/></body>\n</world")
    believed, world = (
        parse_scene(text.format(x=0.5, z=0.03, table=-0.03, half=half, soft=soft))
        for half in (0.03, size)
    )
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, "lab", seed=1)
    steps = ("OpenGripper", ("MovePose", "can_pose + z_offset"), ("MovePose", "can_pose"))
    done = run(Plan((), sequence(*steps, "CloseGripper"), ""), believed, robot)
    assert (done.stopped_by is None) == (reason is None), done.stopped_by
    assert reason is None or reason in str(done.stopped_by)


def test_an_object_that_never_left_its_support_is_released_for_any_joint_torques(scene) -> None:
    """Closing fingers push on the arm, and its joints' friction then looks like a weight of 2.5 N."""
    robot = MujocoRobot(scene.spec({}), scene.pose_world_base, scene.arm)
    faulty = FaultyRobot(robot, 0.0)
    feels = np.array([0.0, 0.0, 2.5, 0.0, 0.0, 0.0])
    faulty.lie = lambda state, _: replace(state, contact=state.contact + state.gripping * feels)
    steps = ("OpenGripper", LIFT, AT, "CloseGripper", "OpenGripper")
    done = run(Plan((), sequence(*steps), "a test"), scene, faulty)
    assert (done.status, done.stopped_by) == ("complete", None)
