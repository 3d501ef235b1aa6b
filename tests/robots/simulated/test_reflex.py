"""The arm runs into things that nobody told it of; what they bear is read from MuJoCo's own contacts
at every physics step."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.robots.description import RobotDescription
from palpate.robots.owner import load_description
from palpate.robots.pace import unexplained_torque
from palpate.robots.sheet import Links, Reflex
from palpate.robots.simulated.robot import MujocoRobot

ARM = load_description()
BASE = Pose.of([0.0, 0.0, 0.0])
REFLEXES = ARM.limits.reflexes
STEPS_A_MS = 2
"""Physics steps."""
POST = 'type="capsule" fromto="0.58 0 0 0.58 0 0.4" size="0.02"'
SIDE = 'type="capsule" fromto="0.5 0.14 0 0.5 0.14 0.4" size="0.02"'
BAR = 'type="capsule" fromto="0.5 -0.2 0.15 0.5 0.2 0.15" size="0.02"'


@dataclass
class Felt:
    """What the geom `post` bears, N, one number a physics step."""

    forces: list[float] = field(default_factory=list)

    def look(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        post, total, out = model.geom("post").id, np.zeros(3), np.empty(6)
        for i in range(data.ncon):
            contact = data.contact[i]
            if post in (contact.geom1, contact.geom2):
                mujoco.mj_contactForce(model, data, i, out)
                sign = 1.0 if contact.geom1 == post else -1.0
                total += sign * contact.frame.reshape(3, 3).T @ out[:3]
        self.forces.append(float(np.linalg.norm(total)))

    def mean(self, ms: int) -> float:
        """The largest mean over so many milliseconds."""
        window = np.ones(ms * STEPS_A_MS) / (ms * STEPS_A_MS)
        return float(np.convolve(self.forces, window).max())

    def after(self, ms: int) -> float:
        """The largest force from so long after the first contact on."""
        forces = np.array(self.forces)
        first = int(np.flatnonzero(forces > 0)[0])
        return float(forces[first + ms * STEPS_A_MS :].max())


def watched(arm: MujocoRobot) -> Felt:
    """What the post of an arm's world bears from now on."""
    felt = Felt()
    arm.world.watch = lambda data: felt.look(arm.world.model, data)
    return felt


def among(
    shape: str, stiffness: float | None = None, more: str = "", arm: RobotDescription = ARM
) -> MujocoRobot:
    """An arm and one thing: fixed, or on a spring of `stiffness` N/m along x, y and z."""
    spring = (
        f'stiffness="{stiffness}" damping="{0.6 * (4 * stiffness) ** 0.5}"' if stiffness else ""
    )
    joints = "".join(
        f'<joint type="slide" axis="{axis}" {spring}/>' for axis in ("1 0 0", "0 1 0", "0 0 1")
    )
    world = f"""<mujoco><worldbody>
      <body gravcomp="1">{joints if stiffness else ""}
        <geom name="post" {shape} mass="0.2" friction="0.5"/></body>{more}
    </worldbody></mujoco>"""
    return MujocoRobot(mujoco.MjSpec.from_string(world), BASE, arm, noise="datasheet", seed=1)


def go(arm: MujocoRobot, position: tuple[float, float, float], speed: float = 0.25) -> None:
    """Until the motion has ended, however it did, and half a second longer."""
    arm.move_pose(Pose.top_down(position, 0.0), speed)
    arm.advance(0.02)
    while arm.state.moving:
        arm.advance(0.02)
    arm.advance(0.5)


def test_a_motion_through_free_air_measures_no_contact() -> None:
    arm = among('type="sphere" pos="0 -0.8 0" size="0.02"')
    arm.set_reflex(Reflex(5.0, 2.0))
    felt, sensed = [], []
    arm.move_pose(Pose.top_down((0.5, 0.1, 0.1), 0.5), 0.25)
    arm.advance(0.02)
    while arm.state.moving:
        arm.advance(0.005)
        felt.append(np.linalg.norm(arm.state.contact[:3]))
        sensed.append(np.linalg.norm(arm.state.wrench[:3]))
    assert arm.state.reflex is None
    assert max(sensed) > 6.0, "the arm's own inertia"
    assert max(felt) < 2.0


@pytest.mark.parametrize("stiffness", [None, 1e4, 1e5])
@pytest.mark.parametrize(
    ("shape", "start", "goal", "speed"),
    [
        (POST, (0.45, 0.0, 0.2), (0.65, 0.0, 0.2), 0.15),
        (SIDE, (0.5, 0.0, 0.2), (0.5, 0.2, 0.2), 0.25),
        (BAR, (0.5, 0.0, 0.25), (0.5, 0.0, 0.1), 0.1),
    ],
    ids=["outwards", "sideways", "downwards"],
)
def test_the_arm_does_not_press_an_obstacle(
    shape: str,
    start: tuple[float, float, float],
    goal: tuple[float, float, float],
    speed: float,
    stiffness: float | None,
) -> None:
    arm = among(shape, stiffness)
    felt = watched(arm)
    go(arm, start)
    assert not any(felt.forces)
    arm.set_reflex(REFLEXES.free)
    go(arm, goal, speed)
    assert str(arm.state.reflex).startswith("unexpected contact: the arm stopped itself at ")
    assert felt.mean(10) < 180.0
    assert felt.mean(20) < 150.0
    assert felt.after(100) < 25.0
    assert np.abs(arm.state.dq).max() < 0.01


@pytest.mark.parametrize(
    ("shape", "start", "goal"),
    [
        pytest.param(POST, (0.45, 0.0, 0.2), (0.65, 0.0, 0.2), marks=pytest.mark.long),
        pytest.param(SIDE, (0.5, 0.0, 0.2), (0.5, 0.2, 0.2), marks=pytest.mark.long),
        (BAR, (0.5, 0.0, 0.2), (0.5, 0.0, 0.1)),
    ],
    ids=["outwards", "sideways", "downwards"],
)
def test_a_cautious_arm_hits_nothing_hard(
    shape: str, start: tuple[float, float, float], goal: tuple[float, float, float]
) -> None:
    arm = among(shape, arm=ARM.cautious())
    felt = watched(arm)
    go(arm, start)
    arm.set_reflex(REFLEXES.free)
    go(arm, goal, 0.25)
    assert arm.state.reflex
    assert felt.mean(10) < 65.0
    assert felt.mean(20) < 45.0
    assert felt.after(100) < 25.0


@pytest.mark.parametrize("stiffness", [None, 1e6])
def test_an_obstacle_hit_slowly_gets_a_small_force_from_the_first_moment(
    stiffness: float | None,
) -> None:
    arm = among(BAR, stiffness)
    felt = watched(arm)
    go(arm, (0.5, 0.0, 0.185))
    arm.set_reflex(REFLEXES.probing)
    arm.move_axis(np.array([0.0, 0.0, -1.0]), 0.02, 0.05)
    while arm.state.moving and abs(arm.state.contact[2]) < 8.0:
        arm.advance(0.02)
    arm.hold()
    arm.advance(0.5)
    assert felt.mean(10) < 65.0
    assert felt.mean(20) < 45.0


def test_a_reflex_ends_the_motion_where_the_arm_stands_until_the_next_one() -> None:
    arm = among(POST)
    go(arm, (0.45, 0.0, 0.2))
    arm.set_reflex(REFLEXES.free)
    arm.move_pose(Pose.top_down((0.65, 0.0, 0.2), 0.0), 0.15)
    while arm.state.reflex is None:
        arm.advance(0.02)
    assert not arm.state.moving
    arm.advance(1.0)
    state = arm.state
    assert state.pose_world_tcp.distance_to(state.target_world_tcp) < 0.002
    go(arm, (0.45, 0.0, 0.2))
    assert arm.state.reflex is None
    assert arm.state.pose_world_tcp.distance_to(Pose.top_down((0.45, 0, 0.2), 0)) < 1e-3


def test_wider_thresholds_let_the_arm_press_on() -> None:
    arm = among(BAR)
    go(arm, (0.5, 0.0, 0.19))
    arm.set_reflex(REFLEXES.contact)
    arm.move_axis(np.array([0.0, 0.0, -1.0]), 0.01, 0.03)
    while abs(arm.state.contact[2]) < 20.0:
        arm.advance(0.02)
    assert arm.state.reflex is None
    assert arm.state.moving


def test_a_held_object_stays_in_the_fingers_and_does_not_sink() -> None:
    cup = """<body name="cup" pos="0.45 0 0.2"><freejoint/>
      <geom type="box" size="0.02 0.02 0.035" mass="0.8" friction="0.8"/></body>
      <geom type="box" pos="0.45 0 0.0825" size="0.03 0.03 0.0825"/>"""
    arm = among(POST, more=cup)
    go(arm, (0.45, 0.0, 0.3))
    go(arm, (0.45, 0.0, 0.2))
    arm.close_gripper()
    arm.advance(1.0)
    go(arm, (0.45, 0.0, 0.3))
    arm.set_reflex(REFLEXES.carrying)
    go(arm, (0.65, 0.0, 0.3), 0.15)
    assert arm.state.reflex
    assert arm.state.gripping
    assert arm.state.pose_world_tcp.position[2] == pytest.approx(0.3, abs=0.006)
    assert arm.world.true_poses(["cup"])["cup"].position[2] == pytest.approx(
        arm.world.true_tcp().position[2], abs=0.002
    )


def test_a_bar_hit_by_the_elbow_shows_in_the_joint_torques() -> None:
    """The wrench at the TCP reads little of it: the forearm has no lever on the wrist's joints."""
    links, means = Links(unexplained_torque(ARM), 0.1), list[float]()
    goal = ARM.home + np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for watched_joints in (None, links):
        arm = among('type="capsule" fromto="0.1 0.16 0.5 0.1 0.16 0.9" size="0.02"')
        felt = watched(arm)
        arm.set_reflex(replace(REFLEXES.contact, links=watched_joints))
        arm.move_joints(goal)
        arm.advance(2.0)
        means.append(felt.mean(10))
    assert "a link met something" in str(arm.state.reflex)
    assert means[1] < 0.8 * means[0]


@pytest.mark.parametrize("sudden", [np.inf, 2.0], ids=["holding", "empty"])
def test_an_empty_arm_goes_back_from_a_bar_that_acts_as_a_wedge(sudden: float) -> None:
    """An arm that only brakes presses on it: 500 N in the mean of 10 ms, and 200 N after 50 ms."""
    begin = [-0.36, -1.033, 0.233, -2.483, -0.165, 1.608, 0.633]
    end = [-1.262, -1.371, -0.161, -1.813, -0.759, 1.528, 0.755]
    arm = among('type="capsule" fromto="-0.156 0.334 0.582 -0.267 0.233 0.323" size="0.02"')
    arm.move_joints(np.array(begin))
    arm.advance(4.0)
    felt = watched(arm)
    links = Links(unexplained_torque(ARM), 0.1, change=sudden)
    arm.set_reflex(replace(REFLEXES.free, links=links))
    arm.move_joints(np.array(end))
    arm.advance(4.0)
    assert "unexpected contact" in str(arm.state.reflex)
    assert np.abs(arm.state.dq).max() < 0.01
    if np.isfinite(sudden):
        assert felt.mean(10) < 180.0
        assert felt.after(50) == 0.0
    else:
        assert felt.mean(10) > 250.0
