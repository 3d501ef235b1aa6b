"""The controlled stop on the embedded robot, in a world of its own for every case."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from faulty import Faulty
from py_trees.common import Status
from standin import IN_HAND, TICK, StandIn, tick

from palpate.common.pose import Pose
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import run
from palpate.execution.stop import (
    RETREAT_SPEED,
    STAYS,
    HeldObject,
    PutDown,
    let_slip,
    lost,
    state_after_release,
    unproven,
)
from palpate.planning.plan import Node, Plan
from palpate.primitives.base import Blackboard, LeafFailure, Recorder
from palpate.primitives.load import FingerLoad
from palpate.primitives.rules.profile import GUARDED_SPEED
from palpate.primitives.state import SymbolicState
from palpate.robots.sheet import Reflex
from palpate.robots.simulated.robot import MujocoRobot
from palpate.robots.trajectory import rotate_quaternion
from palpate.scene.load import parse_scene

CELL = """<mujoco><worldbody>
<body name="table" pos="0.5 0 0.05"><geom type="box" size="0.3 0.4 0.05"/></body>
<body name="cup" pos="0.5 0.1 0.15"><freejoint/><geom type="box" size="0.02 0.03 0.05" {cup}/></body>{more}
</worldbody></mujoco>"""

SCENE = parse_scene(CELL.format(cup='friction="0.6 0.005 0.0001"', more=""))


STACK = """<body name="plate" pos="0.5 -0.2 0.11"><freejoint/><geom type="box" size="0.1 0.06 0.01"/></body>
<body name="can" pos="0.52 -0.2 0.16"><freejoint/><geom type="cylinder" size="0.03 0.04"/></body>"""


def leaf(kind, **args):
    return Node(kind, tuple(args.items()))


WEIGH = Plan(
    (),
    Node(
        "Sequence",
        (),
        (
            leaf("OpenGripper"),
            leaf("MovePose", pose="cup_pose + z_offset"),
            leaf("MovePose", pose="cup_pose"),
            leaf("CloseGripper"),
            leaf("MovePose", pose="cup_pose + z_offset"),
            leaf("MeasureForces"),
            leaf("MovePose", pose="cup_pose"),
            leaf("OpenGripper"),
            leaf("MovePose", pose="cup_pose + z_offset"),
            leaf("MoveJoints", joints="home_config"),
        ),
    ),
    "weigh the cup",
)


def execute(cup='mass="0.3"', more="", noise="lab", stop_when=lambda robot: False):
    """The run, and its world half a second later."""
    world = parse_scene(CELL.format(cup=cup, more=more))
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, noise, seed=1)
    done = run(WEIGH, SCENE, robot, stop_requested=lambda: stop_when(robot))
    robot.advance(0.5)
    return done, robot


def displacement(robot):
    return robot.world.true_poses(["cup"])["cup"].distance_to(SCENE.body("cup").pose_world)


def test_a_whole_weighing_completes_and_restores_the_cup():
    done, robot = execute()
    assert (done.status, done.stopped_by, done.actions) == ("complete", None, 10)
    assert [leaf.status for leaf in done.trace.leaves] == ["SUCCESS"] * 10
    (recording,) = done.trace.recordings
    assert recording.node == "tree.children[5]"
    assert (recording.context.holding, recording.context.activity) == ("cup", "still")
    assert done.trace.of(recording).wrench[:, 2].mean() == pytest.approx(0.3 * 9.81, abs=1.5)
    assert displacement(robot) < 0.002


def lifted_to(height):
    """Asks for a stop once the closed fingers are above `height` m."""
    return lambda robot: robot.state.gripping and robot.state.pose_world_tcp.position[2] > height


@pytest.mark.parametrize(
    ("mass", "height"), [(0.03, 0.17), (0.3, 0.20), (0.3, 0.22), (1.5, 0.20), (2.8, 0.19)]
)
def test_stopped_while_lifting_the_cup_goes_back_to_its_place(mass, height):
    done, robot = execute(cup=f'mass="{mass}"', stop_when=lifted_to(height))
    assert (done.status, done.stopped_by) == ("stopped", "stop requested")
    assert (done.trace.leaves[-1].primitive, done.trace.leaves[-1].status) == ("PutDown", "SUCCESS")
    assert (done.final_state.holding, robot.state.gripping) == (None, False)
    assert displacement(robot) < 0.002
    assert done.final_state.moved["cup"].distance_to(robot.world.true_poses(["cup"])["cup"]) < 0.003
    assert np.abs(robot.state.dq).max() < 0.05


def test_too_heavy_an_object_is_put_down():
    done, robot = execute(cup='mass="4"')
    assert "more than the payload of 3 kg" in str(done.stopped_by)
    assert done.trace.leaves[-1].message == "put cup down"
    assert done.held == HeldObject("cup", "put down")
    assert displacement(robot) < 0.005


def test_a_slippery_object_is_noticed_when_it_is_lost():
    done, robot = execute(cup='mass="1" priority="2" friction="0.05 0.005 0.0001"')
    assert "slip" in str(done.stopped_by)
    assert done.final_state.holding is None
    assert done.held == HeldObject("cup", "lost")
    assert "cup" not in done.final_state.moved, "the best guess is where it stood"
    assert str(done.stopped_by).endswith("is not in the fingers any more: see where it is")
    assert displacement(robot) < 0.01


@pytest.mark.parametrize(
    "wall",
    [
        'pos="0.5 0.1 0.36"><geom size="0.1 0.1 0.01"',
        'pos="0.42 0.06 0.45"><geom size="0.02 0.2 0.1"',
    ],
)
def test_an_unknown_obstacle_stops_the_arm_and_is_not_pressed_on(wall):
    done, robot = execute(more=f'<body {wall} type="box"/></body>')
    assert "MovePose(cup_pose + z_offset): " in str(done.stopped_by)
    assert re.search("contact|external force|stopped itself", str(done.stopped_by))
    assert (done.reflex is not None) == ("stopped itself" in str(done.stopped_by))
    assert np.linalg.norm(robot.state.wrench[:3]) < robot.limits.free_force
    assert np.abs(robot.state.dq).max() < 0.05
    assert displacement(robot) < 0.001


JUG = """<body name="jug" pos="0.5 {y} 0.2"><freejoint/>
<geom type="box" size="0.04 0.04 0.1" mass="0.5" friction="0.6 0.005 0.0001"/></body>"""


@pytest.mark.parametrize("believed", ["", JUG.format(y=-0.36)])
def test_a_hand_that_meets_a_neighbour_out_of_place_says_so_and_hardly_moves_it(believed) -> None:
    """The scene does not show it, or has it elsewhere."""
    scene = parse_scene(CELL.format(cup='mass="0.3"', more=believed))
    world = parse_scene(CELL.format(cup='mass="0.3"', more=JUG.format(y=-0.1)))
    resolve = scene.symbols.resolve
    aside = (resolve("cup_pose + x_offset").position - resolve("cup_pose").position)[1]
    above = "cup_pose + z_offset"
    poses = (above, f"{above} - {0.3 / aside:.3f}*x_offset")
    steps = Node("Sequence", (), tuple(leaf("MovePose", pose=pose) for pose in poses))
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, "lab", seed=1)
    done = run(Plan((), steps, "go past"), scene, robot)
    robot.advance(0.5)
    assert f"MovePose({poses[1]}): unexpected contact" in str(done.stopped_by)
    jug, stood = robot.world.true_poses(["jug"])["jug"], world.body("jug").pose_world
    assert jug.distance_to(stood) < 0.005
    assert jug.rotation[2, 2] > 0.999


def test_fingers_that_were_opening_on_its_support_have_put_it_down():
    def opening(robot):
        closed = robot.state.t > 12.0 and robot.state.gripper_moving
        return closed and robot.state.width > 0.065

    done, robot = execute(stop_when=opening)
    assert (done.stopped_by, done.held) == ("stop requested", HeldObject("cup", "put down"))
    assert done.final_state.moved["cup"].distance_to(SCENE.body("cup").pose_world) < 0.005
    assert displacement(robot) < 0.005


def test_a_missing_object_is_noticed():
    done, _ = execute(cup='mass="0.3" pos="0.2 -0.2 0"')
    assert str(done.stopped_by).startswith("CloseGripper(): the fingers met no resistance")
    assert done.actions == 4


def pushed(robot, newtons):
    """Add a downward force to the measured one."""
    world = robot.world._data
    hand = robot.world.model.body("robot/hand").id
    world.xfrc_applied[hand, 2] = -newtons


@pytest.mark.parametrize("push", [20.0, 60.0])
def test_a_push_that_comes_and_goes_is_no_support(push):
    """A person presses on the hand that holds the cup in the air, and stops."""
    pressing = {"until": 0.0}

    def push_and_stop(robot):
        state = robot.state
        if not pressing["until"] and lifted_to(0.22)(robot):
            pressing["until"] = state.t + 1.0
        if pressing["until"]:
            pushed(robot, push if state.t < pressing["until"] else 0.0)
        return bool(pressing["until"])

    done, robot = execute(stop_when=push_and_stop)
    pushed(robot, 0.0)
    robot.advance(1.0)
    assert done.status == "stopped"
    where = robot.world.true_poses(["cup"])["cup"].position[2]
    on_the_table = abs(where - 0.15) < 0.005
    assert robot.state.gripping or on_the_table, f"dropped to {where:.3f} m"


def test_an_object_that_would_tip_stays_in_the_fingers():
    """Half over the table's edge, at y = 0.4 m, there is nothing to put it down on."""
    resolve = SCENE.symbols.resolve
    aside = (resolve("cup_pose + x_offset").position - resolve("cup_pose").position)[1]
    beyond = f"cup_pose + z_offset + {0.3 / aside:.3f}*x_offset"
    ways = (leaf("MovePose", pose="cup_pose + z_offset"), leaf("MovePose", pose=beyond))
    carry = Node("Sequence", (), (*WEIGH.tree.children[:4], *ways, leaf("MeasureForces")))
    world = parse_scene(CELL.format(cup='mass="0.3"', more=""))
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, "lab", seed=1)

    def over_the_edge():
        return robot.state.gripping and robot.state.pose_world_tcp.position[1] > 0.398

    done = run(Plan((), carry, "carry it"), SCENE, robot, stop_requested=over_the_edge)
    robot.advance(0.5)
    assert done.stopped_by == "stop requested; the fingers still hold 'cup'"
    assert "would tip over the edge of 'table'" in done.trace.leaves[-1].message
    assert robot.state.gripping
    assert done.held == HeldObject("cup", "held")
    assert robot.world.true_poses(["cup"])["cup"].position[2] > 0.2


def test_robot_without_a_state_ends_running_leaves_and_holds():
    def gone(*_):
        raise OSError("no answer")

    held: list[bool] = []
    world = parse_scene(CELL.format(cup='mass="0.3"', more=""))
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, "none")
    mute = Faulty(robot, 3.0, state=gone)
    mute.hold = lambda: held.append(True)
    done = run(WEIGH, SCENE, mute)
    assert (done.stopped_by, done.held) == ("OSError: no answer", None)
    assert [leaf.status for leaf in done.trace.leaves] == ["SUCCESS", "INVALID"]
    assert held


def test_an_object_is_put_on_another_only_where_it_stood_on_it() -> None:
    slid = SymbolicState(parse_scene(CELL.format(cup="", more=STACK)))
    state, found = replace(slid, lifted=True), slid.pose_of("can")
    assert unproven(state, "can", found) is None
    assert unproven(state, "can", found.translate((-0.04, 0, 0))) == "'plate' might tip under it"
    assert unproven(state, "can", found.translate((0, 0.2, -0.02))) is None
    assert unproven(slid, "can", found.translate((-0.04, 0, 0))) is None, "it slid there"


def stopped(scene, world, steps, stop_when):
    """The run of some steps until a stop, and its robot."""
    begin = (leaf("MoveJoints", joints="home_config"), leaf("OpenGripper"))
    plan = Plan((), Node("Sequence", (), (*begin, *steps)), "stop")
    robot = MujocoRobot(world.spec(), world.pose_world_base, world.arm, "none", seed=1)
    done = run(plan, scene, robot, stop_requested=lambda: stop_when(robot))
    robot.advance(1.0)
    return done, robot


CHEST = """<mujoco><worldbody><body name="chest" pos="0.6 0 0.05">
<geom type="box" size="0.15 0.2 0.05"/><body name="lid" pos="0.14 0 0.06">
<joint type="hinge" axis="0 1 0" range="0 86" damping="{lid}" frictionloss="{lid}"/>
<geom type="box" size="0.12 0.15 0.008" pos="-0.13 0 0" mass="0.6"/>
<geom type="box" size="0.012 0.014 0.02" pos="-0.2 0 0.03" mass="0.05"/></body></body>
</worldbody></mujoco>"""
DRAWER = """<mujoco><worldbody><body name="cabinet" pos="0.78 0 0">
<geom type="box" size="0.05 0.2 0.1" pos="0.1 0 0.1"/><body name="lid" pos="-0.02 0 0.14">
<joint type="slide" axis="-1 0 0" range="0 0.22" {lid}/>
<geom type="box" size="0.008 0.17 0.1" pos="-0.148 0 0.02" mass="0.9"/>
<geom type="box" size="0.014 0.014 0.02" pos="-0.205 0 0.05" mass="0.1"/></body></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("text", "believed", "true"),
    [
        (CHEST, "?", "0.05"),
        (DRAWER, 'damping="?" frictionloss="?"', 'damping="2" frictionloss="1" stiffness="80"'),
    ],
    ids=["a lid", "a drawer with a spring"],
)
def test_a_stopped_fixture_goes_back_slowly_to_where_it_was_found(text, believed, true):
    scene, world = parse_scene(text.format(lid=believed)), parse_scene(text.format(lid=true))
    places = []

    def is_moved(robot):
        places.append((robot.state.t, robot.world.true_poses(["lid"])["lid"]))
        found = world.body("lid").pose_world
        return found.distance_to(places[-1][1]) > 0.04 or found.angle_to(places[-1][1]) > 0.2

    steps = [leaf("MovePose", pose=f"lid_pose{more}") for more in (" + z_offset", "")]
    done, robot = stopped(scene, world, [*steps, leaf("MoveHandle")], is_moved)
    assert done.stopped_by == "stop requested"
    assert done.held == HeldObject("lid", "put down")
    assert not robot.state.gripping
    found, now = world.body("lid").pose_world, robot.world.true_poses(["lid"])["lid"]
    assert found.distance_to(now) < 0.001
    assert found.angle_to(now) < 0.005
    # The last leaf is the stop: the fixture moves all the way while the fingers have it.
    stop = done.trace.leaves[-1]
    handle = done.trace.samples
    rows = (handle.t > stop.start) & (handle.width < 0.035)
    way = np.ptp(handle.pose_world_tcp[rows, :3], axis=0)
    assert np.linalg.norm(way) > 0.03
    assert np.abs(handle.twist[rows, :3]).max() < 0.1


BESIDE = """<body name="peg" pos="{x:.3f} -0.1 {z}"><freejoint/>
<geom type="cylinder" size="0.008 {half}" mass="0.03"/></body>"""


@pytest.mark.parametrize(
    ("gap", "half", "width", "reason"),
    [
        (0.036, 0.04, 0.059, None),
        (0.024, 0.04, 0.039, "the fingers cannot open"),
        (0.018, 0.035, 0.039, "cannot be put down here, on the path to"),
    ],
)
def test_a_stop_hits_no_neighbour(gap, half, width, reason):
    """The fingers open less, or stay closed; the cup is lowered only where the way is clear."""
    peg = BESIDE.format(x=0.5 + 0.02 + gap + 0.008, z=0.1 + half, half=half)
    scene = parse_scene(CELL.format(cup='friction="0.6 0.005 0.0001"', more=peg))
    world = parse_scene(CELL.format(cup='mass="0.3"', more=peg))
    resolve = scene.symbols.resolve
    aside = (resolve("cup_pose + x_offset").position - resolve("cup_pose").position)[1]
    there = f"{-0.2 / aside:.4f}*x_offset"
    up = "cup_pose + z_offset"
    poses = [up, "cup_pose", f"{up} + {there}", f"cup_pose + 0.05*z_offset + {there}"]
    moves = [leaf("MovePose", pose=pose) for pose in poses]
    steps = [*moves[:2], leaf("CloseGripper"), moves[0], *moves[2:]]

    def is_there(robot):
        _, y, z = robot.state.pose_world_tcp.position
        return robot.state.gripping and abs(y + 0.1) < 0.005 and z < 0.19

    done, robot = stopped(scene, world, steps, is_there)
    assert done.status == "stopped"
    assert (reason or "put cup down") in done.trace.leaves[-1].message
    assert (done.held.became == "put down") == (reason is None)
    assert robot.state.width == pytest.approx(width, abs=0.001)
    assert robot.world.true_poses(["peg"])["peg"].distance_to(world.body("peg").pose_world) < 0.001
    assert robot.world.true_poses(["cup"])["cup"].rotation[2, 2] > 0.999


def test_a_tilted_object_is_upright_before_it_is_put_down():
    world = parse_scene(CELL.format(cup='mass="0.3"', more=""))

    def is_tilted(robot):
        return robot.world.true_poses(["cup"])["cup"].rotation[2, 2] < np.cos(np.radians(20.0))

    poses = ("cup_pose + z_offset", "cup_pose")
    above, there = (leaf("MovePose", pose=pose) for pose in poses)
    steps = (above, there, leaf("CloseGripper"), above, leaf("Tilt"))
    done, robot = stopped(SCENE, world, steps, is_tilted)
    assert done.held == HeldObject("cup", "put down")
    assert displacement(robot) < 0.002


class Commanded(StandIn):
    """A stand-in that keeps its motions, openings and the thresholds of each."""

    def __init__(self) -> None:
        super().__init__()
        self.moves: list[tuple[str, float, float, float]] = []
        self.opened: list[tuple[float, float | None]] = []
        self.times: list[float] = []

    def move_axis(self, direction, speed, travel):
        super().move_axis(direction, speed, travel)
        way = "down" if direction[2] < 0 else "up"
        assert way == "down" or not self.state.gripper_moving, "the fingers are open"
        self.moves.append((way, speed, travel, self.thresholds.force))

    def move_pose(self, target, speed, slower=()):
        super().move_pose(target, speed, slower)
        self.times.append(self.state.t)
        if self.state.pose_world_tcp.angle_to(target) > 1e-6:
            self.moves.append(("turn", speed, 0.0, self.thresholds.force))

    def open_gripper(self, width=None):
        super().open_gripper(width)
        self.opened.append((self.state.t, width))


AROUND = """<mujoco><worldbody><site name="robot_base"/>
<body name="table" pos="0.5 0 0.005"><geom type="box" size="0.3 0.3 0.03"/></body>
<body name="cup" pos="0.5 0 0.085"><freejoint/><geom type="box" size="0.03 0.02 0.05"/></body>{}
</worldbody></mujoco>"""
DESK = parse_scene(AROUND.format(""))
WEIGHT = 3.0


def blackboard_with(robot, z, scene=DESK, holding="cup", lifted=True, grasp=None, x=0.5, turn=0.0):
    """The hand with the cup, `z` m high; its grasp is at 0.1 m. It is turned about y by `turn` rad."""
    pose = Pose.top_down((x, 0.0, z), 0.0)
    turned = Pose.of(pose.position, rotate_quaternion(pose.quaternion, turn * np.eye(3)[1:2])[0])
    robot.put(pose_world_tcp=turned, target_world_tcp=turned, gripping=True, width=0.04)
    robot.gripping_after, robot.between = True, 0.04
    robot.weight, robot.support_z = WEIGHT, 0.1
    state = SymbolicState(
        scene,
        pose_world_tcp=pose,
        gripper="closed",
        holding=holding,
        grasp=grasp,
        lifted=lifted,
        pose_tcp_object=IN_HAND if holding else None,
        activity="moving",
    )
    hanging = np.array([0.0, 0.0, WEIGHT, 0.0, 0.0, 0.0])
    load = FingerLoad(np.zeros(6), width=0.04, hanging=hanging)
    return Blackboard(robot, state, Recorder(robot), load=load)


def put_down(blackboard, seconds=30.0):
    """The message of the leaf; the robot keeps what was commanded."""
    leaf = PrimitiveLeaf(PutDown(), blackboard, "stop")
    tick(leaf, blackboard.robot, int(seconds / TICK))
    assert leaf.status is not Status.RUNNING
    return leaf.feedback_message


def test_the_cup_is_lowered_pressed_released_and_left() -> None:
    robot = Commanded()
    robot.set_reflex(Reflex(force=5.0, torque=1.0))
    board = blackboard_with(robot, 0.2)
    assert put_down(board) == "put cup down"
    (down, up) = robot.moves
    assert down == ("down", GUARDED_SPEED, pytest.approx(0.115), 60.0)
    assert up[:3] == ("up", 0.05, 0.1)
    assert up[3] < 20.0, "a collision in free air stops it"
    assert robot.opened[0][1] == 0.08
    # At rest for 0.3 s after each motion, and pressed for 0.5 s.
    assert robot.opened[0][0] - robot.times[0] > 0.1 / GUARDED_SPEED + 0.8
    assert robot.state.t - robot.times[1] > 0.1 / RETREAT_SPEED + 0.3
    state = board.state
    assert (state.holding, state.grasp, state.pose_tcp_object, state.lifted) == (None,) * 3 + (
        False,
    )
    assert (state.gripper, state.contact, state.activity) == ("open", None, "still")
    there = state.moved["cup"]
    assert there.distance_to(DESK.body("cup").pose_world) < 0.006
    # The support bore the cup with 5 N more for half a second, and the hand is 100 mm higher.
    assert state.tcp.position[2] == pytest.approx(robot.state.pose_world_tcp.position[2], abs=1e-6)
    assert state.tcp.position[2] == pytest.approx(there.position[2] + 0.015 + 0.1, abs=1e-3)


def test_a_cup_without_a_support_stays_in_the_fingers() -> None:
    robot = Commanded()
    board = blackboard_with(robot, 0.2)
    robot.support_z = -1.0
    assert put_down(board) == f"no support within 115 mm below 'cup': {STAYS}"
    assert not robot.opened
    assert board.state.holding == "cup"


@pytest.mark.parametrize(
    ("above", "told"), [(0.030, "met something 25 mm above"), (0.012, "put cup down")]
)
def test_a_contact_far_above_the_support_is_an_obstacle(above, told) -> None:
    robot = Commanded()
    board = blackboard_with(robot, 0.2)
    robot.support_z = 0.1 + above
    assert told in put_down(board)
    assert bool(robot.opened) == (told == "put cup down")


@pytest.mark.parametrize(
    ("borne", "presses", "told"),
    [
        ([9.0], 1, "put cup down"),
        ([WEIGHT + 1.0, 9.0], 2, "put cup down"),
        ([WEIGHT + 1.0, WEIGHT + 1.0, WEIGHT + 3.0], 3, "put cup down"),
        ([WEIGHT + 1.0] * 3, 3, "nothing bears 'cup' for long"),
    ],
)
def test_a_support_that_yields_is_pressed_three_times_at_most(borne, presses, told) -> None:
    """At rest it bears so many N after each press; 2 N more than the weight must remain."""
    robot = Commanded()
    board = blackboard_with(robot, 0.2)

    def yields(stand_in):
        count = sum(way == "down" for way, *_ in robot.moves)
        if count and not stand_in.state.moving and stand_in.state.gripping:
            rests = WEIGHT - borne[count - 1]
            stand_in.put(wrench=np.array([0, 0, rests, 0, 0, 0.0]))

    robot.on_advance = yields
    assert told in put_down(board)
    downs = [travel for way, _, travel, _ in robot.moves if way == "down"]
    assert len(downs) == presses
    stiffness = DESK.arm.stiffness.translation
    assert downs[1:] == pytest.approx([5.0 / stiffness] * (presses - 1))
    # At rest for 0.3 s after each motion; the deeper presses themselves take time, too.
    waits, ways = np.diff(robot.times[:presses]), 5.0 / stiffness / GUARDED_SPEED
    assert (waits > 0.3 + ways).all()


@pytest.mark.parametrize(("seconds", "told"), [(0.45, "nothing bears"), (0.9, "put cup down")])
def test_a_support_must_bear_for_half_a_second(seconds, told) -> None:
    """It gives way so long after the arm has come to rest for 0.3 s."""
    robot = Commanded()
    board = blackboard_with(robot, 0.2)
    rests = {"since": np.inf}

    def gives_way(stand_in):
        if any(way == "down" for way, *_ in robot.moves) and not stand_in.state.moving:
            rests["since"] = min(rests["since"], stand_in.state.t)
            if stand_in.state.gripping and stand_in.state.t - rests["since"] > 0.3 + seconds:
                stand_in.put(wrench=np.array([0, 0, WEIGHT, 0, 0, 0.0]))

    robot.on_advance = gives_way
    assert told in put_down(board)


@pytest.mark.parametrize(
    ("z", "lifted", "grasp", "lowers"),
    [
        (0.1, False, None, False),
        (0.1, True, None, True),
        (0.0, False, "cup_pose", False),
        (0.002, False, "cup_pose", False),
        (0.004, False, "cup_pose", True),
    ],
)
def test_an_object_on_its_support_is_released_where_it_is(z, lifted, grasp, lowers) -> None:
    robot = Commanded()
    found = float(DESK.symbols.resolve("cup_pose").position[2]) if grasp else 0.0
    board = blackboard_with(robot, found + z, lifted=lifted, grasp=grasp)
    robot.support_z = found + z - 0.002
    assert "put cup down" in put_down(board)
    assert any(way == "down" for way, *_ in robot.moves) == lowers


def test_an_object_of_unknown_place_in_the_hand_is_lowered_onto_its_support() -> None:
    robot = Commanded()
    upside_down = AROUND.format("").replace('pos="0.5 0 0.085"', 'pos="0.5 0 0.085" quat="0 1 0 0"')
    board = blackboard_with(robot, 0.2, parse_scene(upside_down))
    board.state = replace(board.state, pose_tcp_object=None)
    # The object counts as at the TCP, which is turned like the cup in the scene.
    robot.support_z = 0.085
    assert put_down(board) == "put cup down"
    assert [way for way, *_ in robot.moves] == ["down", "up"]


def test_the_parts_of_an_object_beside_the_fingers_are_no_neighbour() -> None:
    """Lugs of the cup itself stand 8 mm outside the fingers."""
    lugs = "".join(
        f'<geom type="box" size="0.02 0.004 0.02" pos="0 {y} 0"/>' for y in (-0.052, 0.052)
    )
    cup = '<geom type="box" size="0.03 0.02 0.05"/>'
    scene = parse_scene(AROUND.format("").replace(cup, cup + lugs))
    for holding in (None, "cup"):
        robot = Commanded()
        board = blackboard_with(robot, 0.1, scene, holding=holding, lifted=False)
        assert "down" in put_down(board)
        assert [width for _, width in robot.opened] == [0.08]


def test_an_object_that_was_just_grasped_is_released() -> None:
    robot = Commanded()
    board = blackboard_with(robot, 0.1, holding=None)
    assert put_down(board) == "put what was just grasped down"
    assert [way for way, *_ in robot.moves] == ["up"]
    assert board.state.moved == {}


def test_a_tilted_hand_turns_back_first_and_an_upright_one_does_not() -> None:
    for degrees, ways in ((20.0, ["turn", "down", "up"]), (2.0, ["down", "up"])):
        robot = Commanded()
        board = blackboard_with(robot, 0.25, turn=np.radians(degrees))
        assert "put cup down" in put_down(board)
        # A motion of the tilted hand is no turn.
        assert [way for way, *_ in robot.moves] == ways
        turns = [speed for way, speed, *_ in robot.moves if way == "turn"]
        assert robot.times[1] - robot.times[0] > 0.3
        assert turns == [RETREAT_SPEED] * len(turns)


BLOCK = '<body name="block" pos="0.5 0.088 {}"><geom type="box" size="0.02 0.012 0.005"/></body>'


def test_a_hand_turns_back_only_where_it_is_clear() -> None:
    """A block stands 12 mm inside the upright hand, and outside the tilted one."""
    robot = Commanded()
    block = BLOCK.format(0.34).replace('pos="0.5 ', 'pos="0.46 ')
    board = blackboard_with(robot, 0.25, parse_scene(AROUND.format(block)), turn=np.radians(20.0))
    assert "it would lean by 20°" in put_down(board)
    assert not robot.moves


@pytest.mark.parametrize(("room", "rise"), [(0.3, 0.1), (0.085, 0.06), (0.05, 0.03), (0.02, None)])
def test_the_hand_rises_only_as_far_as_it_is_clear(room, rise) -> None:
    """A block is so far above the outer end of the hand."""
    robot = Commanded()
    scene = parse_scene(AROUND.format(BLOCK.format(0.1 + 0.0974 + room + 0.005)))
    board = blackboard_with(robot, 0.1, scene, lifted=False)
    done = put_down(board)
    assert [travel for way, _, travel, _ in robot.moves if way == "up"] == [rise] * (
        rise is not None
    )
    assert done.endswith("the way up is not clear") == (rise is None)


@pytest.mark.parametrize(
    ("gap", "width"), [(0.070, 0.08), (0.055, 0.06), (0.050, 0.05), (0.044, None)]
)
def test_the_fingers_open_only_as_far_as_they_meet_no_neighbour(gap, width) -> None:
    """A peg stands so far from the middle of the fingers, which are 40 mm apart and 22 mm thick."""
    peg = BESIDE.format(x=0.5, z=0.075, half=0.04).replace(" -0.1 ", f" {gap + 0.008} ")
    robot = Commanded()
    done = put_down(
        blackboard_with(robot, 0.1, parse_scene(AROUND.format(peg)), lifted=False, holding="cup")
    )
    assert [opened for _, opened in robot.opened] == [pytest.approx(width)] * (width is not None)
    reason = "the fingers cannot open, at 'this pose' the right finger would move into 'peg'"
    assert done.startswith(reason) == (width is None)
    assert done.endswith(STAYS) == (width is None)


def test_over_the_edge_nothing_is_lowered_or_opened() -> None:
    robot = Commanded()
    board = blackboard_with(robot, 0.2, x=0.79)
    assert "'cup' cannot be put down here, " in put_down(board)
    assert not robot.moves
    assert not robot.opened


def test_a_fixture_that_does_not_go_back_stays_in_the_fingers(monkeypatch) -> None:
    def fails(_):
        raise LeafFailure("it sticks")
        yield

    scene = parse_scene(CHEST.format(lid="0.05"))
    robot = Commanded()
    board = blackboard_with(robot, 0.3, scene, holding="lid")
    board.state = replace(board.state, pose_tcp_object=None)
    monkeypatch.setitem(PutDown._back_to_rest.__globals__, "return_fixture", fails)
    assert put_down(board) == f"'lid' is not back where it was found, it sticks: {STAYS}"
    assert not robot.opened


@pytest.mark.parametrize(
    ("width", "load", "holding", "slips"),
    [
        (0.035, -3.0, "cup", True),
        (0.035, -1.0, "cup", False),
        (0.039, -3.0, "cup", False),
        (0.035, -3.0, None, False),
    ],
)
def test_a_slipping_object_is_released_only_while_it_presses(width, load, holding, slips) -> None:
    robot = Commanded()
    board = blackboard_with(robot, 0.1, holding=holding)
    robot.put(width=width, wrench=np.array([0, 0, load, 0, 0, 0.0]))
    assert let_slip(board) == slips
    assert bool(robot.opened) == slips
    assert (board.state.holding is None) == (slips or holding is None)


def test_a_lost_object_is_believed_where_the_scene_has_it() -> None:
    board = blackboard_with(Commanded(), 0.3)
    board.state = replace(board.state, moved={"other": DESK.body("cup").pose_world})
    assert set(state_after_release(board).moved) == {"cup", "other"}
    assert set(lost(board).moved) == {"other"}
    assert lost(board).holding is None


def test_a_fixture_that_is_released_has_no_pose_in_the_hand() -> None:
    board = blackboard_with(Commanded(), 0.3)
    board.state = replace(board.state, pose_tcp_object=None)
    assert state_after_release(board).moved == {}


def test_a_force_that_remains_at_the_release_is_no_contact_on_the_way_up() -> None:
    robot = Commanded()
    board = blackboard_with(robot, 0.1, lifted=False)
    robot.force = np.array([0, 0, -9.0, 0, 0, 0])
    assert put_down(board) == "put cup down"
    assert robot.thresholds.pressed == pytest.approx((0.0, 0.0, -9.0))


@pytest.mark.parametrize(("force", "stops"), [(5.0, False), (30.0, True)])
def test_a_force_on_the_way_up_is_a_contact(force, stops) -> None:
    robot = Commanded()
    board = blackboard_with(robot, 0.1, lifted=False)

    def meets(stand_in):
        if any(way == "up" for way, *_ in robot.moves):
            stand_in.put(wrench=np.array([force, 0, 0, 0, 0, 0.0]))

    robot.on_advance = meets
    assert ("unexpected contact" in put_down(board)) == stops


@pytest.mark.parametrize(("aside", "told"), [(0.10, "put cup down"), (0.045, "on the path to")])
def test_an_object_is_lowered_only_where_the_way_is_clear(aside, told) -> None:
    """A peg stands where one finger comes down, beside the place of the cup."""
    peg = BESIDE.format(x=0.5, z=0.075, half=0.04).replace(" -0.1 ", f" {aside} ")
    robot = Commanded()
    done = put_down(blackboard_with(robot, 0.25, parse_scene(AROUND.format(peg))))
    assert told in done
    assert bool(robot.moves) == (told == "put cup down")


def test_the_end_of_a_held_object_is_reported() -> None:
    assert HeldObject("cup", "put down").warning is None
    assert HeldObject("cup", "held").warning == "the fingers still hold 'cup'"
    assert "what was grasped was not put down" in str(HeldObject(None, "lost").warning)


def test_forces_of_a_release_are_expected_and_those_of_the_retreat_are_not() -> None:
    state = blackboard_with(Commanded(), 0.2).state
    expected = PutDown().expectation(state)
    assert (expected.contact, expected.grasped) == (True, True)
    assert not PutDown().expectation(replace(state, holding=None)).contact
    released = replace(state, holding=None, activity="contact")
    assert PutDown().expectation(released).contact
    assert not PutDown().expectation(released).grasped


TRAY = """<mujoco><option cone="elliptic" impratio="10"/><worldbody>
<body name="table" pos="0.5 0 0.05"><geom type="box" size="0.3 0.3 0.05" friction="0.25"/></body>
<body name="sheet" pos="0.5 0 0.103"><freejoint/>
<geom type="box" size="0.12 0.12 0.003" mass="{sheet}" friction="0.3"/></body>
<body name="can" pos="0.5 0 0.166"><freejoint/>
<geom type="cylinder" size="0.03 0.06" mass="0.3" friction="0.8"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("true", [8.0, 0.1])
def test_a_slide_ends_where_a_loose_sheet_moves_along(true):
    """The sheet is stated with 8 kg. Its own friction on the table is 0.3, and that of the can 0.8."""
    scene, world = parse_scene(TRAY.format(sheet=8.0)), parse_scene(TRAY.format(sheet=true))
    poses = ("can_pose + z_offset", "can_pose", "can_pose + 5*y_offset")
    up, down, aside = (leaf("MovePose", pose=pose) for pose in poses)
    done, robot = stopped(
        scene, world, [up, down, leaf("CloseGripper"), up, down, aside], lambda robot: False
    )
    way = robot.world.true_poses(["sheet"])["sheet"].distance_to(world.body("sheet").pose_world)
    if true == 8.0:
        assert done.status == "complete"
        assert way < 0.001
    else:
        assert "meets a friction of 0.30, as between 'sheet' and its support" in str(
            done.stopped_by
        )
        assert done.held == HeldObject("can", "put down")
        assert 0.002 < way < 0.025
