"""Room for what a covariance of poses.yaml says: opening of a grasp, clearance beside things, guarded spans."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.primitives.rules.collision import collisions
from palpate.primitives.rules.profile import spans
from palpate.primitives.state import SymbolicState
from palpate.scene.load import parse_scene
from palpate.scene.poses import Poses
from palpate.scene.scene import Scene

CELL = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="box" pos="0.5 0 0.03"><freejoint/><geom type="box" size=".030 .034 .03" mass=".3"/></body>
  <body name="can" pos="{can} 0 0.02"><freejoint/><geom type="cylinder" size=".02 .02" mass=".3"/></body>
</worldbody></mujoco>"""
PLACES = {"box": (0.5, 0.0, 0.03), "can": (0.8, 0.0, 0.02)}


@cache
def cell(name: str = "", stds: tuple[float, float] = (0.0, 0.0), can: float = 0.8) -> Scene:
    """The scene, with the pose of one object stated to standard deviations along world x and y, m."""
    x, y, z = PLACES[name or "box"]
    x = can if name == "can" else x
    spread = np.diag(np.square([*stds, 1e-3, 0.01, 0.01, 0.01])).tolist()
    entry = {"pos": (x, y, z), "source": "seen", "covariance": spread}
    poses = Poses.model_validate({"objects": {name: entry}} if name else {})
    return parse_scene(CELL.format(can=can), poses=poses)


def closing(scene: Scene) -> np.ndarray:
    """(2,) absolute level direction in which the fingers close on the box."""
    return np.abs(scene.symbols.pose("box_pose").rotation[:2, 1])


def test_a_grasp_is_where_the_hand_opens_wide_enough_for_three_deviations() -> None:
    """The box is 60 mm wide along x and 68 along y, and the hand opens 80: 10 and 6 mm to either side."""
    narrow = np.array([1.0, 0.0])
    assert closing(cell()) == pytest.approx(narrow, abs=1e-6)
    assert closing(cell("box", (0.003, 0.0005))) == pytest.approx(narrow, abs=1e-6)
    assert closing(cell("box", (0.005, 0.0005))) == pytest.approx([0.0, 1.0], abs=1e-6)
    both = cell("box", (0.02, 0.02))  # nowhere: as much room as there is
    assert closing(both) == pytest.approx(narrow, abs=1e-6)
    assert not both.symbols.ungraspable


@pytest.mark.parametrize(("std", "blocked"), [(0.0, False), (0.001, False), (0.004, True)])
def test_a_neighbour_is_passed_by_three_deviations(std: float, blocked: bool) -> None:
    """Beside the open finger stands a can, 8 mm off."""
    hand = cell().arm.hand
    there = 0.5 + hand.opening / 2 + hand.finger + 0.008 + 0.02
    scene = cell("can" if std else "", (std, std), there)
    grasp = cell().symbols.pose("box_pose")
    above = SymbolicState(scene, pose_world_tcp=grasp.translate((0, 0, 0.12)), gripper="open")
    after = replace(above, at="box_pose", pose_world_tcp=grasp)
    assert bool(collisions(above, after)) is blocked


def test_a_motion_is_guarded_in_the_region_where_an_object_may_be() -> None:
    start, end = Pose.top_down((0.41, -0.2, 0.08), 0.0), Pose.top_down((0.41, 0.2, 0.08), 0.0)

    def guarded(scene: Scene) -> float:
        way = spans(SymbolicState(scene, gripper="open"), start, end)
        return sum(one.start.distance_to(one.end) for one in way if one.guarded)

    assert guarded(cell()) == guarded(
        cell("box", (0.005, 0.005))
    )  # 15 mm are within what any pose may be off
    assert guarded(cell("box", (0.02, 0.02))) > guarded(cell()) + 0.02


def test_a_place_is_as_unsure_as_along_the_direction_that_is_asked_for() -> None:
    body = cell("box", (0.004, 0.001)).body("box")
    assert body.std(np.array([1.0, 0.0, 0.0])) == pytest.approx(0.004)
    assert body.std(np.array([0.0, 1.0, 0.0])) == pytest.approx(0.001)
    assert body.doubt == pytest.approx(0.012)
    stated = Poses.model_validate({"accuracy": 0.002})
    plain = parse_scene(CELL.format(can=0.8), poses=stated).body("box")
    assert (plain.std(np.array([1.0, 0.0, 0.0])), plain.doubt) == (0.002, 0.0)
