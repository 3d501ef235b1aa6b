"""The embedded robot, through its protocol, in tiny worlds; truth is looked at only to judge it."""

from __future__ import annotations

from dataclasses import fields

import mujoco
import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.robots.owner import load_description
from palpate.robots.simulated.robot import MujocoRobot
from palpate.trace.samples import Samples

TABLE = 0.4
ARM = load_description()
HOME = ARM.home
BASE = Pose.of([0.0, 0.0, TABLE])
ABOVE = Pose.top_down([0.5, 0.1, TABLE + 0.25], 0.0)
AT = Pose.top_down([0.5, 0.1, TABLE + 0.09], 0.0)


def world(mass: float = 0.254, extra: str = "") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(f"""
    <mujoco>
      <worldbody>
        <body name="table" pos="0.5 0 {TABLE - 0.02}"><geom type="box" size=".3 .4 .02" friction="0.6"/></body>
        <body name="bottle" pos="0.5 0.1 {TABLE + 0.06}">
          <freejoint/><geom type="cylinder" size=".03 .06" mass="{mass}" friction="0.6"/>
        </body>
      </worldbody>
      {extra}
    </mujoco>""")


def robot(**options: object) -> MujocoRobot:
    return MujocoRobot(
        world(**{k: v for k, v in options.items() if k in ("mass", "extra")}),
        BASE,  # type: ignore
        ARM,
        **{k: v for k, v in options.items() if k in ("noise", "seed")},
    )  # type: ignore


def ticks(arm: MujocoRobot, seconds: float) -> Samples:
    arm.drain()
    for _ in range(round(seconds / 0.02)):
        arm.advance(0.02)
    return arm.drain()


def arrive(arm: MujocoRobot, settle: float = 0.6) -> Samples:
    arm.drain()
    arm.advance(0.02)
    while arm.state.moving or arm.state.gripper_moving:
        assert arm.state.t < 60.0
        arm.advance(0.02)
    arm.advance(settle)
    return arm.drain()


def go(arm: MujocoRobot, pose: Pose, speed: float = 0.25) -> Samples:
    arm.move_pose(pose, speed)
    return arrive(arm)


def lift(arm: MujocoRobot) -> None:
    go(arm, ABOVE)
    go(arm, AT, 0.1)
    arm.close_gripper()
    arrive(arm)
    go(arm, ABOVE, 0.15)


@pytest.fixture(scope="module")
def carrying() -> MujocoRobot:
    arm = robot()
    lift(arm)
    return arm


def test_the_arm_rests_at_home_without_force() -> None:
    arm = robot()
    samples = ticks(arm, 0.5)
    assert arm.state.q == pytest.approx(HOME, abs=1e-6)
    assert np.abs(samples.wrench).max() < 1e-6
    assert arm.state.pose_world_tcp.position == pytest.approx(
        [0.3069, 0.0, TABLE + 0.4869], abs=1e-4
    )
    assert not arm.state.moving
    assert arm.state.width == pytest.approx(0.08, abs=1e-4)


def test_the_wrist_turns_the_way_that_its_joint_allows() -> None:
    """200 degrees on, where 160 back would end beyond the last joint's range."""
    arm = robot()
    poses = [ABOVE @ Pose.turn((0.0, 0.0, angle)) for angle in (-1.6, 1.9)]
    for pose in poses:
        joint7 = go(arm, pose).q[:, 6]
        assert arm.state.pose_world_tcp.angle_to(pose) < 0.01
        assert ARM.limits.q_min[6] < joint7.min()
        assert joint7.max() < ARM.limits.q_max[6]


def test_samples_come_at_200_hz_and_only_once() -> None:
    arm = robot()
    samples = ticks(arm, 0.2)
    assert np.diff(samples.t) == pytest.approx(np.full(39, 0.005))
    assert samples.t[-1] == pytest.approx(arm.state.t)
    assert len(arm.drain()) == 0


def test_advance_keeps_time_with_uneven_ticks() -> None:
    arm = robot()
    for _ in range(30):
        arm.advance(1 / 30)
    assert arm.state.t == pytest.approx(1.0, abs=0.0051)
    assert len(arm.world.frames) == pytest.approx(31, abs=1)


def test_a_pose_is_reached_straight_and_below_its_speed() -> None:
    arm = robot()
    start = arm.state.pose_world_tcp.position
    samples = go(arm, Pose.top_down([0.45, 0.2, TABLE + 0.3], 0.6), 0.2)
    state = arm.state
    assert state.pose_world_tcp.distance_to(state.target_world_tcp) < 5e-5
    assert state.pose_world_tcp.angle_to(Pose.top_down([0, 0, 0], 0.6)) < 1e-3
    assert np.linalg.norm(samples.twist[:, :3], axis=1).max() < 0.21
    line = np.array([0.45, 0.2, TABLE + 0.3]) - start
    off = np.linalg.norm(
        np.cross(samples.pose_world_tcp[:, :3] - start, line / np.linalg.norm(line)), axis=1
    )
    assert off.max() < 0.004


def test_joints_are_reached_with_the_tcp_below_a_quarter_metre_per_second() -> None:
    arm = robot()
    q = np.add(HOME, [0.5, 0.2, -0.2, 0.3, 0.1, 0.2, -0.6])
    arm.move_joints(q)
    samples = arrive(arm)
    assert arm.state.q == pytest.approx(q, abs=2e-3)
    assert np.linalg.norm(samples.twist[:, :3], axis=1).max() < 0.26


def test_a_joint_that_turns_steadily_about_the_vertical_takes_no_torque() -> None:
    arm = robot(noise="none")
    arm.move_joints(np.add(HOME, [0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    samples = arrive(arm)
    rate = samples.dq[:, 0]
    steady = (rate > 0.8 * rate.max()) & (np.abs(np.gradient(rate, samples.t)) < 0.05)
    assert steady.sum() > 50
    assert np.abs(samples.tau_ext[steady, 0]).max() < 0.05 * rate.max()


def test_a_held_mass_reads_its_weight(carrying: MujocoRobot) -> None:
    loaded = ticks(carrying, 1.0).wrench[:, 2].mean()
    assert loaded / 9.81 == pytest.approx(0.254, rel=0.003)
    sag = carrying.state.target_world_tcp.position[2] - carrying.state.pose_world_tcp.position[2]
    assert sag == pytest.approx(0.254 * 9.81 / 3000.0, rel=0.02)
    assert carrying.state.gripping
    assert carrying.state.width == pytest.approx(0.06, abs=1e-3)


def test_a_grasped_object_does_not_creep(carrying: MujocoRobot) -> None:
    def held() -> np.ndarray:
        return (
            carrying.world.true_poses(["bottle"])["bottle"].position
            - carrying.world.true_tcp().position
        )

    before = held()
    ticks(carrying, 5.0)
    assert np.abs(held() - before).max() < 3e-4


@pytest.mark.parametrize("mass", [0.02, 1.5])
def test_an_object_comes_back_to_where_it_was(mass: float) -> None:
    arm = robot(mass=mass)
    ticks(arm, 0.3)
    before = arm.world.true_poses(["bottle"])["bottle"]
    lift(arm)
    assert arm.world.true_poses(["bottle"])["bottle"].position[2] > before.position[2] + 0.1
    sag = arm.state.target_world_tcp.position[2] - arm.state.pose_world_tcp.position[2]
    assert sag < 0.008
    go(arm, AT, 0.05)
    arm.open_gripper()
    arrive(arm)
    go(arm, ABOVE)
    after = arm.world.true_poses(["bottle"])["bottle"]
    assert before.distance_to(after) < 5e-4
    assert before.angle_to(after) < np.radians(0.2)


def test_closing_on_nothing_does_not_grip() -> None:
    arm = robot()
    arm.close_gripper()
    assert arm.state.gripper_moving
    arrive(arm)
    assert not arm.state.gripping
    assert 0.0 <= arm.state.width < 0.002
    fingers = [arm.world.data().joint(f"robot/fr3_finger_joint{i}").qpos[0] for i in (1, 2)]
    assert min(fingers) > -3e-4


def test_a_guarded_motion_finds_the_table_and_hold_keeps_the_contact() -> None:
    arm = robot()
    go(arm, Pose.top_down([0.4, -0.1, TABLE + 0.05], 0.3))
    arm.move_axis(np.array([0.0, 0.0, -1.0]), 0.015, 0.1)
    while arm.state.moving and abs(arm.state.wrench[2]) < 8.0:
        arm.advance(0.02)
    assert arm.state.moving, "contact before the travel's end"
    arm.hold()
    arrive(arm)
    assert arm.state.pose_world_tcp.position[2] - arm.hand.tip_offset == pytest.approx(
        TABLE, abs=5e-5
    )
    assert -10.0 < arm.state.wrench[2] < -2.0
    still = arm.state.target_world_tcp.position
    assert ticks(arm, 0.5).target_world_tcp[-1, :3] == pytest.approx(still, abs=1e-12)


def test_hold_stops_a_free_motion_smoothly() -> None:
    arm = robot()
    arm.move_pose(Pose.top_down([0.6, 0.0, TABLE + 0.3], 0.0), 0.25)
    ticks(arm, 0.8)
    speed = np.linalg.norm(arm.state.twist[:3])
    assert speed > 0.08
    arm.hold()
    samples = arrive(arm)
    assert np.abs(samples.twist[-1]).max() < 2e-3
    assert np.abs(np.diff(samples.twist[:, :3], axis=0)).max() / 0.005 < 6.0  # m/s^2


def test_a_new_motion_begins_at_the_commanded_pose_without_a_jump() -> None:
    arm = robot()
    arm.move_pose(Pose.top_down([0.6, 0.0, TABLE + 0.3], 0.0), 0.25)
    ticks(arm, 0.8)
    target = arm.state.target_world_tcp
    arm.move_pose(ABOVE, 0.25)
    samples = ticks(arm, 0.1)
    assert np.linalg.norm(samples.target_world_tcp[0, :3] - target.position) < 0.25 * 0.006


def test_fingers_are_solid_behind_their_pads() -> None:
    block = """<body name="block" pos="0.5 0.058 0.08"><geom type="box" size="0.02 0.005 0.08"/></body>"""
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{block}</worldbody></mujoco>")
    arm = MujocoRobot(spec, Pose.of([0.0, 0.0, 0.0]), ARM)
    go(arm, Pose.top_down([0.5, 0.0, 0.22], 0.0))
    arm.move_pose(Pose.top_down([0.5, 0.0, 0.13], 0.0), 0.02)
    arrive(arm)
    assert arm.state.reflex, "the block stands under a finger, beside its pad"
    assert arm.state.pose_world_tcp.position[2] > 0.16


def test_the_arm_meets_itself() -> None:
    arm = robot()
    arm.move_joints(np.array([0.0, 0.0, 0.0, -3.0, 0.0, 1.0, 0.785]))
    arrive(arm)
    assert arm.state.reflex, "the fingers met the upper arm"
    assert arm.state.q[3] > -2.95


def test_same_seed_same_run_bit_for_bit() -> None:
    runs = []
    for _ in range(2):
        arm = robot(noise="datasheet", seed=7)
        runs.append(go(arm, ABOVE))
    assert all(
        np.array_equal(getattr(runs[0], field.name), getattr(runs[1], field.name))
        for field in fields(Samples)
    )


def test_another_seed_is_another_run() -> None:
    a, b = (ticks(robot(noise="lab", seed=seed), 0.1).wrench for seed in (1, 2))
    assert not np.allclose(a, b)


def test_the_reported_pose_is_off_by_the_repeatability() -> None:
    arm = robot(noise="datasheet", seed=3)
    go(arm, ABOVE)
    off = arm.state.pose_world_tcp.position - arm.world.true_tcp().position
    assert 1e-6 < np.linalg.norm(off) < 5e-4


def test_keyframes_of_the_bare_world_do_not_matter() -> None:
    arm = robot(extra='<keyframe><key name="k" qpos="0.5 0.1 0.5 1 0 0 0"/></keyframe>')
    ticks(arm, 0.1)
    assert arm.state.q == pytest.approx(HOME, abs=1e-6)


def test_a_world_that_holds_another_robot_of_the_name_is_refused() -> None:
    spec = world()
    spec.worldbody.add_body(name="robot/hand")
    with pytest.raises(InputError, match="does not compile"):
        MujocoRobot(spec, BASE, ARM)


def test_the_state_is_cached_until_time_passes() -> None:
    arm = robot()
    assert arm.state is arm.state
    before = arm.state
    arm.advance(0.02)
    assert arm.state is not before


def test_fingers_that_close_gently_press_no_more_than_commanded() -> None:
    arm = robot()
    go(arm, ABOVE)
    go(arm, AT, 0.1)
    arm.close_gripper(10.0)
    arrive(arm)
    gentle = arm.state.width
    assert arm.state.gripping
    assert abs(arm.world.data().actuator("robot/fingers").force[0]) <= 10.0
    arm.close_gripper()
    arrive(arm)
    assert arm.state.gripping
    assert arm.state.width < gentle
    assert abs(arm.world.data().actuator("robot/fingers").force[0]) > 70.0


def test_fingers_that_lose_resistance_keep_their_speed_limit() -> None:
    arm = robot()
    go(arm, ABOVE)
    go(arm, AT, 0.1)
    arm.close_gripper()
    arrive(arm)
    bottle = int(arm.world.model.jnt_qposadr[arm.world.model.body("bottle").jntadr[0]])
    ways: list[float] = []

    def without_the_bottle(data: mujoco.MjData) -> None:
        data.qpos[bottle + 2] = 5.0
        ways.append(float(data.joint("robot/fr3_finger_joint1").qpos[0]))

    arm.world.watch = without_the_bottle
    arm.advance(0.5)
    window = round(0.01 / arm.world.model.opt.timestep)
    speeds = (np.array(ways[:-window]) - np.array(ways[window:])) / 0.01
    assert 0.04 < speeds.max() < 1.2 * ARM.hand.speed
