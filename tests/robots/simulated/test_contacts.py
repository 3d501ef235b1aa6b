"""Contacts of the simulated world: softness of the scene, and static friction."""

from __future__ import annotations

import mujoco
import pytest

from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.robots.owner import load_description
from palpate.robots.simulated.contacts import HARDNESS, declared_stiction
from palpate.robots.simulated.robot import MujocoRobot

ARM = load_description()
SOFT = 'solref="-2000 -100" solimp="0.5 0.5 0.001"'
PRESSED = 0.002
"""m that the equilibrium is led into the mat."""


def on(mat: str) -> MujocoRobot:
    """An arm with closed fingers, 1 mm above a mat."""
    here = MujocoRobot(empty(""), Pose.of([0, 0, 0]), ARM).state.pose_world_tcp.position
    top = here[2] - ARM.tip - 0.001
    place = f'<body name="mat" pos="{here[0]} 0 {top}">{mat}</body>'
    robot = MujocoRobot(empty(place), Pose.of([0, 0, 0]), ARM)
    robot.close_gripper()
    robot.advance(1.0)
    return robot


def empty(inside: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(f"<mujoco><worldbody>{inside}</worldbody></mujoco>")


def block(more: str) -> str:
    return f'<geom type="box" size=".05 .05 .02" pos="0 0 -.02" mass=".05" {more}/>'


def stiffness(robot: MujocoRobot) -> float:
    """N/m of what is pressed, from two depths."""
    felt: list[tuple[float, float]] = []
    for deeper in (PRESSED, PRESSED):
        pose = robot.state.target_world_tcp
        robot.move_pose(Pose(pose.position - [0, 0, 0.001 + deeper], pose.quaternion), 0.02)
        robot.advance(1.2)
        state = robot.state
        felt.append((float(state.pose_world_tcp.position[2]), float(state.wrench[2])))
    (z0, f0), (z1, f1) = felt
    return (f1 - f0) / (z1 - z0)


def test_a_geom_without_softness_is_as_hard_as_the_pads() -> None:
    robot = on(block(""))
    assert robot.world.model.npair == 0
    assert stiffness(robot) > 1e5


def test_a_soft_mat_is_soft_under_the_fingers() -> None:
    robot = on(block(SOFT))
    soft = stiffness(robot)
    explicit = stiffness(on(block(f'{SOFT} priority="2" friction="1 0.01 0.0001" condim="4"')))
    assert soft == pytest.approx(explicit, rel=0.5), "about as MuJoCo has it of what takes priority"
    assert soft < 4e4


def test_a_soft_mat_is_grasped_with_the_friction_of_the_pads() -> None:
    model = on(block(SOFT)).world.model
    assert model.npair == 2
    for i in range(model.npair):
        both = (model.geom(int(model.pair_geom1[i])), model.geom(int(model.pair_geom2[i])))
        (pad,) = [geom for geom in both if "pad" in geom.name]
        assert model.pair_friction[i, [0, 2, 3]] == pytest.approx(pad.friction)
        assert model.pair_solref[i] == pytest.approx([-2000, -100])
        assert model.pair_dim[i] == 4


def test_a_geom_without_collision_bits_gets_no_pair() -> None:
    assert on(block(f'{SOFT} contype="0" conaffinity="0"')).world.model.npair == 0


def test_a_geom_that_states_the_defaults_gets_no_pair() -> None:
    solref, solimp = (" ".join(map(str, values)) for values in HARDNESS)
    assert on(block(f'solref="{solref}" solimp="{solimp}"')).world.model.npair == 0


def test_springs_dampers_and_friction_of_the_scene_stay() -> None:
    joint = '<joint name="s" type="slide" axis="0 0 1" stiffness="3000" damping="60" {dry}/>'
    robot = on(joint.format(dry="") + block(""))
    assert stiffness(robot) == pytest.approx(3000, rel=0.05)
    model = on(joint.format(dry='frictionloss="7"') + block("")).world.model
    slide = model.joint("s")
    assert (slide.stiffness[0], slide.damping[0], slide.frictionloss[0]) == (3000, 60, 7)


STATIC, DYNAMIC = 0.5, 0.3
HALF = 0.03
WORLD = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="table" type="box" size="1 1 .02" pos="0 0 -.02"/>
    <body name="{name}" pos="0 0 {z}">
      <freejoint/>
      <geom type="box" size=".03 .03 {half}" mass=".2" friction="{dynamic}" priority="1"/>
    </body>
  </worldbody>
  <custom><numeric name="static_friction_box" data="{static}"/></custom>
</mujoco>"""


def a_box(z: float = HALF - 1e-4, speed: float = 0.0, name: str = "box", static: float = STATIC):
    """A box `z` m up that moves along x, at m/s."""
    text = WORLD.format(name=name, z=z, half=HALF, dynamic=DYNAMIC, static=static)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[0] = speed
    mujoco.mj_forward(model, data)
    return model, data


def coefficient(model: mujoco.MjModel) -> float:
    return float(model.geom_friction[1, 0])


@pytest.mark.parametrize(("speed", "holds"), [(0.0, STATIC), (0.04, DYNAMIC)])
def test_an_object_at_rest_holds_better_than_a_sliding_one(speed, holds):
    model, data = a_box(speed=speed)
    (stiction,) = declared_stiction(model)
    stiction.apply(model, data)
    assert coefficient(model) == holds


def test_an_object_that_hops_as_it_slides_lands_sliding():
    model, data = a_box(speed=0.04)
    assert data.ncon > 0
    (stiction,) = declared_stiction(model)
    stiction.apply(model, data)
    data.qpos[2] += 0.01
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    stiction.apply(model, data)
    assert coefficient(model) == DYNAMIC


def test_an_object_that_lands_at_rest_holds():
    model, data = a_box(speed=0.04)
    (stiction,) = declared_stiction(model)
    stiction.apply(model, data)
    data.qvel[0] = 0.0
    mujoco.mj_forward(model, data)
    stiction.apply(model, data)
    assert coefficient(model) == STATIC


@pytest.mark.parametrize(
    ("changes", "named"), [({"name": "tin"}, "tin"), ({"static": 0.1}, "must not be less")]
)
def test_static_friction_below_dynamic_or_of_no_object_is_refused(changes, named):
    model, _ = a_box(**changes)
    with pytest.raises(InputError, match=named):
        declared_stiction(model)
