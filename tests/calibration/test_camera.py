"""`palpate calibrate --camera`: the embedded arm shows a tag to the bench's camera; what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.calibration import camera
from palpate.calibration.calibrate import calibrate, wanted
from palpate.errors import InputError, Unavailable
from palpate.geometry.pose import Pose
from palpate.pictures.renderer import gl_available
from palpate.robots.owner.arm import calibrated as with_figures
from palpate.robots.owner.config import RobotConfig, read_config
from palpate.robots.registry import load_description
from palpate.scene.load import parse_scene
from palpate.seeing.handeye.calibrated import calibrated
from palpate.seeing.lens import Lens, Mount, pinhole
from palpate.settings import settings_of

pytest.importorskip("cv2")
BENCH = Pose.of((1.5, -0.4, 0.9))
"""Where the bench's camera is."""


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_a_tag_on_the_hand_tells_where_the_camera_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(camera, "PICTURES", 8)
    monkeypatch.setattr(camera, "DRAWN", 4000)
    out = tmp_path / "robot.yaml"
    asked = wanted(None, None, False, "world:workspace", None, "7=60mm", tmp_path / "left.png")
    done = calibrate(settings_of(noise="none", seed=3), asked, out)
    found = read_config(out).camera
    assert found is not None
    assert found.covariance is not None
    std = np.sqrt(np.diag(found.covariance))
    off = found.pos - BENCH.position
    assert np.abs(off / std[:3]).max() < 3.5
    assert np.linalg.norm(off) < 0.003
    assert (
        found.by == f"tag 7 on the hand in {len(done.pictures.corners)} pictures of world:workspace"
    )
    assert [one.name for one in done.found][::3] == [
        "camera x",
        "camera turn x",
        "camera focal length",
    ]
    assert (tmp_path / "left.png").read_bytes().startswith(b"\x89PNG")
    for one in done.found[3:6]:  # its turn, 3 mrad before
        assert one.after[1] < 0.3 * one.before[1]


def test_a_calibrated_camera_is_where_robot_yaml_says_until_it_is_another_one() -> None:
    lens = Lens(pinhole(900.0, 639.5, 359.5), (1280, 720), focal_std=0.01)
    entry = {"pos": [1, 0, 0.5], "quat": [1, 0, 0, 0], "fovy": 43.8, "size": [1280, 720]}
    covariance = np.diag(np.arange(1.0, 8.0)).tolist()

    def at(**changes: object) -> tuple[Lens, Mount | None]:
        config = RobotConfig.model_validate({"camera": entry | changes})
        arm = with_figures(load_description(), config)
        xml = """<mujoco><worldbody><site name="robot_base" pos="0.1 0 0" euler="0 0 90"/>
          <body name="box" pos=".5 0 0"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""
        return calibrated(parse_scene(xml, arm=arm), lens, None)

    found, mount = at(covariance=covariance)
    assert mount is not None
    assert mount.pose_world_camera.position == pytest.approx([0.1, 1.0, 0.5])
    assert np.diag(mount.covariance) == pytest.approx([2, 1, 3, 5, 4, 6, 7])
    assert found.matrix[1, 1] == pytest.approx(360 / np.tan(np.radians(21.9)))
    assert at()[1] is None  # stated, not calibrated
    assert at(covariance=covariance, size=[640, 480])[1] is None
    assert at(covariance=covariance, fovy=60)[1] is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"camera": "0"}, "camera= and tag= go together"),
        ({"tag": "0=60mm"}, "camera= and tag= go together"),
        ({"camera": "0", "tag": "900=60mm"}, "0 to 586"),
        ({"camera": "0", "tag": "0=60kg"}, "the tag's side"),
        ({"camera": "desk.png", "tag": "0=60mm"}, "does not see the arm move"),
        ({"camera": "0", "tag": "0=60mm"}, "intrinsics"),
        ({"camera": "0", "tag": "0=60mm", "intrinsics": "lens.yaml"}, "roughly where"),
        ({"camera": "world:none", "tag": "0=60mm"}, "workspace"),
        ({"own_weight": True, "intrinsics": "lens.yaml"}, "goes with camera"),
    ],
)
def test_what_cannot_be_calibrated_is_one_clear_error(
    given: dict[str, str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("palpate.seeing.sources.frames", lambda *_: iter(()))
    Path("lens.yaml").write_text("{fx: 900, fy: 900, cx: 640, cy: 360, size: [1280, 720]}")
    if given.get("camera", "").startswith("world:") and not gl_available()[0]:
        pytest.skip("no OpenGL")
    lens = Path(given["intrinsics"]) if "intrinsics" in given else None

    def attempt() -> None:
        weighs, source, tag = (given.get(name) for name in ("own_weight", "camera", "tag"))
        asked = wanted(None, None, bool(weighs), source, lens, tag)
        calibrate(settings_of(noise="none"), asked, Path("robot.yaml"))

    with pytest.raises(InputError, match=words):
        attempt()
    assert not Path("robot.yaml").exists()


def test_a_camera_that_fails_on_the_way_ends_the_calibration() -> None:
    def fails() -> np.ndarray:
        raise Unavailable("unplugged")

    shots = camera.Shots(fails, Lens(pinhole(900.0, 32.0, 24.0), (64, 48)), 0)

    class Leaf:
        primitive = "MeasureForces"

    class Snapshot:
        leaves = (Leaf(),)
        stopping = None

    shots.on_tick(Snapshot())
    shots.on_tick(Snapshot())
    assert isinstance(shots.failed, Unavailable)
