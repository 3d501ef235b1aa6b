"""Poses from tags: a rendered look, the fit's covariance, what does not fit, and files."""

from __future__ import annotations

from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import palpate as pp
from bench.seeing import SCENE, drawn_look
from palpate.common.errors import InputError
from palpate.common.outline import depth
from palpate.common.pose import Pose
from palpate.perception import look as looking
from palpate.perception.detection import detect
from palpate.perception.lens import FACING, Lens, Mount, pinhole, read_lens
from palpate.perception.renderer import gl_available
from palpate.perception.solve import Problem, move_pose, pose_difference, solve
from palpate.perception.tags import DPI, _page, corners, tags_of, write_sheet
from palpate.scene.load import parse_scene, replace_objects
from palpate.scene.poses import parse_poses
from palpate.scene.scene import Scene

pytest.importorskip("cv2")

TOLD = {"table": "0.38", "place": "0.45 0.05 0.43", "lean": "0 0", "turn": "0"}


@cache
def scene(**changes: str) -> Scene:
    return parse_scene(SCENE.format(**(TOLD | changes)))


LENS = Lens(pinhole(900.0, 639.5, 359.5), (1280, 720), np.array([-0.1, 0.02, 1e-3, 0, 0]), 0.005)


def mount() -> Mount:
    """A camera that looks at the table's middle."""
    eye, target = np.array([0.95, -0.6, 1.1]), np.array([0.5, 0.0, 0.4])
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    import mujoco

    quaternion = np.empty(4)
    axes = np.column_stack([right, np.cross(back, right), back])
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    spread = np.diag([0.005**2] * 3 + [0.005**2] * 3)
    return Mount(Pose.of(eye, quaternion), spread)


@pytest.mark.parametrize("known", [True, False])
def test_errors_are_as_large_as_the_covariance_says(known: bool) -> None:
    random = np.random.default_rng(1)
    squares = []
    for _ in range(8 if known else 4):
        found, truth = drawn_look(random, LENS, mount(), 1.0, known)
        off = pose_difference(found.poses["box"], truth)
        squares.append(off @ np.linalg.solve(found.covariances["box"], off) / 6)
    assert 0.7 < np.sqrt(np.mean(squares)) < 1.4


def test_a_tag_that_is_elsewhere_is_refused() -> None:
    found, truth = drawn_look(np.random.default_rng(2), LENS, mount(), 0.2, shifted=1)
    assert found.outliers.tags == (1,)
    assert found.poses["box"].distance_to(truth) < 0.005


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_a_simulated_camera_sees_where_a_box_is() -> None:
    from bench.photograph import take

    world = scene(place="0.5 0 0.43", turn="20")
    picture = take(world.spec(), "over", seed=3)
    given = scene(table="?")  # a table of unknown height: the picture says it as well
    found = looking.look(given, [picture.pixels], picture.lens, picture.mount)
    table = replace_objects(given, found.entries).surfaces["table"]
    assert "height" in table.missing  # and it is to be touched
    assert table.covariance is not None
    assert abs(table.top_z() - 0.4) < 3 * np.sqrt(table.covariance[2, 2]) < 0.02
    hidden = picture.pixels.copy()
    for number, at in detect(hidden[..., 1].copy(), picture.lens):
        if number >= 7:
            (left, top), (right, bottom) = at.min(axis=0).astype(int), at.max(axis=0).astype(int)
            hidden[top:bottom, left:right] = 128
    alone = looking.look(given, [hidden], picture.lens, picture.mount)
    assert alone.unseen == ("box",)
    assert not alone.surfaces  # it would be below or in the box, which stays where it is stated
    off = pose_difference(found.poses["box"], world.body("box").pose_world)
    assert np.abs(off / np.sqrt(np.diag(found.covariances["box"]))).max() < 3.0
    assert np.linalg.norm(off[:2]) < 0.003
    assert abs(off[5]) < 0.01
    assert not found.notes
    assert not found.unseen
    assert found.outlines is not None
    (outline,) = found.outlines.shapes["box"]
    (tag,) = (
        at for number, at in detect(picture.pixels[..., 1].copy(), picture.lens) if number == 7
    )
    # The tag is two thirds as wide as the top that it lies on, 30 to 40 pixels.
    assert min(depth(outline, corner) for corner in tag) > 3.0
    assert np.ptp(outline, axis=0).max() < 4.0 * np.ptp(tag, axis=0).max()
    assert Image.open(BytesIO(found.outlines.png())).size == (1280, 720)
    poses = parse_poses(_yaml(found))
    body = parse_scene(given.text, poses=poses).body("box")
    assert body.accuracy == pytest.approx(found.std("box")[0], rel=0.01)
    assert not body.seen  # its size is the scene's


def _yaml(found: looking.Seen) -> str:
    from palpate.common.files import yaml_text

    return yaml_text(found.content)


@pytest.mark.parametrize("number", [0, 7])
def test_a_single_tag_determines_the_height_of_a_table(number: int) -> None:
    """A tag on it, or on what stands on it; 12 tables that are up to 30 mm off what is believed."""
    given, random = scene(table="?"), np.random.default_rng(3)
    tag, squares = tags_of(given)[number], list[float]()
    for _ in range(12):
        rise = random.uniform(-0.03, 0.03)
        camera = move_pose(mount().pose_world_camera @ FACING, 0.005 * random.standard_normal(6))
        zoom = float(np.exp(LENS.focal_std * random.standard_normal()))
        place = tag.pose_world.translate((0, 0, rise))
        points = (corners(tag.half, place) - camera.position) @ camera.rotation
        seen = {number: LENS.project(points, zoom) + 0.2 * random.standard_normal((4, 2))}
        things = looking.things_of(given)
        found = solve(Problem(LENS, seen, {number: tag}, things, mount()))
        off = found.poses["table"].position[2] - things["table"].pose_world.position[2] - rise
        squares.append(off**2 / found.covariances["table"][2, 2])
    assert 0.6 < np.sqrt(np.mean(squares)) < 1.4


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_a_camera_without_a_place_or_a_name_is_reported() -> None:
    with pytest.raises(InputError, match="valid: over"):
        pp.see(scene(), "world:under")
    bare = parse_scene("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    with pytest.raises(InputError, match="no tags"):
        looking.look(bare, [], LENS)


def test_a_camera_without_fixed_tags_has_no_pose() -> None:
    tags = tags_of(scene())
    seen = {7: np.array([[600.0, 300], [650, 300], [650, 350], [600, 350]])}
    with pytest.raises(InputError, match="where the camera is"):
        solve(Problem(LENS, seen, tags, looking.things_of(scene()), None))


def test_a_lens_is_read_in_both_forms(tmp_path: Path) -> None:
    ours, ros = tmp_path / "ours.yaml", tmp_path / "ros.yaml"
    ours.write_text("{fx: 900, fy: 901, cx: 640, cy: 360, size: [1280, 720], distortion: [-0.1]}")
    ros.write_text(
        "{image_width: 1280, image_height: 720, camera_name: x, distortion_model: plumb_bob,\n"
        "camera_matrix: {rows: 3, cols: 3, data: [900, 0, 640, 0, 901, 360, 0, 0, 1]},\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0, 0, 0, 0]}}"
    )
    (mine, stands), (theirs, _) = read_lens(ours), read_lens(ros)
    assert stands is None
    assert mine.matrix == pytest.approx(theirs.matrix)
    assert mine.distortion == pytest.approx(theirs.distortion)
    ours.write_text("{fx: 900}")
    with pytest.raises(InputError, match="'fy' is missing"):
        read_lens(ours)


def test_a_source_that_is_none_lists_the_choices(tmp_path: Path) -> None:
    lens = tmp_path / "lens.yaml"
    lens.write_text("{fx: 900, fy: 901, cx: 640, cy: 360, size: [1280, 720]}")
    with pytest.raises(InputError, match="world:NAME"):
        pp.see(scene(), "webcam", intrinsics=lens)
    with pytest.raises(InputError, match="intrinsics"):
        pp.see(scene(), "desk.png")


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_a_dressed_object_shows_its_tags() -> None:
    from bench.photograph import take

    dressed = SCENE.replace(
        "<worldbody>", '<custom><text name="look:box" data="block"/></custom><worldbody>'
    )
    picture = take(parse_scene(dressed.format(**TOLD)).spec(), "over")
    assert {7, 8} <= {number for number, _ in detect(picture.pixels[..., 1].copy(), picture.lens)}


def test_an_invalid_covariance_is_refused() -> None:
    row = "[0, 0, 0, 0, 0, 0]"
    bad = f"{{objects: {{box: {{pos: [0, 0, 0], covariance: [[-1, 0, 0, 0, 0, 0]{f', {row}' * 5}]}}}}}}"
    with pytest.raises(InputError, match="covariance"):
        parse_poses(bad)


def test_a_sheet_has_its_tags_at_their_size(tmp_path: Path) -> None:
    page = np.asarray(_page(range(6), 0.04, 3))
    found = detect(page[::4, ::4].copy(), LENS)
    sides = [np.linalg.norm(where[1] - where[0]) * 4 / DPI * 0.0254 for _, where in found]
    assert sorted(number for number, _ in found) == list(range(6))
    assert sides == pytest.approx([0.04] * 6, abs=2e-4)
    assert write_sheet(tmp_path / "tags.pdf", [1, 2], 0.05) == 1
    assert (tmp_path / "tags.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(InputError, match="size="):
        write_sheet(tmp_path / "more.pdf", [1], 0.3)
