"""`palpate see` and `palpate tags`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import palpate as pp
from palpate.perception.renderer import gl_available

pytest.importorskip("cv2")
SCENE = """<mujoco><worldbody>
<camera name="over" pos="0.5 -0.4 1.0" xyaxes="1 0 0 0 0.8 0.6" fovy="45"/>
<body name="table" pos="0.5 0 0.38"><geom type="box" size=".4 .4 .02"/>
  <site name="tag_0" pos="-.12 -.1 .02" size=".03"/><site name="tag_1" pos=".12 .1 .02" size=".03"/></body>
<body name="box" pos="0.5 0 0.43"><freejoint/><geom type="box" size=".03 .03 .03" mass=".1"/>
  <site name="tag_7" pos="0 0 .03" size=".02"/></body>
</worldbody></mujoco>"""


@pytest.mark.skipif(not gl_available()[0], reason="no OpenGL")
def test_a_look_writes_poses_that_a_scene_takes(
    palpate: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    from bench.photograph import take

    monkeypatch.delenv("MUJOCO_GL")
    scene, poses = tmp_path / "desk.xml", tmp_path / "poses.yaml"
    photograph, lens = tmp_path / "desk.png", tmp_path / "lens.yaml"
    scene.write_text(SCENE)
    taken = take(pp.load(scene).spec(), "over")
    Image.fromarray(taken.pixels).save(photograph)
    (fx, _, cx), (_, fy, cy), _ = taken.lens.matrix.tolist()
    bent = taken.lens.distortion.tolist()
    lens.write_text(
        f"{{fx: {fx}, fy: {fy}, cx: {cx}, cy: {cy}, size: [1280, 720], distortion: {bent}}}"
    )
    look = ("see", scene, "--camera", photograph, "--intrinsics", lens, "--output", poses)
    done = palpate(*look, "--json")
    assert done.status == 0, done.err
    entry = json.loads(done.out)["objects"]["box"]
    assert entry["pos"] == pytest.approx([0.5, 0.0, 0.43], abs=0.004)
    assert pp.load(scene, poses).body("box").accuracy < 0.004
    again = palpate(*look)
    assert again.status == 2
    assert "exists already" in again.err


def test_tags_are_printed(palpate: Callable[..., Any], tmp_path: Path) -> None:
    sheet = tmp_path / "tags.pdf"
    done = palpate("tags", "--numbers", "0-3,7", "--output", sheet)
    assert done.status == 0, done.err
    assert sheet.read_bytes().startswith(b"%PDF")
    wrong = palpate("tags", "--numbers", "all", "--output", tmp_path / "no.pdf")
    assert wrong.status == 2
    assert "0-11" in wrong.err
