"""`palpate run --camera`: a look, and then a run by what was seen."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import palpate as pp
from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.perception.look import Outlines, Seen
from palpate.perception.renderer import gl_available
from palpate.runs.workplace import require_seen
from palpate.scene.load import parse_scene, replace_objects

from .conftest import Answer, cube

Palpate = Callable[..., Answer]
DESK = """<mujoco model="desk"><worldbody><light pos="0 0 2"/><site name="robot_base"/>
<camera name="over" pos="0.5 -0.4 0.75" xyaxes="1 0 0 0 0.8 0.6" fovy="45"/>
<body name="table" pos="0.5 0 0.1"><geom type="box" size=".3 .3 .02" friction=".8"/>
  <site name="tag_0" pos="-.12 -.1 .02" size=".03"/><site name="tag_1" pos=".12 .1 .02" size=".03"/></body>
<body name="box" pos="0.5 {y} 0.15"><freejoint/><geom type="box" size=".033 .033 .03" friction=".8" {mass}/>
  <site name="tag_7" pos="0 0 .03" size=".02"/></body>
</worldbody></mujoco>"""


def seen(*names: str, unseen: tuple[str, ...] = ()) -> Seen:
    poses = {name: Pose.of((0.51, 0.02, 0.03)) for name in names}
    square = np.array([[2.0, 2], [8, 2], [8, 8], [2, 8]])
    drawn = Outlines(np.zeros((10, 10, 3), np.uint8), dict.fromkeys(names, (square,)))
    text = ("a tag leans",)
    return Seen(poses, {name: 1e-6 * np.eye(6) for name in names}, unseen, text, 0.1, drawn)


@pytest.mark.long
@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_a_box_15_mm_off_its_place_is_seen_and_weighed(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cv2")
    monkeypatch.delenv("MUJOCO_GL")
    scene, world = tmp_path / "desk.xml", tmp_path / "world.xml"
    scene.write_text(DESK.format(y=0, mass=""))
    # The fingers close along x: a box off along y is beneath one of them.
    world.write_text(DESK.format(y=0.015, mass='mass=".3"'))
    run = ("run", scene, "--world", world, "-m", "box.mass", "--noise", "lab", "--fast")
    blind = palpate(*run, "--out", "blind")
    assert blind.status == 4, blind.out
    stopped = json.loads(Path("blind/result.json").read_text())["execution"]["stopped_by"]
    assert stopped.startswith("MovePose(box_pose): unexpected contact")
    done = palpate(*run, "--camera", "world:over", "--out", "out", "--json")
    assert done.status == 0, done.err
    (mass,) = json.loads(done.out)["parameters"]
    assert abs(mass["value"] - 0.3) < 3 * mass["std"]
    (row,) = (line for line in done.err.splitlines() if line.startswith("box "))
    assert float(row.split()[2].strip(",")) == pytest.approx(0.015, abs=0.003)
    kept = pp.load(scene, "out/poses.yaml").body("box")
    moved = pp.open("out").scene.body("box")
    assert moved.pose_world.distance_to(kept.pose_world) < 1e-9
    assert moved.pose_world.position[1] == pytest.approx(0.015, abs=0.003)
    assert moved.accuracy == pytest.approx(kept.accuracy)
    assert "--poses poses.yaml" in Path("out/report.html").read_text()


@pytest.mark.usefixtures("driver")
@pytest.mark.parametrize("said", ["n\n", ""])
def test_a_person_confirms_what_was_seen_before_anything_is_planned(
    palpate: Palpate,
    scene: Callable[..., Path],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("palpate.runs.workplace.look_at_source", lambda *_: seen("cube"))
    monkeypatch.setattr(sys, "stdin", io.StringIO(said))
    look = ("run", scene(cube()), "--camera", "0", "--robot", "bench://arm", "--quiet")
    answer = palpate(*look)
    assert (answer.status, "not confirmed" in answer.err) == (4, True), answer.err
    assert "0.5100, 0.0200, 0.0300" in answer.err
    (picture,) = (line for line in answer.err.splitlines() if line.startswith("outlined in "))
    with Image.open(picture.removeprefix("outlined in ")) as shown:
        assert shown.size == (10, 10)
    assert "move?" not in answer.err
    monkeypatch.setattr("palpate.runs.workplace.look_at_source", lambda *_: seen(unseen=("cube",)))
    agreed = palpate(*look, "--yes")
    assert agreed.status == 2, agreed.err
    assert "did not see cube:" in agreed.err
    assert "there?" not in agreed.err


def test_requested_objects_that_were_not_seen_are_named(scene: Callable[..., Path]) -> None:
    plan = pp.load(scene(cube(), cube("tin", y=0.2))).plan(measure="cube.mass")
    with pytest.raises(InputError, match="did not see cube:"):
        require_seen(plan.run_so_far, seen("tin", unseen=("cube",)))
    notes = require_seen(plan.run_so_far, seen("cube", unseen=("tin",))).plan.notes
    assert notes[-2:] == (
        "The look: a tag leans.",
        "Not seen, and taken to stand as stated: tin.",
    )


def test_objects_that_were_seen_overrule_a_file_whose_places_stay(
    scene: Callable[..., Path],
) -> None:
    stated = "{objects: {cube: {pos: [0.4, 0.1, 0.03]}}, places: {aside: {pos: [0.4, 0.2, 0.3]}}, accuracy: 0.004}"
    given = parse_scene(scene(cube(), cube("tin", y=0.2)).read_text(), poses=stated)
    result = replace_objects(given, seen("cube").entries)
    assert result.body("cube").pose_world.position == pytest.approx([0.51, 0.02, 0.03])
    assert result.body("cube").accuracy == pytest.approx(0.001)
    assert result.body("tin").accuracy == pytest.approx(0.004)
    assert "aside" in result.symbols.poses


def test_a_look_in_python_is_kept_with_the_run(
    scene: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("palpate.runs.workplace.look_at_source", lambda *_: seen("cube"))
    known = scene(cube(mass='mass=".2"'))
    run = pp.run(known, measure="cube.friction", camera=0, out=tmp_path / "out")
    assert run.scene.body("cube").pose_world.position == pytest.approx([0.51, 0.02, 0.03])
    assert "The look: a tag leans." in run.plan.notes
    kept = pp.load(known, tmp_path / "out" / "poses.yaml")
    assert kept.body("cube").pose_world.position == pytest.approx([0.51, 0.02, 0.03])
    with pytest.raises(InputError, match="camera=SOURCE"):
        pp.run(known, intrinsics="lens.yaml")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--intrinsics", "lens.yaml"), "--intrinsics goes with --camera"),
        (("--camera", "world:over"), "give --world"),
        (("--camera", "world:over", "--robot", "bench://arm"), "a real one: give its camera"),
        (("--camera", "desk.png"), "needs its intrinsics"),
        (("--camera", "desk.png", "--intrinsics", "lens.yaml"), "lens.yaml"),
    ],
)
def test_a_look_that_cannot_be_is_one_clear_error(
    palpate: Palpate, scene: Callable[..., Path], options: tuple[str, ...], words: str
) -> None:
    answer = palpate("run", scene(cube()), *options)
    assert answer.status == 2, answer.err
    (line,) = (line for line in answer.err.splitlines() if line.startswith("palpate: "))
    assert words in line
    assert not Path("runs").exists()


def test_a_camera_needs_a_scene(palpate: Palpate) -> None:
    answer = palpate("run", "-r", "weigh the mug", "--camera", "0")
    assert answer.status == 2
    assert "--scene" in answer.err
