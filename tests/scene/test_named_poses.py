"""Grasps, approaches, free places and offsets from geometry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.common.errors import InputError
from palpate.robots.owner import load_description
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

ARM = load_description()
TABLE = '<body name="table" pos="0.5 0 0.38"><geom type="box" size="0.3 0.5 0.02"/></body>'


def scene(world: str, poses: str | None = None) -> Scene:
    return parse_scene(f"<mujoco><worldbody>{TABLE}{world}</worldbody></mujoco>", poses=poses)


def thing(
    name: str, geom: str, x: float = 0.5, y: float = 0.0, half: float = 0.03, yaw: float = 0
) -> str:
    return (
        f'<body name="{name}" pos="{x} {y} {0.4 + half}" euler="0 0 {yaw}"><freejoint/>'
        f"{geom if geom.startswith('<') else f'<geom {geom}/>'}</body>"
    )


def box(x: float, y: float, z: float) -> str:
    return f'type="box" size="{x} {y} {z}"'


@given(
    st.floats(0.01, 0.036),
    st.floats(0.04, 0.15),
    st.floats(0.008, 0.15),
    st.floats(0, 360),
    st.floats(-0.3, 0.3),
)
@settings(max_examples=60, deadline=None)
def test_a_box_is_taken_across_its_narrow_side(
    narrow: float, long: float, half: float, yaw: float, y: float
) -> None:
    model = scene(thing("b", box(long, narrow, half), y=y, half=half, yaw=yaw))
    pose = model.symbols.resolve("b_pose")
    body = model.objects["b"]
    assert model.symbols.ungraspable == {}
    assert abs(pose.rotation[:, 1] @ body.pose_world.rotation[:, 1]) == pytest.approx(1), (
        "closes on its faces"
    )
    assert pose.rotation[2, 2] == pytest.approx(-1), "from above"
    assert pose.position[:2] == pytest.approx(body.pose_world.position[:2], abs=1e-6), (
        "in its middle"
    )
    bottom, top = body.bottom_z(), body.top_z()
    assert pose.position[2] - ARM.tip >= bottom + 0.004, "fingertips clear of the support"
    assert pose.position[2] <= max(top - 0.002, bottom + 0.016), "pads on the object"
    assert top - (pose.position[2] - ARM.tip) >= min(0.02, top - bottom - 0.006)
    assert top - pose.position[2] <= 0.036, "the palm stays above it"


def test_the_wrist_turns_the_short_way() -> None:
    for yaw in range(0, 360, 30):
        model = scene(thing("b", box(0.05, 0.02, 0.03), y=0.2, yaw=yaw))
        tool = model.symbols.resolve("b_pose").rotation[:, 0]
        azimuth = np.array([0.5, 0.2, 0]) / np.hypot(0.5, 0.2)
        assert tool @ azimuth >= -1e-6


def test_low_tall_and_round_objects_have_grasps() -> None:
    flat = scene(thing("b", box(0.03, 0.03, 0.01), half=0.01)).symbols.resolve("b_pose").position[2]
    assert flat == pytest.approx(0.414)
    tall = scene(thing("b", box(0.03, 0.03, 0.1), half=0.1)).symbols.resolve("b_pose").position[2]
    assert tall == pytest.approx(0.6 - 0.0324)
    ball = scene(thing("b", 'size="0.03"')).symbols.resolve("b_pose")
    assert ball.position == pytest.approx([0.5, 0, 0.43], abs=1e-4)
    assert ball.rotation[:, 0] == pytest.approx([1, 0, 0], abs=1e-6)
    lying = scene(
        thing("b", 'type="cylinder" size="0.03 0.1" euler="0 90 0"', yaw=40)
    ).symbols.resolve("b_pose")
    across = [-np.sin(np.deg2rad(40)), np.cos(np.deg2rad(40)), 0]
    assert abs(lying.rotation[:, 1] @ across) == pytest.approx(1, abs=1e-3)


def test_a_bottle_is_held_by_its_neck() -> None:
    bottle = '<geom type="cylinder" size="0.045 0.06"/><geom type="cylinder" size="0.015 0.03" pos="0 0 0.09"/>'
    model = scene(thing("bottle", bottle, half=0.06))
    assert model.symbols.ungraspable == {}
    assert model.symbols.resolve("bottle_pose").position[2] == pytest.approx(0.58 - 0.0324)


HAMMER = '<geom type="box" size="0.14 0.0125 0.0125"/><geom type="box" size="0.02 0.05 0.0125" pos="0.15 0 0"/>'


def test_a_hammer_is_taken_by_its_handle_with_offsets_that_stay_on_it() -> None:
    model = scene(thing("hammer", HAMMER, half=0.0125, yaw=30))
    to_hammer = model.objects["hammer"].pose_world.inverse()
    reach = [
        to_hammer.apply(model.symbols.resolve(f"hammer_pose + {k}*x_offset").position)
        for k in (-2, -1, 0, 1, 2)
    ]
    assert all(abs(point[1]) < 1e-4 for point in reach)
    along = np.array([point[0] for point in reach])
    assert along.min() > -0.14
    assert along.max() < 0.13
    assert abs(np.diff(along)).min() > 0.04


@pytest.mark.parametrize(
    ("geom", "half", "reason"),
    [
        (box(0.06, 0.06, 0.05), 0.05, "120 mm"),
        (box(0.03, 0.03, 0.002), 0.002, "too flat"),
    ],
)
def test_objects_that_the_hand_cannot_grasp_have_a_reason(
    geom: str, half: float, reason: str
) -> None:
    model = scene(thing("b", geom, half=half))
    assert reason in model.symbols.ungraspable["b"]
    assert model.symbols.resolve("b_pose").position[:2] == pytest.approx([0.5, 0], abs=1e-6)


def test_a_neighbour_decides_between_two_directions() -> None:
    cube = box(0.025, 0.025, 0.03)
    free = scene(thing("a", cube)).symbols.resolve("a_pose")
    beside = scene(
        thing("a", cube) + thing("left", cube, y=0.06) + thing("right", cube, y=-0.06)
    ).symbols
    assert abs(free.rotation[0, 1]) < 1e-6 or abs(free.rotation[1, 1]) < 1e-6
    assert abs(beside.resolve("a_pose").rotation[0, 1]) == pytest.approx(1), (
        "closes along x, where there is room"
    )


AROUND = [(0.06, 0), (-0.06, 0), (0, 0.06), (0, -0.06)]


def test_walls_make_an_object_ungraspable_and_objects_can_be_cleared() -> None:
    cube = box(0.025, 0.025, 0.03)
    objects = "".join(thing(f"n{i}", cube, x=0.5 + dx, y=dy) for i, (dx, dy) in enumerate(AROUND))
    assert scene(thing("a", cube) + objects).symbols.ungraspable == {}
    walls = "".join(f'<geom {cube} pos="{0.5 + dx} {dy} 0.43"/>' for dx, dy in AROUND)
    assert "neighbours" in scene(thing("a", cube) + walls).symbols.ungraspable["a"]


def test_offsets_lift_over_the_neighbours() -> None:
    low = scene(thing("a", box(0.02, 0.02, 0.02), half=0.02))
    assert low.symbols.offset("z_offset", "a_pose")[2] == pytest.approx(0.12)
    tall = scene(
        thing("a", box(0.02, 0.02, 0.02), half=0.02)
        + thing("t", box(0.02, 0.02, 0.1), x=0.4, half=0.1)
    )
    lift = tall.symbols.offset("z_offset", "a_pose")[2]
    assert 0.4 + lift >= tall.objects["t"].top_z() + 0.015


def _clear(found: Scene, x: float, y: float, margin: float, but: str = "") -> bool:
    return not any(
        body.covers(x + dx, y + dy)
        for body in found.objects.values()
        if body.name != but
        for dx in (-margin, 0, margin)
        for dy in (-margin, 0, margin)
    )


@given(
    st.lists(
        st.tuples(st.floats(0.3, 0.75), st.floats(-0.4, 0.4), st.floats(0, 90)),
        min_size=1,
        max_size=6,
    )
)
@settings(max_examples=40, deadline=None)
def test_a_surface_is_approached_over_a_free_spot(spots: list[tuple[float, float, float]]) -> None:
    objects = "".join(
        thing(f"o{i}", box(0.03, 0.02, 0.05), x=x, y=y, half=0.05, yaw=yaw)
        for i, (x, y, yaw) in enumerate(spots)
    )
    model = scene(objects)
    pose = model.symbols.resolve("table_approach")
    assert pose.position[2] == pytest.approx(0.5)
    assert model.surfaces["table"].covers(pose.position[0], pose.position[1])
    assert 0.3 <= np.hypot(*pose.position[:2]) <= 0.75
    assert _clear(model, pose.position[0], pose.position[1], 0.03)


def test_the_floor_is_approached_next_to_the_table() -> None:
    parsed_scene = parse_scene(
        '<mujoco><worldbody><geom name="floor" type="plane" size="0 0 1"/>'
        + TABLE
        + "</worldbody></mujoco>"
    )
    pose = parsed_scene.symbols.resolve("floor_approach")
    assert not parsed_scene.surfaces["table"].covers(pose.position[0], pose.position[1])


def test_the_approach_follows_the_arms_base() -> None:
    text = (
        '<mujoco><worldbody><site name="robot_base" pos="2 2 0.4" euler="0 0 180"/>'
        '<geom name="slab" type="box" size="2 2 0.2" pos="2 2 0.2"/></worldbody></mujoco>'
    )
    pose = parse_scene(text).symbols.resolve("slab_approach")
    assert pose.position == pytest.approx([1.5, 2, 0.5], abs=0.03)


def test_a_blocker_has_a_free_place_to_go() -> None:
    cube = box(0.025, 0.025, 0.04)
    model = scene(thing("red", cube, half=0.04) + thing("blue", cube, x=0.58, half=0.04))
    there, here = model.symbols.resolve("red_temporary"), model.symbols.resolve("red_pose")
    assert there.position[2] == pytest.approx(here.position[2])
    assert there.angle_to(here) == pytest.approx(0, abs=1e-6)
    assert there.distance_to(here) > 0.06
    assert model.surfaces["table"].covers(there.position[0], there.position[1])
    assert _clear(model, there.position[0], there.position[1], 0.03)
    assert model.symbols.subject("red_temporary") == "red"


def test_stacked_objects_are_put_down_next_to_one_another() -> None:
    levels = [thing(f"s{i}", box(0.04 - 0.01 * i, 0.03, 0.02), half=0.02) for i in range(3)]
    stacked = [text.replace("0.42", f"{0.42 + 0.04 * i:g}") for i, text in enumerate(levels)]
    model = scene("".join(stacked))
    places = [model.symbols.resolve(f"s{i}_temporary").position[:2] for i in range(3)]
    for i, item in enumerate(places):
        assert all(np.linalg.norm(item - other) > 0.05 for other in places[i + 1 :])


@pytest.mark.parametrize("yaw", range(0, 180, 30))
def test_the_tool_at_the_side_of_the_arm_turns_with_base_and_wrist(yaw: float) -> None:
    model = scene(thing("a", box(0.05, 0.02, 0.02), x=0.1, y=0.45, half=0.02, yaw=yaw))
    pose = model.symbols.pose("a_pose")
    turned = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
    base = float(np.arctan2(pose.position[1], pose.position[0]))
    wrist = ARM.home[6] - (turned - base)
    assert ARM.limits.q_min[6] < wrist < ARM.limits.q_max[6]
    assert abs(turned) < np.radians(166)


def test_a_temporary_pose_without_room_is_an_error() -> None:
    text = (
        '<mujoco><worldbody><geom name="stand" type="box" size="0.05 0.05 0.2" pos="0.5 0 0.2"/>'
        + thing("a", box(0.03, 0.03, 0.03))
        + "</worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="no free place"):
        parse_scene(text).symbols.resolve("a_temporary")


def test_poses_overrule_derived_symbols() -> None:
    model = scene(
        thing("a", box(0.02, 0.02, 0.02), half=0.02, yaw=90),
        poses="""
        places: {table_approach: {pos: [0.4, 0.2, 0.55], yaw: 0.5}, bin: {pos: [0.3, 0.3, 0.5], quat: [0, 1, 0, 0]}}
        joints: {home_config: [0, 0, 0, -1.5, 0, 1.5, 0.8], side: [1, 0, 0, -1.5, 0, 1.5, 0.8]}
        offsets: {z_offset: 0.2, a: {x_offset: 0.015, nudge: [0, 0.01, 0.02]}}
        grasps: {a: {pos: [0.005, 0, 0.01]}}
        """,
    )
    names = model.symbols
    assert names.resolve("table_approach").position == pytest.approx([0.4, 0.2, 0.55])
    assert names.resolve("table_approach + z").position[2] == pytest.approx(0.75)
    assert names.resolve("bin").rotation[:, 2] == pytest.approx([0, 0, -1])
    assert names.resolve("a_pose").position == pytest.approx([0.5, 0.005, 0.43])
    assert names.resolve("a_pose + x").position == pytest.approx([0.5, 0.02, 0.43])
    assert names.resolve("a_pose + nudge").position[2] == pytest.approx(0.45)
    assert names.joints("home_config")[3] == -1.5
    assert set(names.configurations) == {"home_config", "side"}


def test_an_object_without_a_free_place_is_not_graspable() -> None:
    lost = '<body name="lost" pos="? ? 0.43"><freejoint/><geom type="box" size="0.02 0.02 0.03"/></body>'
    assert "its pose is unknown" in scene(lost).symbols.ungraspable["lost"]
    assert scene(lost, poses="objects: {lost: {pos: [0.4, 0, 0.43]}}").symbols.ungraspable == {}


def test_width_never_exceeds_the_opening() -> None:
    for half in (0.03, 0.036, 0.0385, 0.045):
        model = scene(thing("c", f'type="cylinder" size="{half} 0.05"', half=0.05))
        assert bool(model.symbols.ungraspable) == (2 * half > ARM.hand.opening - 0.004)
