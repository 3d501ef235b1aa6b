"""A camera that goes on looking while a plan runs: what moved, and was not meant to, ends the run."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from palpate.common.errors import InputError, Unavailable
from palpate.execution.simulated_cell import simulated_cell
from palpate.perception.look import Seen
from palpate.perception.renderer import gl_available
from palpate.primitives.base import Blackboard, LeafFailure, keep_state
from palpate.primitives.state import SymbolicState
from palpate.runs.executing import CameraWatch, eye, iter_displacements, watch_state
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

SCENE = """<mujoco><worldbody>
<camera name="over" pos="0.9 -0.5 1.1" xyaxes="0.6 0.8 0 -0.45 0.35 0.8" fovy="45"/>
<body name="table" pos="0.5 0 0.38"><geom type="box" size=".4 .4 .02"/>
  <site name="tag_0" pos="-.15 -.25 .02" size=".03"/><site name="tag_1" pos="-.15 .25 .02" size=".03"/>
  <site name="tag_2" pos=".25 .25 .02" size=".03"/></body>
<body name="box" pos="0.45 0.05 0.43"><freejoint/>
  <geom type="box" size=".03 .03 .03" mass=".1"/><site name="tag_7" pos="0 0 .03" size=".02"/></body>
<body name="cup" pos="0.45 -0.12 0.45"><freejoint/>
  <geom type="cylinder" size=".03 .05" mass=".2"/><site name="tag_9" pos="0 0 .0502" size=".02"/></body>
</worldbody></mujoco>"""
SURE = 1e-6 * np.eye(6)
"""1 mm and 1 mrad (1 sigma) a pose."""


@cache
def scene() -> Scene:
    return parse_scene(SCENE)


def seen(name: str = "cup", way: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Seen:
    pose = scene().body(name).pose_world.translate(way)
    return Seen({name: pose}, {name: SURE}, (), (), 0.3)


def blackboard(state: SymbolicState, motions: int = 1, t: float = 0.0) -> Blackboard:
    robot = SimpleNamespace(state=SimpleNamespace(t=t))
    return cast(Blackboard, SimpleNamespace(state=state, motions=motions, robot=robot))


def away() -> SymbolicState:
    """The empty, open hand in free air."""
    above = scene().symbols.resolve("box_pose + z_offset")
    return SymbolicState(scene(), at="box_pose + z_offset", pose_world_tcp=above, gripper="open")


def test_a_pushed_neighbour_ends_the_run_by_name() -> None:
    watch = CameraWatch(keep_state, lambda: seen(way=(0.03, 0.0, 0.0)))
    text = (
        r"'cup' is seen at \(0\.480, -0\.120, 0\.450\) m, 30 mm from where it is believed, and 8 mm"
    )
    with pytest.raises(LeafFailure, match=text):
        watch("tree", blackboard(away()))


@pytest.mark.parametrize("far", [0.0, 0.0078, 0.0082])
def test_a_change_within_the_accuracy_of_sight_is_no_motion(far: float) -> None:
    """5 mm and three deviations of 1 mm."""
    rows = [*iter_displacements(away(), seen(way=(0.0, far, 0.0)))]
    assert bool(rows) == (far > 0.008)


def test_an_object_moved_by_the_run_is_expected_at_its_new_place() -> None:
    there = scene().body("cup").pose_world.translate((0.1, 0.0, 0.0))
    state = replace(away(), moved={"cup": there})
    assert not [*iter_displacements(state, seen(way=(0.1, 0.0, 0.0)))]
    assert [*iter_displacements(state, seen())]


def test_an_object_corrected_by_touch_may_be_at_its_seen_pose() -> None:
    """A camera 20 mm off sees everything there, every time."""
    nearer = scene().body("cup").pose_world.translate((0.004, 0.0, 0.0))
    state = replace(away(), moved={"cup": nearer})
    assert not [*iter_displacements(state, seen(way=(-0.006, 0.0, 0.0)))]


def test_the_camera_does_not_look_while_the_hand_holds_or_touches() -> None:
    def unasked() -> Seen:
        raise AssertionError

    watch, at_box = CameraWatch(keep_state, unasked), scene().symbols.resolve("box_pose")
    busy = [
        replace(away(), holding="box"),
        replace(away(), activity="contact"),
        replace(away(), at="box_pose", pose_world_tcp=at_box),
    ]
    for state in busy:
        assert watch("tree", blackboard(state)) is state
    assert watch("tree", blackboard(away(), motions=2)) is not None


def test_looks_are_some_seconds_apart() -> None:
    looks: list[float] = []
    watch = CameraWatch(keep_state, lambda: looks.append(now))
    for now in (2.0, 4.0, 6.9, 7.1, 9.0):
        watch("tree", blackboard(away(), t=now))
    assert looks == [2.0, 7.1]


def test_a_camera_that_stopped_ends_the_run_and_an_arm_before_it_does_not() -> None:
    def stopped() -> Seen:
        raise Unavailable("the camera '0' gives no picture any more")

    with pytest.raises(LeafFailure, match="no picture any more"):
        CameraWatch(keep_state, stopped)("tree", blackboard(away()))
    state = away()
    assert CameraWatch(keep_state, lambda: None)("tree", blackboard(state)) is state


def test_a_run_without_a_live_camera_watches_nothing() -> None:
    assert watch_state(keep_state, None) is keep_state
    for camera in (None, "desk.png", "desk.MP4"):
        assert eye(_planned(camera), cast(Any, None)) is None
    with pytest.raises(InputError, match="intrinsics"):
        eye(_planned("opencv:0"), cast(Any, None))


def _planned(camera: str | None) -> Run:
    settings = Settings(camera=camera, seed=1)
    return cast(Run, SimpleNamespace(scene=scene(), settings=settings))


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_the_simulated_camera_sees_a_pushed_neighbour() -> None:
    pytest.importorskip("cv2")
    pushed = parse_scene(scene().text.replace("0.45 -0.12", "0.48 -0.12"))
    cell = simulated_cell(scene(), pushed, seed=1)
    robot, see = cell.robot(), eye(_planned("world:over"), cell)
    robot.close()
    assert see is not None
    sight = see()
    assert sight is not None
    (text,) = iter_displacements(away(), sight)
    assert text.startswith("'cup' is seen at (0.4")
    assert np.linalg.norm(sight.poses["cup"].position - [0.48, -0.12, 0.45]) < 0.004
