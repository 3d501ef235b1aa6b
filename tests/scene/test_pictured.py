"""Boxes in a picture become shapes on a plane, and a scene of them."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array
from palpate.scene import picture_scene as fitting
from palpate.scene.camera import Camera
from palpate.scene.detections import SceneObject, Shape
from palpate.scene.load import apply_measurement, load_scene
from palpate.scene.picture_scene import DetectedScene, SceneBuilder, fit, project_points
from palpate.scene.poses import Poses, parse_poses

POSES = """
camera: {pos: [1.15, 0.0, 1.1], quat: [0.6826014, 0.1845407, 0.1845407, 0.6826014], fovy: 45, size: [640, 480]}
"""


def poses(more: str = "") -> Poses:
    return parse_poses(POSES + more)


CAMERA = SceneBuilder(poses()).camera


def box_of(points: Array, camera: Camera = CAMERA) -> tuple[float, float, float, float]:
    """The box around points in the image, as fractions."""
    seen = project_points(camera, points)
    (left, top), (right, bottom) = seen.min(axis=0), seen.max(axis=0)
    return (
        float(left / camera.width),
        float(top / camera.height),
        float(right / camera.width),
        float(bottom / camera.height),
    )


def corners(x: float, y: float, half: tuple[float, float, float], z: float) -> Array:
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [0, 2])).reshape(3, -1).T
    return np.array([x, y, z]) + signs * np.array(half)


def rings(x: float, y: float, radius: float, height: float, z: float) -> Array:
    turn = np.linspace(0, 2 * np.pi, 200)
    circle = np.column_stack(
        [x + radius * np.cos(turn), y + radius * np.sin(turn), np.full(200, z)]
    )
    return np.concatenate([circle, circle + np.array([0, 0, height])])


def things(level: float = 0.0, **heights: float) -> tuple[SceneObject, ...]:
    """A table at z = `level` with a can and a block on it, as a faultless eye boxes them."""
    table = box_of(np.array([[x, y, level] for x in (0.25, 0.95) for y in (-0.4, 0.4)]))
    return (
        SceneObject("table", "plane", table, heights.get("table")),
        SceneObject("can", "cylinder", box_of(rings(0.5, 0.1, 0.03, 0.12, level))),
        SceneObject("block", "box", box_of(corners(0.55, -0.15, (0.03, 0.03, 0.04), level))),
    )


@settings(deadline=None, max_examples=40)
@given(
    x=st.floats(0.3, 0.8),
    y=st.floats(-0.3, 0.3),
    radius=st.floats(0.01, 0.08),
    height=st.floats(0.02, 0.3),
    level=st.floats(-0.1, 0.3),
)
def test_a_cylinder_is_found_where_it_stands(
    x: float, y: float, radius: float, height: float, level: float
) -> None:
    result = fit(
        CAMERA, SceneObject("can", "cylinder", box_of(rings(x, y, radius, height, level))), level
    )
    assert (result.x, result.y, result.width / 2, result.height) == pytest.approx(
        (x, y, radius, height), abs=2e-3
    )


@settings(deadline=None, max_examples=40)
@given(
    x=st.floats(0.3, 0.8),
    y=st.floats(-0.3, 0.3),
    half=st.floats(0.01, 0.08),
    tall=st.floats(0.01, 0.15),
)
def test_a_square_block_is_found_where_it_stands(
    x: float, y: float, half: float, tall: float
) -> None:
    result = fit(
        CAMERA, SceneObject("block", "box", box_of(corners(x, y, (half, half, tall), 0.0))), 0.0
    )
    assert (result.x, result.y, result.width / 2, result.height / 2) == pytest.approx(
        (x, y, half, tall), abs=1e-3
    )


def test_a_ball_is_found_where_it_lies() -> None:
    sphere = np.random.default_rng(0).normal(size=(20_000, 3))
    points = np.array([0.6, -0.1, 0.14]) + 0.04 * sphere / np.linalg.norm(
        sphere, axis=1, keepdims=True
    )
    result = fit(CAMERA, SceneObject("ball", "sphere", box_of(points)), 0.1)
    assert (result.x, result.y, result.width / 2) == pytest.approx((0.6, -0.1, 0.04), abs=1e-3)


def test_a_scene_is_built_whose_unknowns_are_left_open() -> None:
    scene = DetectedScene(SceneBuilder(poses()), things()).scene()
    assert list(scene.objects) == ["can", "block"]
    assert list(scene.surfaces) == ["table"]
    assert set(scene.missing) == {
        Parameter("table", "height"),
        Parameter("can", "mass"),
        Parameter("can", "friction"),
        Parameter("block", "mass"),
        Parameter("block", "friction"),
    }
    assert scene.body("can").size == pytest.approx([0.06, 0.06, 0.12], abs=1e-3)
    assert scene.body("table").size[:2] == pytest.approx([0.7, 0.8], abs=2e-3)
    assert {"can_pose", "block_pose", "table_approach"} <= set(scene.symbols.poses)
    assert scene.body("can").bottom_z() == pytest.approx(scene.body("table").top_z(), abs=1e-4)


def test_the_built_scene_is_mjcf_that_a_user_may_keep(tmp_path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(DetectedScene(SceneBuilder(poses()), things()).scene().text, encoding="utf-8")
    assert set(load_scene(file).bodies) == {"table", "can", "block"}
    model = load_scene(file).spec().compile()
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, "workspace") >= 0


@pytest.mark.parametrize(
    ("more", "told", "level"),
    [
        ("", None, 0.0),
        ("", 0.21, 0.21),
        ("places: {table_approach: {pos: [0.4, 0, 0.4]}}", 0.21, 0.3),
        ("objects: {table: {pos: [0.6, 0, 0.12]}}", 0.21, 0.12),
    ],
)
def test_the_planes_height_comes_from_the_poses_then_from_the_model(
    more: str, told: float | None, level: float
) -> None:
    seen = DetectedScene(
        SceneBuilder(poses(more)), things(level, **({} if told is None else {"table": told}))
    )
    scene = seen.scene()
    assert scene.priors[Parameter("table", "height")] == pytest.approx((level,))
    assert scene.body("can").size[2] == pytest.approx(0.12, abs=1e-3)


def test_contact_corrects_heights_and_with_them_shapes_and_places() -> None:
    """Believed 3 cm too low, the can seems farther back; once the table is felt, everything is
    where it is."""
    before = DetectedScene(SceneBuilder(poses()), things(level=0.03)).scene()
    after = apply_measurement(before, Parameter("table", "height"), (0.03,))
    assert before.body("can").pose_world.position[0] == pytest.approx(0.482, abs=4e-3)
    assert after.body("can").pose_world.position[:2] == pytest.approx([0.5, 0.1], abs=1e-3)
    assert after.body("can").bottom_z() == pytest.approx(0.03, abs=1e-4)
    assert after.body("can").size == pytest.approx([0.06, 0.06, 0.12], abs=1e-3)
    assert apply_measurement(before, Parameter("can", "mass"), (0.3,)) is before


def test_touched_sizes_correct_the_shapes_of_what_was_seen() -> None:
    """A block that the picture has 20 mm too tall and 2 mm too wide stays where it stands."""
    scene = DetectedScene(SceneBuilder(poses()), things()).scene()
    values = {
        Parameter("table", "height"): (0.01,),
        Parameter("block", "size"): (0.058, 0.06, 0.06),
    }
    model = scene.spec(values).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = model.body("block").geomadr[0]
    assert model.geom_size[geom] == pytest.approx([0.029, 0.03, 0.03], abs=1e-4)
    assert data.geom_xpos[geom][2] - 0.03 == pytest.approx(0.01, abs=2e-4)


def test_a_scene_that_was_given_keeps_its_shapes_when_a_height_is_measured(tmp_path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(DetectedScene(SceneBuilder(poses()), things()).scene().text, encoding="utf-8")
    scene = load_scene(file)
    after = apply_measurement(scene, Parameter("table", "height"), (0.02,))
    assert after.body("can").size == pytest.approx(scene.body("can").size)
    assert after.body("can").bottom_z() == pytest.approx(0.02, abs=1e-6)
    assert after.body("can").pose_world.position[:2].tolist() == (
        scene.body("can").pose_world.position[:2].tolist()
    )


def test_a_known_place_and_direction_are_kept() -> None:
    known = poses("objects: {block: {pos: [0.56, -0.14, 0.04], yaw: 0.5}, mug: {pos: [0, 0, 0]}}")
    scene = DetectedScene(SceneBuilder(known), things()).scene()
    block = scene.body("block").pose_world
    assert block.position[:2] == pytest.approx([0.56, -0.14], abs=1e-4)
    assert np.arctan2(block.rotation[1, 0], block.rotation[0, 0]) == pytest.approx(0.5, abs=1e-3)


def test_the_arms_mount_is_no_object() -> None:
    pedestal = SceneObject("pedestal", "box", box_of(corners(0.0, 0.0, (0.1, 0.1, 0.05), 0.0)))
    plate = box_of(np.array([[x, y, 0.0] for x in (-0.15, 0.15) for y in (-0.15, 0.15)]))
    seen = (*things(), pedestal, SceneObject("plate", "plane", plate, 0.0))
    assert set(DetectedScene(SceneBuilder(poses()), seen).scene().bodies) == {
        "table",
        "can",
        "block",
    }


def test_the_plane_below_an_object_carries_it() -> None:
    shelf = SceneObject(
        "shelf",
        "plane",
        box_of(np.array([[x, y, 0.1] for x in (0.4, 0.6) for y in (0.0, 0.2)])),
        0.1,
    )
    table, can, block = things()
    can = replace(can, bbox=box_of(rings(0.5, 0.1, 0.03, 0.12, 0.1)))
    scene = DetectedScene(SceneBuilder(poses()), (table, shelf, can, block)).scene()
    assert scene.body("can").bottom_z() == pytest.approx(0.1, abs=1e-3)
    assert scene.body("block").bottom_z() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("objects", "word"),
    [
        (things()[1:], "as a 'plane'"),
        ((*things(), things()[1]), "'can' is listed twice"),
        (
            (things()[0], SceneObject("can", "sphere", (0.1, 0.1, 0.9, 0.2))),
            "no sphere on a plane at",
        ),
    ],
)
def test_boxes_that_make_no_scene_are_reported_to_the_model(
    objects: tuple[SceneObject, ...], word: str
) -> None:
    with pytest.raises(InputError, match=word):
        DetectedScene(SceneBuilder(poses()), objects).scene()


def test_a_plane_above_the_camera_cannot_be_seen() -> None:
    with pytest.raises(InputError, match="above the horizon"):
        DetectedScene(SceneBuilder(poses()), things(table=1.5)).scene()


def test_a_picture_without_a_camera_builds_nothing() -> None:
    with pytest.raises(InputError, match="camera"):
        DetectedScene(SceneBuilder(parse_poses("{}")), things()).scene()


def test_names_of_the_poses_are_known_before_anything_is_seen() -> None:
    symbols = SceneBuilder(
        poses("""
objects: {can: {pos: [0.5, 0.1, 0.06]}}
places: {tray: {pos: [0.4, -0.2, 0.3]}}
offsets: {z_offset: 0.2, can: {x_offset: 0.02}}
""")
    ).symbols
    assert set(symbols.names) == {"can_pose", "tray"}
    assert symbols.resolve("can_pose + z_offset + x_offset").position == pytest.approx(
        [0.52, 0.1, 0.26]
    )


@settings(deadline=None, max_examples=60)
@given(
    shape=st.sampled_from(["box", "cylinder", "sphere"]),
    left=st.floats(0, 0.95),
    top=st.floats(0, 0.95),
    width=st.floats(0.001, 1),
    height=st.floats(0.001, 1),
)
def test_any_box_is_a_shape_or_an_error(
    shape: Shape, left: float, top: float, width: float, height: float
) -> None:
    box = (left, top, min(1.0, left + width), min(1.0, top + height))
    try:
        result = fit(CAMERA, SceneObject("x", shape, box), 0.0)
    except InputError:
        return
    assert 0 < result.width < 10
    assert 0 < result.height < 10
    assert np.hypot(result.x - 1.15, result.y) <= fitting.FAR
