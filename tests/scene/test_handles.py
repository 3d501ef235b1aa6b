"""Grasps of handles: from above where there is room, else level, from the front."""

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.primitives.gripper import OpenGripper
from palpate.primitives.handle import MoveHandle
from palpate.primitives.motion import MoveJoints, MovePose
from palpate.primitives.state import SymbolicState
from palpate.scene.handle_grasps import points_down
from palpate.scene.scene import Scene

DRAWER = """<mujoco><worldbody>
  <geom type="plane" size="2 2 .1"/>
  <site name="robot_base"/>
  <body name="cabinet" pos="0.95 0 0.4"><geom type="box" size=".1 .2 .15"/>
    <body name="drawer" pos="-0.12 0 0" euler="0 0 {yaw}">
      <joint type="slide" axis="-1 0 0" range="0 .2" damping="?"/>
      <geom name="front" type="box" size=".01 .12 .08" mass=".5"/>
      <geom name="handle" type="box" size=".008 {half} .008" pos="-0.05 0 -0.03" mass=".1"/>
    </body>
  </body>
</worldbody></mujoco>"""


def scene(half: float = 0.06, yaw: float = 0.0) -> Scene:
    return pp.load(DRAWER.format(half=half, yaw=yaw))


def test_a_bar_before_a_higher_front_is_grasped_from_the_front():
    """The hand is level, its fingers close up and down, and its way back is straight out."""
    symbols = scene().symbols
    pose, back = symbols.resolve("drawer_pose"), symbols.resolve("drawer_pose + z_offset")
    assert pose.rotation[:, 2] == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    assert abs(pose.rotation[2, 1]) == pytest.approx(1.0, abs=1e-6)
    assert back.position - pose.position == pytest.approx([-0.12, 0.0, 0.0], abs=1e-6)
    assert {"drawer_level", "drawer_front"} < set(symbols.configurations)
    assert "drawer" not in symbols.ungraspable


def test_a_level_hand_follows_a_rotated_drawer():
    pose = scene(yaw=10.0).symbols.resolve("drawer_pose")
    expected = [np.cos(np.radians(10.0)), np.sin(np.radians(10.0)), 0.0]
    assert pose.rotation[:, 2] == pytest.approx(expected, abs=0.01)


def test_a_knob_is_grasped_from_above():
    """It is narrower than the fingers open, which close beside it along the front."""
    symbols = scene(half=0.01).symbols
    assert points_down(symbols.resolve("drawer_pose"))
    assert "drawer_front" not in symbols.configurations


def test_the_wrist_is_turned_before_the_arm_is_moved():
    """A straight way would fold the wrist, and a joint motion to the front at once pass where no contact is felt."""
    known = scene()
    plan = known.plan(measure=["drawer.damping"])
    assert plan.tree is not None
    joints = [
        dict(node.args)["joints"] for _, node in plan.tree.walk() if node.type == "MoveJoints"
    ]
    assert joints == ["home_config", "drawer_level", "drawer_front", "drawer_level", "home_config"]
    state = SymbolicState(known)
    for primitive in (MoveJoints(joints="home_config"), OpenGripper()):
        state = state.after(primitive)
    (first,) = MovePose(pose="drawer_pose").requires(state)
    assert "the hand is not level; MoveJoints 'drawer_level'" in first.message
    (second,) = MoveJoints(joints="drawer_front").requires(state)
    assert "the wrist turns before the arm" in second.message
    level, front = (known.symbols.joints(f"drawer_{place}") for place in ("level", "front"))
    for share, felt in ((0.4, True), (0.7, False)):
        there = MoveJoints(joints=(level + share * (front - level)).tolist())
        assert (there.requires(state) == []) == felt


def test_the_arm_is_not_folded_again_on_the_way():
    """Half a metre nearer, the level hand would be too near to the arm's own shoulder."""
    near = pp.load(DRAWER.format(half=0.06, yaw=0.0).replace('pos="0.95', 'pos="0.62'))
    plan = near.plan(measure=["drawer.damping"])
    assert plan.tree is None
    assert "leave no room for the hand, from above or from its front" in plan.explanation


def test_a_grasp_of_poses_yaml_has_a_front_of_its_own(tmp_path: Path):
    """At a knob, too, which a hand from above would take."""
    poses = tmp_path / "poses.yaml"
    poses.write_text("grasps: {drawer: {pos: [-0.05, 0, -0.03], quat: [0.5, 0.5, 0.5, 0.5]}}")
    known = pp.load(DRAWER.format(half=0.01, yaw=0.0), poses=poses)
    assert "drawer_front" in known.symbols.configurations
    state = SymbolicState(known)
    way = ("home_config", "drawer_level", "drawer_front")
    for primitive in (*(MoveJoints(joints=name) for name in way), OpenGripper()):
        assert not primitive.requires(state)
        state = state.after(primitive)
    state = state.after(MovePose(pose="drawer_pose"))
    assert not MoveHandle().requires(state)
