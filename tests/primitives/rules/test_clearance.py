"""Boxes that meet, and motions that run into things."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from workbench import BOTTLE, bench

from palpate.common.pose import Pose
from palpate.primitives.rules.clearance import (
    Boxes,
    box_hits,
    is_vertical,
    needed_away,
    straddled_object,
)
from palpate.primitives.rules.motion import is_cautious, violations
from palpate.primitives.state import SymbolicState

number = st.floats(-0.2, 0.2)
vectors = st.tuples(number, number, number)
quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(v * v for v in q) > 0.1)
sizes = st.tuples(*[st.floats(0.01, 0.1)] * 3)

LOW = '<body name="low" pos="0.5 0 0.03"><freejoint/><geom type="box" size=".05 .02 .03"/></body>'
ON_TOP = (
    '<body name="top" pos="0.5 0 0.09"><freejoint/><geom type="box" size=".02 .02 .03"/></body>'
)
ASIDE = (
    '<body name="aside" pos="0.5 0.2 0.03"><freejoint/><geom type="box" size=".02 .02 .03"/></body>'
)


def box(pose: Pose, half: tuple[float, ...]) -> Boxes:
    return Boxes(pose.position[None], pose.rotation[None], np.array([half]))


@given(vectors, quaternions, sizes, vectors, quaternions, sizes)
@settings(max_examples=150, deadline=None)
def test_boxes_overlap_when_points_of_one_are_in_the_other_in_either_order(p, q, a, r, s, b):
    first, second = Pose.of(p, q), Pose.of(r, s)
    meet = bool(box(first, a).overlap(box(second, b), 0.0)[0])
    assert meet == bool(box(second, b).overlap(box(first, a), 0.0)[0])
    grid = np.stack(np.meshgrid(*[np.linspace(-h, h, 7) for h in a]), axis=-1).reshape(-1, 3)
    inside = [
        bool(np.all(np.abs(second.inverse().apply(first.apply(point))) < np.array(b) - 1e-6))
        for point in grid
    ]
    assert meet or not any(inside)
    if np.linalg.norm(np.subtract(p, r)) > np.linalg.norm(a) + np.linalg.norm(b):
        assert not meet


@pytest.mark.parametrize(("aside", "so"), [(0.009, True), (0.012, False)])
def test_a_way_is_vertical_to_within_10_mm(aside: float, so: bool) -> None:
    start = Pose.top_down((0.5, 0.0, 0.3), 0.0)
    assert is_vertical(start, start.translate((0.0, aside, -0.2))) == so


@pytest.mark.parametrize(("over", "between"), [(0.003, "bottle"), (0.007, None)])
def test_open_fingers_5_mm_above_a_top_would_grasp_nothing(
    over: float, between: str | None
) -> None:
    state = SymbolicState(bench(BOTTLE), gripper="open")
    assert straddled_object(state, Pose.top_down((0.5, 0.0, 0.16 + over), 0.0)) == between


def test_a_descent_next_to_a_bottle_is_clear_and_one_through_it_is_not():
    state = SymbolicState(bench(BOTTLE))
    grasp = state.scene.symbols.resolve("bottle_pose")
    above = grasp.translate((0, 0, 0.15))
    assert box_hits(state, above, grasp) == []
    shifted = grasp.translate((*(0.045 * grasp.rotation[:2, 1]), 0))
    assert box_hits(state, shifted.translate((0, 0, 0.15)), shifted) == ["bottle"]
    assert box_hits(state, shifted.translate((0, 0, 0.15)), shifted, ignoring=["bottle"]) == []


def test_objects_on_an_object_block_it_and_those_aside_do_not():
    scene = bench(LOW, ON_TOP, ASIDE)
    assert needed_away(scene, ["low"]) == {"top"}
    assert needed_away(scene, ["top", "aside"]) == set()


def test_an_object_on_the_far_end_blocks_the_lift():
    plank = '<body name="plank" pos="0.5 0 0.01"><freejoint/><geom type="box" size=".015 .2 .01"/></body>'
    weight = '<body name="weight" pos="0.5 0.17 0.04"><freejoint/><geom type="box" size=".02 .02 .02"/></body>'
    assert needed_away(bench(plank, weight), ["plank"]) == {"weight"}
    aside = weight.replace("0.5 0.17", "0.55 0.17")
    assert needed_away(bench(plank, aside), ["plank"]) == set()


@pytest.mark.parametrize(("along", "pushes"), [("x", False), ("y", True)])
def test_open_fingers_leave_an_object_along_themselves_or_straight_up(
    along: str, pushes: bool
) -> None:
    """Across, a finger pushes it over; a planner that takes no risk goes up either way."""
    state = SymbolicState(bench(BOTTLE), gripper="open")
    grasp = state.scene.symbols.resolve("bottle_pose")
    way = 0.15 * grasp.rotation[:, "xy".index(along)]
    before = replace(state, at="bottle_pose", pose_world_tcp=grasp)
    after = replace(before, at="away", pose_world_tcp=grasp.translate(tuple(way)))
    said = [one.message for one in violations(before, after)]
    first = "it is between the fingers; MovePose to 'bottle_pose + z_offset' first"
    assert [message.endswith(first) for message in said] == [True] * pushes
    assert not is_cautious(before, after)
    up = replace(before, at="up", pose_world_tcp=grasp.translate((0.0, 0.0, 0.15)))
    assert is_cautious(before, up)


@pytest.mark.parametrize(("overlap", "met"), [(0.001, False), (0.005, True)])
def test_a_carried_object_hits_bodies_that_it_would_overlap(overlap: float, met: bool) -> None:
    state = SymbolicState(bench(BOTTLE, ASIDE))
    grasp = state.scene.symbols.resolve("bottle_pose")
    held = grasp.inverse() @ state.pose_of("bottle")
    carried = replace(state, gripper="closed", holding="bottle", pose_tcp_object=held)
    beside = grasp.translate((0.0, 0.15 + overlap, 0.0))
    assert box_hits(carried, beside, beside.translate((0.0, 0.0, 0.01))) == ["aside"] * met
