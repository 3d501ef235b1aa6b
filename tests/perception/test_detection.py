"""Corners of tags by their edges: to a few hundredths of a pixel, through a lens that bends their sides."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.pose import Array, Pose
from palpate.perception import detection
from palpate.perception.detection import MODULES, QUIET, blur_picture, detect, tag_pixels
from palpate.perception.lens import Lens, pinhole
from palpate.perception.tags import corners

cv2 = pytest.importorskip("cv2")
LENS = Lens(pinhole(180.0, 99.5, 79.5), (200, 160), np.array([-0.25, 0.05, 1e-3, -5e-4, 0.0]))
HALF = 0.05
ASKEW = (Pose.turn([0.5, 0.3, 0.2]) @ Pose.of((0, 0, 0), (0, 1, 0, 0))).quaternion
FINER = 5
"""Rays along a pixel's side, whose mean is the pixel."""


def picture(pose: Pose, random: np.random.Generator) -> np.ndarray:
    """A tag at a pose in the camera's frame: each ray is followed to the paper."""
    size = (LENS.size[1] * FINER, LENS.size[0] * FINER)
    columns, rows = np.meshgrid(np.arange(size[1]), np.arange(size[0]))
    pixels = (np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5) / FINER - 0.5
    rays = cv2.undistortPoints(pixels[:, None], LENS.matrix, LENS.distortion)[:, 0]
    rays = np.column_stack([rays, np.ones(len(rays))]) @ pose.rotation
    eye = -pose.position @ pose.rotation
    on = (eye - rays * (eye[2] / rays[:, 2])[:, None])[:, :2]
    modules = np.pad(tag_pixels(5), QUIET, constant_values=255)
    across = np.floor((on / (2 * HALF) + 0.5) * 8).astype(int) + QUIET
    inside = ((across >= 0) & (across < len(modules))).all(axis=1)
    x, y = np.clip(across, 0, len(modules) - 1).T
    light = np.where(inside, modules[len(modules) - 1 - y, x], 150.0).reshape(size)
    coarse = light.reshape(LENS.size[1], FINER, LENS.size[0], FINER).mean(axis=(1, 3))
    noisy = blur_picture(coarse, 0.7) + 2.0 * random.standard_normal(coarse.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def where(pose: Pose) -> Array:
    return LENS.project(corners(HALF, pose))


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.3), (-0.05, 0.03, 0.28)])
def test_corners_are_found_to_a_few_hundredths_of_a_pixel(place: tuple[float, ...]) -> None:
    pose = Pose(np.array(place), ASKEW)
    ((number, found),) = detect(picture(pose, np.random.default_rng(0)), LENS)
    assert number == 5
    assert np.abs(found - where(pose)).max() < 0.05


def test_a_side_that_is_covered_leads_no_corner_far_astray() -> None:
    pose = Pose.of((0, 0, 0.3), (0, 1, 0, 0))
    seen = picture(pose, np.random.default_rng(0))
    (x, y), (right, _), *_ = where(pose).round().astype(int)
    seen[y - 3 : y + 1, x + 10 : right - 10] = 0  # what lies on the paper's white
    ((_, found),) = detect(seen, LENS)
    assert np.abs(found - where(pose)).max() < 0.5 * (right - x) / 8


def test_a_corner_taken_for_one_of_the_paper_is_found_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """OpenCV takes it so where the paper is hardly brighter than what is behind it, but at that corner."""
    pose = Pose(np.array([0.0, 0.0, 0.3]), ASKEW)
    rough = where(pose)
    rough[0] += (rough[0] - rough[2]) / MODULES
    monkeypatch.setattr(detection, "squares", lambda grey: [(5, rough)])
    ((_, found),) = detect(picture(pose, np.random.default_rng(0)), LENS)
    assert np.abs(found - where(pose)).max() < 0.05


def test_the_april_tag_projects_picture_is_upside_down() -> None:
    # Modules of tag 5 in the project's own picture, from the upper left (finding apriltag_opencv_turn).
    rows = ("00000000", "01111000", "01100010", "01101100", "01010110", "00011100", "01011000")
    project = 255 * np.array([[int(module) for module in row] for row in (*rows, "00000000")])
    paper = np.pad(project.astype(np.uint8), QUIET, constant_values=255).repeat(10, 0).repeat(10, 1)
    ((number, found),) = detect(paper, Lens(pinhole(180.0, 49.5, 49.5), paper.shape, np.zeros(5)))
    # The corners begin at the lower right: docs/seeing.md says to turn such a tag.
    lower_right = 10.0 * (QUIET + MODULES) - 0.5
    assert number == 5
    np.testing.assert_allclose(found[0], lower_right, atol=0.5)
