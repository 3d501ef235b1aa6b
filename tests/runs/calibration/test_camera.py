"""`palpate calibrate --camera`: the embedded arm shows a tag to the bench's camera; what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.common.errors import InputError, Unavailable
from palpate.common.pose import Pose
from palpate.perception.hand_eye import HELD, calibrated_camera
from palpate.perception.hand_eye_fit import CalibrationViews, stances
from palpate.perception.lens import Lens, Mount, pinhole, read_lens
from palpate.perception.renderer import gl_available
from palpate.robots.owner import apply_calibration as with_figures
from palpate.robots.owner import load_description
from palpate.robots.robot_config import RobotConfig, read_config
from palpate.runs.calibration import camera
from palpate.runs.calibration.calibrate import calibrate
from palpate.runs.settings import References, settings_of
from palpate.runs.workplace import look_at_source
from palpate.scene.load import parse_scene

pytest.importorskip("cv2")
BENCH = Pose.of((1.5, -0.4, 0.9))
"""Where the bench's camera is."""


@pytest.mark.long
@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
@pytest.mark.parametrize(
    ("source", "place", "tag", "surer"),
    [
        ("world:workspace", BENCH, "on the hand", 0.3),
        ("world:hand", HELD, "that stands still", 0.5),
    ],
)
def test_a_tag_determines_the_pose_of_the_camera(
    source: str,
    place: Pose,
    tag: str,
    surer: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(camera, "PICTURES", 8)
    monkeypatch.setattr(camera, "DRAWN", 4000)
    out = tmp_path / "robot.yaml"
    asked = References(None, None, False, source, None, "7=100mm", tmp_path / "left.png")
    done = calibrate(settings_of(noise="none", seed=3), asked, out)
    result = read_config(out).camera
    assert result is not None
    assert result.covariance is not None
    std = np.sqrt(np.diag(result.covariance))
    off = result.pos - place.position
    assert np.abs(off / std[:3]).max() < 3.5
    assert np.linalg.norm(off) < 0.003
    count = len(done.pictures.corners)
    assert result.by == f"tag 7 {tag} in {count} pictures of {source}"
    assert [item.name for item in done.figures][::3] == [
        "camera x",
        "camera turn x",
        "camera focal length",
    ]
    assert (tmp_path / "left.png").read_bytes().startswith(b"\x89PNG")
    for item in done.figures[3:6]:  # its turn, 3 mrad before
        assert item.after[1] < surer * item.before[1]


def test_a_calibrated_camera_is_where_robot_yaml_says_until_it_is_another_one() -> None:
    lens = Lens(pinhole(900.0, 639.5, 359.5), (1280, 720), focal_std=0.01)
    entry = {"pos": [1, 0, 0.5], "quat": [1, 0, 0, 0], "fovy": 43.8, "size": [1280, 720]}
    covariance = np.diag(np.arange(1.0, 8.0)).tolist()

    def at(**changes: object) -> tuple[Lens, Mount | None]:
        config = RobotConfig.model_validate({"camera": entry | changes})
        arm = with_figures(load_description(), config)
        xml = """<mujoco><worldbody><site name="robot_base" pos="0.1 0 0" euler="0 0 90"/>
          <body name="box" pos=".5 0 0"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""
        return calibrated_camera(parse_scene(xml, arm=arm), lens, None)

    result, mount = at(covariance=covariance)
    assert mount is not None
    assert mount.pose_world_camera.position == pytest.approx([0.1, 1.0, 0.5])
    assert np.diag(mount.covariance) == pytest.approx([2, 1, 3, 5, 4, 6, 7])
    assert result.matrix[1, 1] == pytest.approx(360 / np.tan(np.radians(21.9)))
    assert at()[1] is None  # stated, not calibrated
    _, held = at(covariance=covariance, on_hand=True)
    assert held is not None
    # At home the hand is 0.307 m ahead of the base, which is turned to the left, and looks down.
    assert held.pose_world_camera.position == pytest.approx([0.1, 1.307, -0.013], abs=0.01)
    assert not held.on_hand
    assert at(covariance=covariance, size=[640, 480])[1] is None
    assert at(covariance=covariance, fovy=60)[1] is None


def test_a_camera_on_the_hand_is_where_the_hand_is(tmp_path: Path) -> None:
    text = "{fx: 900, fy: 900, cx: 640, cy: 360, size: [1280, 720], pose: {pos: [0.1, 0, 0], quat: [0, 1, 0, 0]"
    rows = [[1e-6 * (i == j) for j in range(6)] for i in range(6)]
    joints = [0.5, -0.785, 0, -2.356, 0, 1.571, 0.785]
    path = tmp_path / "lens.yaml"
    path.write_text(f"{text}, covariance: {rows}, on_hand: true, joints: {joints}}}}}")
    lens, mount = read_lens(path)
    assert mount is not None
    scene = parse_scene("<mujoco><worldbody><site name='robot_base'/></worldbody></mujoco>")
    _, turned = calibrated_camera(scene, lens, mount)
    _, calibrated = calibrated_camera(
        scene, lens, mount, lambda: Pose.of((0.5, 0, 0.4), (0, 1, 0, 0))
    )
    assert turned is not None
    assert calibrated is not None
    assert calibrated.pose_world_camera.position == pytest.approx([0.6, 0, 0.4])
    assert np.linalg.norm(turned.pose_world_camera.position[:2]) == pytest.approx(0.407, abs=0.01)
    x, y, _ = turned.pose_world_camera.position
    assert np.arctan2(y, x) == pytest.approx(0.5, abs=0.01)
    # Seven links are 0.8 mm off (0.3 mm each), seven zeros (1 mrad) as much again but along the arm.
    added = np.sqrt(np.diag(calibrated.covariance)[:3] - 1e-6)
    assert added == pytest.approx([0.9e-3, 1.2e-3, 1.2e-3], rel=0.1)
    _, far = calibrated_camera(scene, lens, mount, lambda: Pose.of((0.7, 0, 0.4), (0, 1, 0, 0)))
    assert far is not None
    assert np.diag(far.covariance)[2] > 1.1 * np.diag(calibrated.covariance)[2]
    path.write_text(f"{text}, covariance: {rows}, joints: {joints}}}}}")
    with pytest.raises(InputError, match="goes with on_hand"):
        read_lens(path)


def test_a_camera_on_the_hand_sees_a_tag_from_where_it_faces_it() -> None:
    arm, lens = load_description(), Lens(pinhole(900.0, 639.5, 359.5), (1280, 720))
    q = np.array(
        [arm.home, arm.home + np.array([0, 0, 0, 0, 0, 1.0, 0])]
    )  # looks at the plane, and past it
    hands, jacobians = stances(arm, q)
    mount = Mount(HELD, np.eye(6), on_hand=True)
    views = CalibrationViews(
        hands, jacobians, np.zeros((6, 35)), 0.03, 0.0, lens, mount, True, 1e-4
    )
    below = Pose.of((*hands[0].apply(HELD.position)[:2], 0.0))
    assert camera.select_views(views, below) == [0]
    assert not camera.select_views(views, below @ Pose.of((0, 0, 0), (0, 1, 0, 0)))  # its back


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_the_embedded_arm_sees_by_the_camera_on_its_hand() -> None:
    text = """<mujoco><worldbody><light pos="0 0 2"/><site name="robot_base"/>
      <body name="table" pos=".45 0 -.02"><geom type="box" size=".35 .4 .02"/></body>
      <body name="box" pos="{}"><freejoint/><geom type="box" size=".025 .025 .03" mass=".1"/>
        <site name="tag_7" pos="0 0 .0305" size=".018"/></body></worldbody></mujoco>"""
    scene, world = (parse_scene(text.format(at)) for at in (".45 .04 .03", ".462 .028 .03"))
    seen = look_at_source(scene, "world:hand", world=world, noise="none")
    off = seen.poses["box"].position - [0.462, 0.028, 0.03]
    assert np.abs(off / np.sqrt(np.diag(seen.covariances["box"])[:3])).max() < 3.0
    assert seen.std("box")[0] < 0.004


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
def test_an_impossible_camera_calibration_gets_one_clear_error(
    given: dict[str, str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("palpate.perception.detection.frames", lambda *_: iter(()))
    Path("lens.yaml").write_text("{fx: 900, fy: 900, cx: 640, cy: 360, size: [1280, 720]}")
    if given.get("camera", "").startswith("world:") and not gl_available()[0]:
        pytest.skip("no OpenGL")
    lens = Path(given["intrinsics"]) if "intrinsics" in given else None

    def attempt() -> None:
        weighs, source, tag = (given.get(name) for name in ("own_weight", "camera", "tag"))
        asked = References(None, None, bool(weighs), source, lens, tag)
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
