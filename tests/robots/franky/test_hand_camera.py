"""A camera on a real robot's hand: it sees from where the arm says that its hand is, over libfranka's protocol."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from palpate.common.pose import Pose
from palpate.perception.detection import CORNERS, MODULES, QUIET, tag_pixels
from palpate.perception.hand_eye import HELD
from palpate.perception.lens import FACING, Lens, pinhole
from palpate.robots.nominal import NominalArm
from palpate.runs.settings import Settings
from palpate.runs.workplace import look
from palpate.scene.load import load_scene
from tests.fci.served import served
from tests.helpers.franka import ARM

cv2 = pytest.importorskip("cv2")
pytest.importorskip("franky", reason="franky-control has no wheel for this machine")

SCENE = """<mujoco><worldbody><geom name="desk" type="box" size=".4 .4 .01" pos=".4 0 -.01"/>
  <body name="box" pos="0.33 0.05 0.03"><freejoint/>
    <geom type="box" size=".04 .04 .03" mass=".2"/><site name="tag_8" pos="0 0 .03" size=".03"/></body>
</worldbody></mujoco>"""
LENS = Lens(pinhole(900.0, 639.5, 359.5), (1280, 720))
INTRINSICS = """{{fx: 900, fy: 900, cx: 639.5, cy: 359.5, size: [1280, 720],
 pose: {{on_hand: true, pos: {pos}, quat: {quat}, covariance: {covariance}}}}}"""
OFF = np.array([0.015, -0.012, 0.0])
"""m: the box stands beside where the scene has it."""


def picture(eye: Pose, tag: Pose) -> np.ndarray:
    """A tag of 60 mm, number 8, before white, seen from `eye`, OpenCV's frame, through `LENS`."""
    printed = np.kron(
        np.pad(tag_pixels(8), QUIET, constant_values=255), np.ones((16, 16), np.uint8)
    )
    outer = 0.03 * (MODULES + 2 * QUIET) / MODULES
    points = tag.position + (outer * CORNERS) @ tag.rotation.T
    there = LENS.project((points - eye.position) @ eye.rotation)
    side = len(printed)
    here = np.array([[0, 0], [side, 0], [side, side], [0, side]]) - 0.5
    way = cv2.getPerspectiveTransform(here.astype(np.float32), there.astype(np.float32))
    grey = cv2.warpPerspective(printed, way, LENS.size, flags=cv2.INTER_AREA, borderValue=255)
    return np.repeat(grey[..., None], 3, axis=2)


def test_a_box_is_seen_from_where_the_arm_says_its_hand_is(tmp_path: Path) -> None:
    q = ARM.home + np.array([0.2, 0.05, 0, 0.05, 0, -0.1, 0.1])
    nominal = NominalArm(ARM, Pose.of([0, 0, 0]), np.zeros(3))
    there, home = nominal.poses(np.array([q, ARM.home]))
    hand = Pose(there[:3], there[3:])
    assert np.linalg.norm(hand.position - home[:3]) > 0.05
    (tmp_path / "desk.xml").write_text(SCENE)
    scene = load_scene(tmp_path / "desk.xml")
    top = scene.body("box").pose_world.translate([*OFF[:2], 0.03])
    Image.fromarray(picture(hand @ HELD @ FACING, top)).save(tmp_path / "desk.png")
    lens = INTRINSICS.format(
        pos=HELD.position.tolist(),
        quat=HELD.quaternion.tolist(),
        covariance=np.diag([1e-6] * 6).tolist(),
    )
    (tmp_path / "camera.yaml").write_text(lens)
    with served(tmp_path / "desk.xml", q=q.tolist()) as bench:
        url = f"franky://{bench.address}"
        settings = Settings(
            robot=url, camera=str(tmp_path / "desk.png"), intrinsics=tmp_path / "camera.yaml"
        )
        look(settings, scene)
        moved, _ = look(settings, scene)  # the connection was given back
    assert moved is not None
    found = moved.body("box").pose_world.position
    assert found == pytest.approx(scene.body("box").pose_world.position + OFF, abs=2e-3)
