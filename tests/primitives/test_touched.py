"""Touch completes sight in a run: what is met is believed where it was met, and later motions go there."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.execution.runner import Execution, run
from palpate.planning.plan import Node, Plan
from palpate.primitives.state import SymbolicState
from palpate.robots.simulated.robot import MujocoRobot
from palpate.scene.load import correct_body, parse_scene
from palpate.scene.poses import Poses
from palpate.scene.scene import Scene

CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 {table}"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="cup" pos="{cup}"><freejoint/>
    <geom type="box" size=".03 .02 .05" mass="1.2" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>"""
SEEN = (0.5, 0.1, 0.05)
STDS = (0.004, 0.004, 0.001, 0.008, 0.008, 0.03)
LIFT, AT = ("MovePose", "cup_pose + z_offset"), ("MovePose", "cup_pose")
BESIDE = (
    "OpenGripper",
    ("MovePose", "over"),
    "FoldFingers",
    ("MovePose", "beside"),
    ("MoveUntilContact", "+x"),
    ("MovePose", "beside"),
    ("MovePose", "over"),
    "OpenGripper",
)
ABOVE = (
    "OpenGripper",
    ("MovePose", "cup_top"),
    "FoldFingers",
    ("MoveUntilContact", "-z"),
    ("MovePose", "cup_top"),
    "OpenGripper",
)
GRASP = (LIFT, AT, "CloseGripper", LIFT, AT, "OpenGripper", LIFT)


@cache
def told(sure: bool = True) -> Scene:
    """The scene by sight: with a covariance, or without."""
    entry = {"pos": SEEN, "source": "seen", "covariance": np.diag(np.square(STDS)).tolist()}
    places = {"beside": {"pos": (0.43, 0.1, 0.085)}, "over": {"pos": (0.43, 0.1, 0.2)}}
    content = {"places": places} | ({"objects": {"cup": entry}} if sure else {})
    text = CELL.format(table=-0.03, cup="0.5 0.1 0.05")
    return parse_scene(text, poses=Poses.model_validate(content))


def ended(
    cup: tuple[float, float, float], *steps: object, table: float = -0.03
) -> tuple[Execution, MujocoRobot]:
    """Execution of steps in a world with the cup there, and its robot."""
    world = parse_scene(CELL.format(table=table, cup=" ".join(map(str, cup))))
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm)
    return run(Plan((), _sequence(*steps), "a test"), told(), robot), robot


def done(
    cup: tuple[float, float, float], *steps: object, table: float = -0.03
) -> tuple[SymbolicState, MujocoRobot]:
    """State and robot after steps in a world with the cup there."""
    execution, robot = ended(cup, *steps, table=table)
    assert execution.stopped_by is None
    return execution.final_state, robot


def _sequence(*steps: object) -> Node:
    nodes: list[Node] = []
    for step in steps:
        kind, *value = (step,) if isinstance(step, str) else step
        field = "axis" if kind == "MoveUntilContact" else "pose"
        nodes.append(Node(kind, ((field, value[0]),) if value else ()))
    return Node("Sequence", children=tuple(nodes))


def test_a_probe_from_the_side_moves_the_grasp_to_the_object() -> None:
    """15 mm beside where it was seen to 4 mm: contradicted, and grasped within 2 mm of its middle."""
    state, robot = done((0.515, 0.1, 0.05), *BESIDE, *GRASP)
    (probe, fingers), belief = state.beliefs["cup"].touches, state.seen["cup"]
    assert (probe.means, fingers.means) == ("probe", "fingers")
    assert 3.0 < probe.z < 5.0
    assert belief.contradiction
    assert list(state.elsewhere()) == ["cup"]
    assert state.resolve("cup_pose").position[0] == pytest.approx(0.515, abs=0.002)
    off = belief.pose.position - robot.world.true_poses(["cup"])["cup"].position
    assert np.abs(off[:2]).max() < 0.002
    assert belief.std(np.array([1.0, 0.0, 0.0])) < 0.0012
    assert belief.std(np.array([0.0, 1.0, 0.0])) < 0.0012


def test_a_probe_from_above_measures_the_height_of_the_top() -> None:
    """All 2 mm lower than seen."""
    state, _ = done((0.5, 0.1, 0.048), *ABOVE, table=-0.032)
    belief = state.seen["cup"]
    assert belief.touches[0].apart == pytest.approx(0.002, abs=5e-4)
    assert belief.std(np.array([0.0, 0.0, 1.0])) < 0.8e-3
    assert SEEN[2] - belief.pose.position[2] == pytest.approx(0.001, abs=4e-4)
    assert not belief.contradiction


def test_fingers_that_close_on_nothing_say_where_the_object_was_seen() -> None:
    execution, _ = ended((0.5, -0.2, 0.05), "OpenGripper", *GRASP)
    assert (execution.stopped_by or "").endswith(
        "no object is between them; 'cup' was seen at (0.500, 0.100) m, to 12.0 mm (3 std)"
    )


def test_nothing_is_believed_of_what_nothing_says_how_sure_it_is() -> None:
    state = SymbolicState(told(sure=False))
    assert state.touched("cup", "probe", np.eye(3)[0], np.zeros(3), 0.01) is state
    assert state.seen == {}


def test_named_poses_move_with_an_object_but_its_put_down_place_stays() -> None:
    scene = told()
    moved = correct_body(scene, "cup", Pose.of((0.01, 0.0, 0.002)))
    for name in ("cup_pose", "cup_top", "cup_balance"):
        shift = moved.symbols.pose(name).position - scene.symbols.pose(name).position
        assert shift == pytest.approx([0.01, 0.0, 0.002], abs=1e-9)
    shift = (
        moved.symbols.pose("cup_temporary").position - scene.symbols.pose("cup_temporary").position
    )
    assert shift == pytest.approx([0.0, 0.0, 0.002], abs=1e-9)
    assert moved.symbols.pose("table_approach") is scene.symbols.pose("table_approach")
    assert moved.body("cup").pose_world.position == pytest.approx([0.51, 0.1, 0.052])


@pytest.mark.parametrize("seed", [0, 3])
def test_a_light_probe_ends_at_the_object_and_not_by_the_arm_s_own_force(seed: int) -> None:
    """At `measured` the force of joint friction exceeds 2 N as the probe sets out and on its way."""
    scene, world = told(), parse_scene(CELL.format(table=-0.03, cup="0.5 0.1 0.05"))
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, noise="measured", seed=seed)
    finished = run(Plan((), _sequence(*BESIDE), "a test"), scene, robot)
    assert finished.stopped_by is None
    (probe,) = finished.trace.leaf_runs("MoveUntilContact")
    assert probe.message in (
        "contact after 31 mm",
        "contact after 32 mm",
        "contact after 33 mm",
        "contact after 34 mm",
    )
    (cup,) = robot.world.true_poses(["cup"]).values()
    assert cup.position == pytest.approx((0.5, 0.1, 0.05), abs=1e-3)


def test_a_probe_that_would_push_an_object_with_the_least_force_that_shows_stops_before_it() -> (
    None
):
    cell = CELL.replace('mass="1.2"', 'mass="0.45"').format(table=-0.03, cup="0.5 0.1 0.05")
    places = {"beside": {"pos": (0.43, 0.1, 0.085)}, "over": {"pos": (0.43, 0.1, 0.2)}}
    scene = parse_scene(cell, poses=Poses.model_validate({"places": places}))
    robot = MujocoRobot(scene.spec(), scene.pose_world_base, scene.arm, noise="measured", seed=0)
    finished = run(Plan((), _sequence(*BESIDE), "a test"), scene, robot)
    assert "'cup' resists with 2.6 N: the probe would push it away" in str(finished.stopped_by)
    assert robot.state.pose_world_tcp.position[0] < 0.46
