"""poses.yaml is untrusted input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.scene.poses import MAX_BYTES, parse_poses, read_poses


def test_every_form_of_an_orientation_is_read() -> None:
    poses = parse_poses("""
        objects:
          a: {pos: [1, 2, 3]}
          b: {pos: [0, 0, 0], yaw: 1.5707963267948966}
          c: {pos: [0, 0, 0], euler: [0, 0, 1.5707963267948966]}
          d: {pos: [0, 0, 0], quat: [2, 0, 0, 2]}
        places:
          p: {pos: [0.5, 0, 0.4], yaw: 0.3}
        """)
    assert poses.objects["a"].body_pose().quaternion == pytest.approx([1, 0, 0, 0])
    for name in "bcd":
        assert poses.objects[name].body_pose().rotation[:, 0] == pytest.approx([0, 1, 0])
    tool = poses.places["p"].tool_pose()
    assert tool.rotation[:, 2] == pytest.approx([0, 0, -1])
    assert tool.rotation[:, 0] == pytest.approx([np.cos(0.3), np.sin(0.3), 0])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("objects: {a: {pos: [1, 2]}}", "objects.a.pos"),
        ("objects: {a: {pos: [1, 2, .nan]}}", "objects.a.pos"),
        ("objects: {a: {pos: [1, 2, 1e9]}}", "objects.a.pos"),
        ("objects: {a: {pos: [1, 2, 3], yaw: 1, quat: [1, 0, 0, 0]}}", "one of yaw"),
        ("objects: {a: {pos: [1, 2, 3], quat: [0, 0, 0, 0]}}", "quat of zeros"),
        ("joints: {home: [1, 2, 3]}", "joints.home"),
        ("things: {}", "things"),
        ("[1, 2]", "needs keys: objects"),
        (
            "objects: {a: {poss: [1, 2, 3]}}",
            "objects.a.poss is not a key; an entry of 'objects' is a pose",
        ),
        ("objects: {a: 3}", "objects.a has no keys below it"),
        ("offsets: {h: {z: [1, 2]}}", "offsets.h should be a valid number"),
        ("camera: {pos: [1, 2, 3]}", "camera.quat is missing"),
        ("objects: {a: [", "not YAML"),
        ("a: &a [1]\nb: *a", "aliases"),
        ("!!python/object/apply:os.system ['true']", "not YAML"),
        ("\x00", "not YAML"),
        ("[" * 5000, "nested deeper"),
        ("objects: {a: {pos: [2001-99-99, 0, 0]}}", "not YAML|objects.a.pos"),
    ],
)
def test_entries_of_the_wrong_form_are_named(text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        parse_poses(text)


def test_files_are_bounded_and_present(tmp_path: Path) -> None:
    path = tmp_path / "poses.yaml"
    with pytest.raises(InputError, match="cannot read"):
        read_poses(path)
    path.write_text("#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="larger"):
        read_poses(path)
    path.write_bytes(b"\xff")
    with pytest.raises(InputError, match="utf-8"):
        read_poses(path)
    path.write_text("")
    assert read_poses(path).objects == {}
