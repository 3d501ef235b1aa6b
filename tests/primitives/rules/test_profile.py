"""Motion profile: slow near things, by belief, and the same with an object as without."""

from __future__ import annotations

from dataclasses import replace

import pytest
from performing import CELL

from palpate.common.pose import Pose
from palpate.primitives.guarding import MEDIAN_TIME
from palpate.primitives.rules.profile import (
    GUARDED_SPEED,
    PathSpan,
    between,
    spans,
    speed,
    stretches,
)
from palpate.primitives.state import SymbolicState
from palpate.scene.load import parse_scene

WALL = '<body name="wall" pos="0.5 0.16 0.2"><geom type="box" size=".2 .01 .2"/></body>'


@pytest.fixture
def ways(start):
    """The cup's grasp pose, and the pose above it."""
    resolve = start.scene.symbols.resolve
    return resolve("cup_pose + z_offset"), resolve("cup_pose")


def lengths(parts: list[PathSpan]) -> list[tuple[int, bool]]:
    """(mm, guarded) of each part."""
    return [(round(1e3 * part.start.distance_to(part.end)), part.guarded) for part in parts]


def test_a_way_ends_slowly_where_something_is_grasped(start, ways) -> None:
    above, grasp = ways
    parts = list(spans(replace(start, gripper="open"), above, grasp))
    assert [part.guarded for part in parts] == [False, True]
    assert parts[0].start.distance_to(above) == parts[-1].end.distance_to(grasp) == 0.0
    near = sum(part.start.distance_to(part.end) for part in parts if part.guarded)
    assert 0.05 < near < 0.09, "the tips are near the cup's top from 20 mm above it on"


def test_a_way_up_is_free_after_the_lift_off(start, ways) -> None:
    above, grasp = ways
    parts = list(spans(replace(start, gripper="open"), grasp, above))
    assert [part.guarded for part in parts] == [True, False]
    assert 0.008 < parts[0].start.distance_to(parts[0].end) < 0.015


def test_a_path_up_along_a_wall_is_free_as_far_as_the_hand_came_down(start, ways) -> None:
    _, grasp = ways
    text = CELL.format(cup="0.5 0.1 0.05", table=-0.03, mass="")
    scene = parse_scene(text.replace("</worldbody>", WALL + "</worldbody>"))
    beside = SymbolicState(scene, gripper="open")
    parts = list(spans(beside, grasp, grasp.translate((0.0, 0.0, 0.2))))
    assert lengths(parts) == [(10, True), (90, False), (100, True)]


def test_a_free_stretch_too_short_for_a_speed_of_its_own_is_slow(start, ways) -> None:
    """Between two posts beside the way."""
    post = '<body name="post{0}" pos="{0} 0.1 0.2"><geom type="box" size=".01 .01 .2"/></body>'
    _, grasp = ways
    free: set[int] = set()
    for apart in range(110, 170, 5):
        posts = post.format(0.35) + post.format(0.35 + 1e-3 * apart)
        scene = parse_scene(f"<mujoco><worldbody>{posts}</worldbody></mujoco>")
        first, last = (
            Pose.of((x, -0.03, 0.3), grasp.quaternion) for x in (0.35, 0.35 + 1e-3 * apart)
        )
        parts = lengths(list(spans(SymbolicState(scene, gripper="closed"), first, last)))
        assert parts[0][1]
        free |= {length for length, guarded in parts if not guarded}
    assert 15 <= min(free) <= 25


def test_the_profile_is_the_same_with_the_object_and_without(start, ways) -> None:
    above, grasp = ways
    empty = replace(start, gripper="open")
    held = replace(
        start,
        gripper="closed",
        holding="cup",
        pose_tcp_object=grasp.inverse() @ start.pose_of("cup"),
        lifted=True,
    )
    for one, other in ((above, grasp), (grasp, above)):
        assert lengths(list(spans(empty, one, other))) == lengths(list(spans(held, one, other)))


def test_high_above_everything_a_way_is_free(start, ways) -> None:
    above, _ = ways
    high = above.translate((0.0, 0.0, 0.2))
    (part,) = spans(start, high, high.translate((0.0, -0.2, 0.0)))
    assert not part.guarded
    assert speed(part, start.scene) == start.scene.arm.pace.speed


def test_the_speed_near_bodies_follows_the_effective_mass(start, ways) -> None:
    _, grasp = ways
    nearer = Pose.top_down((0.35, 0.0, grasp.position[2]), 0.0)
    slow, heavy = (
        speed(PathSpan(pose, pose.translate((0.0, 0.0, -0.03)), True), start.scene)
        for pose in (grasp, nearer)
    )
    assert 0.01 < heavy < slow
    aside = speed(PathSpan(grasp, grasp.translate((0.0, 0.03, 0.0)), True), start.scene)
    assert aside * MEDIAN_TIME <= 0.003 + 1e-9, (
        "it goes 3 mm in the time until a contact is certain"
    )
    assert speed(PathSpan(grasp, grasp, True), start.scene) == GUARDED_SPEED


def test_robot_gets_all_stretches_in_one_command(start, ways) -> None:
    above, grasp = ways
    parts = list(spans(replace(start, gripper="open"), above, grasp))
    free, near = stretches(parts, start.scene)
    assert near.end == pytest.approx(1.0)
    assert free.end == pytest.approx(above.distance_to(parts[0].end) / above.distance_to(grasp))
    assert free.speed > near.speed


def test_a_pose_between_turns_evenly(start, ways) -> None:
    above, grasp = ways
    middle = between(start, above, grasp, 0.5)
    assert middle.distance_to(above) == pytest.approx(above.distance_to(grasp) / 2)
    assert between(start, above, grasp, 1.0) is grasp


def test_the_hand_turns_as_far_round_as_the_wrist_does(start, ways) -> None:
    """By 200 degrees on, which is 160 the other way round: the last joint cannot."""
    above, _ = ways
    first, last = (above @ Pose.turn((0, 0, angle)) for angle in (-1.6, 1.9))
    middle = between(start, first, last, 0.5)
    assert middle.angle_to(first) == pytest.approx(1.75, abs=1e-6)
    assert middle.angle_to(above) < 0.5
