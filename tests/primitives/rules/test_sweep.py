"""Sweep of a motion: its shares near things, and its hits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from workbench import BOTTLE, bench

from palpate.common.pose import Frames, Pose
from palpate.primitives.rules.clearance import ArmPath, joint_path, straight_path
from palpate.primitives.rules.collision_geometry import arm_sweep, near_spans
from palpate.primitives.rules.grip import grip
from palpate.primitives.rules.solids import solids
from palpate.primitives.rules.sweep import Sweep
from palpate.primitives.state import SymbolicState

BESIDE_NOTHING = '<site name="middle"/>'
OPEN = SymbolicState(bench(BOTTLE, BESIDE_NOTHING), gripper="open")
GRASP = OPEN.scene.symbols.resolve("bottle_pose")
ABOVE = GRASP.translate((0, 0, 0.20))


def swept(state: SymbolicState, start: Pose, end: Pose, growth: float) -> Sweep:
    """The straight way, the arm bent as its controller would."""
    shapes = solids(state.scene)
    q = (shapes.configuration(start), shapes.configuration(end))
    width = shapes.scene.arm.hand.opening
    return arm_sweep(state, straight_path(shapes, start, end, q, width), growth)


def met(
    state: SymbolicState, start: Pose, end: Pose, margin: float = 0.002, growth: float = 0.002
) -> set[str]:
    """Owners of what is hit on the straight way."""
    found = swept(state, start, end, growth)
    return {hit.other.owner for hit in found.hits(np.full(len(found.pairs), margin))}


def test_the_last_part_of_a_descent_alone_is_near_the_object() -> None:
    ((first, last),) = near_spans(OPEN, ABOVE, GRASP, 0.02)
    # The fingertips, 9 mm below the TCP, come to within 20 mm of the top 165 to 175 mm above it.
    assert 0.6 < first < 0.75
    assert last == 1.0


def test_a_way_through_free_air_is_near_nothing_and_growth_finds_more() -> None:
    aside = ABOVE.translate((0, 0.2, 0))
    assert near_spans(OPEN, ABOVE, aside, 0.05) == ()
    assert near_spans(OPEN, ABOVE, aside, 0.3) == ((0.0, 1.0),)


def test_an_object_next_to_the_path_is_near_while_the_hand_passes_it() -> None:
    low = GRASP.translate((-0.20, 0, 0)), GRASP.translate((0.20, 0, 0))
    ((first, last),) = near_spans(
        OPEN, low[0].translate((0, 0.1, 0)), low[1].translate((0, 0.1, 0)), 0.03
    )
    assert 0.2 < first < 0.5 < last < 0.8


def test_an_object_in_the_hand_is_near_what_it_stands_on() -> None:
    held = OPEN.pose_of("bottle")
    state = SymbolicState(OPEN.scene, holding="bottle", pose_tcp_object=GRASP.inverse() @ held)
    ((first, last),) = near_spans(state, GRASP, ABOVE, 0.03)
    assert first == 0.0
    assert 0.1 < last < 0.25


@pytest.mark.parametrize(
    ("across", "expected"), [(0.0, set()), (0.047, {"bottle"}), (-0.047, {"bottle"})]
)
def test_a_finger_that_comes_down_on_a_top_hits_it(across: float, expected: set[str]) -> None:
    shift = across * GRASP.rotation[:, 1]
    assert met(OPEN, ABOVE.translate(shift), GRASP.translate(shift)) == expected


@pytest.mark.parametrize("across", [0.0, 0.02, 0.047])
def test_the_way_back_comes_as_near_at_the_same_places(across: float) -> None:
    shift = across * GRASP.rotation[:, 1]
    above, grasp = ABOVE.translate(shift), GRASP.translate(shift)
    there, back = swept(OPEN, above, grasp, 0.02), swept(OPEN, grasp, above, 0.02)
    np.testing.assert_array_equal(back.near(0.02), there.near(0.02)[::-1])
    assert there.near(0.02).any()
    assert not there.near(0.02).all()


@pytest.mark.parametrize("growth", [0.05, 10.0])
def test_bodies_excluded_by_boxes_are_not_hit(growth: float) -> None:
    start, end = ABOVE.translate((0, 0.047, 0)), GRASP.translate((0.1, 0.2, -0.13))
    assert met(OPEN, start, end, growth=growth) == met(OPEN, start, end)


def test_the_arm_itself_is_swept_and_not_only_the_hand() -> None:
    # The hand reaches over a tall wall that the forearm does not clear.
    wall = '<geom name="wall" type="box" pos="0.25 0 0.3" size=".01 .3 .3"/>'
    state = SymbolicState(bench(BOTTLE, wall), gripper="open")
    assert "wall" in met(state, ABOVE, GRASP)


@pytest.mark.parametrize(
    ("q", "met"),
    [
        ((2.24, 1.57, -0.82, -3.03, -1.01, 2.92, -0.98), "fr3_link1"),
        ((2.71, 1.41, 1.85, -3.03, -1.52, 3.77, 2.56), "fr3_link2"),
    ],
)
def test_the_arm_folded_meets_itself(q: tuple[float, ...], met: str) -> None:
    """The fifth link, four and three joints away."""
    folded = joint_path(solids(OPEN.scene), np.array(q), np.array(q), width=0.0)
    (hit,) = arm_sweep(OPEN, folded, 0.0).overlaps()
    assert (hit.part.owner, hit.other.owner) == ("fr3_link5", met)


def test_static_bodies_are_hit_too() -> None:
    assert met(OPEN, ABOVE, GRASP.translate((0.1, 0.2, -0.13))) >= {"bench"}


def test_grip_is_the_contact_of_the_pads_with_the_object_between_them() -> None:
    shapes, body = solids(OPEN.scene), OPEN.pose_of("bottle")
    taken = grip(shapes, "bottle", GRASP.inverse() @ body)
    assert taken is not None
    assert taken.width == pytest.approx(0.06, abs=0.001)
    assert taken.aside == pytest.approx(0.0, abs=0.001)
    # 40 mm along the tool's x the pads close beside it, and 15 mm above its top over it.
    beside = GRASP.translate(0.040 * GRASP.rotation[:, 0])
    over = GRASP.translate((0, 0, 0.050))
    assert grip(shapes, "bottle", beside.inverse() @ body) is None
    assert grip(shapes, "bottle", over.inverse() @ body) is None


def test_all_intervals_are_halved_at_once() -> None:
    # Along the bottle's side, a few millimetres from it all the way.
    beside = GRASP.translate((0.0, 0.13, 0.0))
    found = swept(OPEN, beside.translate((0, 0, 0.03)), beside.translate((0.03, 0, 0)), 0.12)
    placed: list[int] = []

    def place(path: ArmPath) -> Frames:
        placed.append(path.count)
        return found.place(path)

    counted = replace(found, place=place)
    distances = [hit.distance for hit in counted.hits(np.full(len(found.pairs), 0.06))]
    assert not distances or max(distances) < 0.06
    assert sum(placed[1:]) > 2 * len(placed)
    assert len(placed) < 8


def test_quaternions_of_opposite_sign_are_one_rotation_on_a_way() -> None:
    one = np.array([np.cos(0.2), np.sin(0.2), 0.0, 0.0])
    path = ArmPath(np.zeros((2, 3)), np.array([one, -one]), np.zeros(2))
    np.testing.assert_allclose(np.abs(path.between(np.array([0.5])).quaternions @ one), 1.0)


def test_objects_of_the_same_shapes_are_alike() -> None:
    box = '<body name="{0}" pos="{1} 0.3 0.5"><freejoint/><geom type="box" size="{2} 0.02 0.03"/></body>'
    scene = bench(
        *(box.format(*each) for each in (("a", 0.4, 0.02), ("b", 0.5, 0.02), ("c", 0.6, 0.021)))
    )
    assert solids(scene).alike == {"a": "a", "b": "a", "c": "c"}
