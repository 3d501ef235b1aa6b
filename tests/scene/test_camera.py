"""Images and the camera's geometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.scene import camera
from palpate.scene.camera import Camera, load_image
from palpate.scene.poses import parse_poses


def test_images_are_read_and_downscaled(tmp_path: Path) -> None:
    for name in ("a.png", "a.jpg"):
        Image.new("RGB", (200, 100), (255, 0, 0)).save(tmp_path / name)
        pixels = load_image(tmp_path / name, max_side=50)
        assert pixels.shape == (25, 50, 3)
        assert pixels.mean(axis=(0, 1)) == pytest.approx([255, 0, 0], abs=2)
    assert load_image(tmp_path / "a.png").shape == (100, 200, 3)


def test_transparency_and_grey_become_rgb(tmp_path: Path) -> None:
    Image.new("LA", (4, 4), (10, 128)).save(tmp_path / "a.png")
    assert load_image(tmp_path / "a.png").shape == (4, 4, 3)


@pytest.mark.parametrize(
    "content", [b"", b"not a picture", b"\x89PNG\r\n\x1a\n truncated", b"GIF89a" + b"\0" * 40]
)
def test_a_file_that_is_no_picture_is_an_input_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match="cannot read"):
        load_image(path)


def test_truncated_absent_and_huge_pictures_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.png"
    with pytest.raises(InputError, match="cannot read"):
        load_image(path)
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)).save(
        path
    )
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match="cannot read"):
        load_image(path)
    Image.new("L", (64, 64)).save(path)
    monkeypatch.setattr(camera, "MAX_PIXELS", 1000)
    with pytest.raises(InputError, match="64 × 64"):
        load_image(path)


def overhead(height: float = 1.0) -> Camera:
    return Camera(Pose.of((0.5, 0.0, height)), np.deg2rad(60), 640, 480)


@given(st.floats(0, 640), st.floats(0, 480), st.floats(-0.5, 0.5))
@settings(max_examples=100, deadline=None)
def test_pixels_and_points_on_a_plane_agree(u: float, v: float, z: float) -> None:
    point = overhead().on_plane(u, v, z)
    assert point is not None
    assert point[2] == pytest.approx(z)
    assert overhead().project(point) == pytest.approx((u, v), abs=1e-6)


def test_image_axes_point_right_and_down() -> None:
    middle = overhead().on_plane(320, 240, 0)
    right = overhead().on_plane(400, 240, 0)
    down = overhead().on_plane(320, 300, 0)
    assert middle == pytest.approx([0.5, 0, 0])
    assert right is not None
    assert down is not None
    assert right[0] > 0.5
    assert down[1] < 0
    assert overhead(-1.0).on_plane(320, 240, 0) is None
    assert overhead().project(np.array([0.5, 0, 2.0])) is None


def test_a_camera_is_read_from_poses() -> None:
    entry = parse_poses(
        "camera: {pos: [0, 0, 1], quat: [1, 0, 0, 0], fovy: 90, size: [200, 100]}"
    ).camera
    assert entry is not None
    assert Camera.of(entry).focal == pytest.approx(50)
