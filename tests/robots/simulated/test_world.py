"""What a scene's file says of its own things does not reach the robot, and the robot meets them all."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.robots.description import PREFIX
from palpate.robots.owner import load_description
from palpate.robots.simulated.robot import MujocoRobot

ARM = load_description()
GREEDY = """<default>
  <general ctrlrange="-1 1" ctrllimited="true" forcerange="0 1"/><motor ctrlrange="-1 1" gear="3"/>
  <position ctrlrange="-1 1" kp="7"/><joint damping="5" armature="1" frictionloss="2"/>
  <geom friction="0.1" contype="2" margin="0.01" condim="1" density="5"/><site size="1"/>
  <tendon stiffness="100"/><equality solref="1 1"/>
</default>"""


def robot(inside: str = "", before: str = "") -> MujocoRobot:
    spec = mujoco.MjSpec.from_string(f"<mujoco>{before}<worldbody>{inside}</worldbody></mujoco>")
    return MujocoRobot(spec, Pose.of([0, 0, 0]), ARM)


def test_a_scenes_defaults_do_not_reach_the_robot() -> None:
    plain, greedy = robot().world.model, robot(before=GREEDY).world.model
    for name in dir(plain):
        if name.startswith(("actuator_", "jnt_", "dof_", "tendon_", "eq_", "geom_", "body_")):
            one, other = getattr(plain, name), getattr(greedy, name)
            assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), name


@pytest.mark.parametrize(("contype", "conaffinity"), [(1, 2), (2, 0), (4, 4), (0, 8)])
def test_the_hand_collides_with_every_solid_shape(contype: int, conaffinity: int) -> None:
    bits = f'contype="{contype}" conaffinity="{conaffinity}"'
    here = robot().state.pose_world_tcp.position
    top = here[2] - ARM.tip - 0.001
    found = robot(f'<geom type="box" size=".1 .1 .02" pos="{here[0]} 0 {top - 0.02}" {bits}/>')
    found.close_gripper()
    found.advance(1.0)
    pose = found.state.target_world_tcp
    found.move_pose(Pose(pose.position - [0, 0, 0.004], pose.quaternion), 0.02)
    found.advance(1.0)
    assert found.state.wrench[2] < -5.0


def test_collisions_within_the_scene_stay_as_they_are() -> None:
    bits = ((1, 2), (2, 4), (8, 0), (0, 0), (1, 1))
    inside = "".join(
        f'<body pos="0 {i} 3"><freejoint/><geom size=".1" contype="{c}" conaffinity="{a}"/></body>'
        for i, (c, a) in enumerate(bits)
    )
    model = robot(inside).world.model
    own = [i for i in range(model.ngeom) if not _robots(model, i)]
    for i, one in zip(own, bits, strict=True):
        for j, other in zip(own, bits, strict=True):
            met = model.geom_contype[i] & model.geom_conaffinity[j]
            assert bool(met) == bool(one[0] & other[1])
    assert model.geom_contype[own[3]] == model.geom_conaffinity[own[3]] == 0


def test_a_scene_that_leaves_no_bit_is_bad_input() -> None:
    with pytest.raises(InputError, match="every bit of contype"):
        robot(
            '<geom size=".1" pos="2 0 0" contype="2147483646" conaffinity="0"/>'
            '<geom size=".1" pos="2 1 0"/>'
        )


def test_a_scene_tuned_for_speed_is_solved_well() -> None:
    option = robot(before='<option solver="CG" iterations="1" ls_iterations="4"/>').world.model.opt
    assert option.solver == mujoco.mjtSolver.mjSOL_NEWTON
    assert (option.iterations, option.ls_iterations) == (100, 50)


@pytest.mark.parametrize(
    ("shape", "size"), [("cylinder", ".03 .045"), ("ellipsoid", ".03 .03 .045")]
)
def test_a_shallow_contact_pushes(shape: str, size: str) -> None:
    model = robot(
        '<geom type="box" size=".4 .5 .02" pos=".6 0 -.02"/>'
        f'<body name="cup" pos=".5 0 .2"><freejoint/><geom type="{shape}" size="{size}"/></body>'
    ).world.model
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    cup = int(model.body("cup").id)
    place = int(model.jnt_qposadr[model.body_jntadr[cup]])
    for depth in np.geomspace(1e-10, 1e-5, 200).tolist():
        quaternion = np.array([1.0, *random.uniform(-0.005, 0.005, 2), 0.0])
        quaternion /= np.linalg.norm(quaternion)
        down = Pose(np.zeros(3), quaternion).rotation[2]
        # Height of the centre over the lowest point of the tilted shape: its support function.
        height = 0.03 * np.hypot(down[0], down[1]) + 0.045 * down[2]
        if shape == "ellipsoid":
            height = np.linalg.norm(down * [0.03, 0.03, 0.045])
        data.qpos[place : place + 3] = *random.uniform((0.4, -0.2), (0.6, 0.2)), height - depth
        data.qpos[place + 3 : place + 7] = quaternion
        mujoco.mj_fwdPosition(model, data)
        # Rows of contacts that involve the cup; the normal points from the first geom to the second.
        bodies = model.geom_bodyid[data.contact.geom]
        mine = (bodies == cup).any(axis=1)
        up = np.where(bodies[mine, 1] == cup, 1.0, -1.0) * data.contact.frame[mine, 2]
        assert len(up)
        assert up.min() > 0.99


def _robots(model: mujoco.MjModel, geom: int) -> bool:
    return model.body(model.geom_bodyid[geom]).name.startswith(PREFIX)
