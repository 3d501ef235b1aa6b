"""Files that somebody hands over: regular ones only, and never more of them than wanted."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.common.errors import InputError
from palpate.common.files import open_with_limit, plain_yaml, read_bytes, read_text, require_regular
from palpate.mjcf.reading import read_document
from palpate.planning.registry import load_proposal
from palpate.robots.owner import load_description
from palpate.runs.folder import read_json
from palpate.scene.camera import load_image
from palpate.scene.poses import read_poses
from palpate.trace.mcap import read_mcap

READERS: dict[str, Callable[[Path], object]] = {
    "scene": read_document,
    "poses": read_poses,
    "plan": load_proposal,
    "picture": load_image,
    "trace": read_mcap,
    "a run's": read_json,
}


@pytest.mark.parametrize("kind", READERS)
def test_files_that_are_not_regular_are_refused(kind: str, tmp_path: Path) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with pytest.raises(InputError, match="a FIFO, not a regular file; give"):
        READERS[kind](fifo)
    with pytest.raises(InputError, match="/dev/zero is a device, not a regular file; give"):
        READERS[kind](Path("/dev/zero"))


def test_a_fifo_for_an_arm_is_no_arm(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "description.yaml")
    with pytest.raises(InputError, match="unknown arm"):
        load_description(str(tmp_path))


def test_folders_and_links_to_devices_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder, not a regular file; give a plan"):
        read_bytes(tmp_path, 10, "a plan")
    link = tmp_path / "link"
    link.symlink_to("/dev/zero")
    with pytest.raises(InputError, match="a device"):
        require_regular(link, 10, "a plan")


def test_a_file_has_a_limit(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"x" * 3000)
    assert read_bytes(file, 3000, "a plan") == b"x" * 3000
    with pytest.raises(InputError, match="larger than 2 kB, too large for a plan"):
        read_bytes(file, 2999, "a plan")


def test_a_file_that_grows_while_it_is_read_has_the_same_limit() -> None:
    # Files of /proc say that they are empty, and are not.
    assert read_bytes(Path("/proc/self/status"), 100_000, "a plan")
    with pytest.raises(InputError, match="larger than"):
        read_bytes(Path("/proc/self/status"), 10, "a plan")


def test_absent_and_binary_files_are_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=r"cannot read .*: No such file"),
        open_with_limit(tmp_path / "a", 10, "a plan"),
    ):
        pass
    with pytest.raises(InputError, match=r"cannot read .*null"):
        read_bytes(Path("a\0b"), 10, "a plan")
    (tmp_path / "b").write_bytes(b"\xff")
    with pytest.raises(InputError, match="not utf-8 text"):
        read_text(tmp_path / "b", 10, "a plan")


def test_yaml_neither_grows_nor_goes_deep() -> None:
    assert plain_yaml("a: [1, {b: 2}]", "here") == {"a": [1, {"b": 2}]}
    with pytest.raises(InputError, match="here, line 2, column 4: not YAML: aliases"):
        plain_yaml("a: &a [x, x]\nb: *a", "here")
    with pytest.raises(InputError, match="nested deeper"):
        plain_yaml("[" * 1000, "here")
