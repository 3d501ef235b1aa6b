"""Changing XML text in place."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.common.errors import InputError
from palpate.mjcf.edits import TextChange as Change
from palpate.mjcf.edits import (
    apply_changes,
    first_child,
    inline_includes,
    remove_attribute,
    scan,
    set_attribute,
)

TEXT = "<?xml version='1.0'?><!-- <a b='1'> --><mujoco>\n  <Größe a = '1 > 0'\n b=\"é\"  />\n  <c><d/></c ></mujoco>"


def test_tags_are_found_byte_for_byte() -> None:
    tags = scan(TEXT)
    data = TEXT.encode()
    assert [(t.name, t.depth, t.empty) for t in tags] == [
        ("mujoco", 0, False),
        ("Größe", 1, True),
        ("c", 1, False),
        ("d", 2, True),
    ]
    assert {n: data[a:b].decode() for n, (a, b) in tags[1].attributes.items()} == {
        "a": "1 > 0",
        "b": "é",
    }
    assert data[tags[2].start : tags[2].last] == b"<c><d/></c >"


def test_attributes_are_set_added_and_removed() -> None:
    tags = scan(TEXT)
    text = apply_changes(
        TEXT,
        [
            set_attribute(tags[1], "a", "it's <2>"),
            set_attribute(tags[1], "new", "x"),
            remove_attribute(TEXT.encode(), tags[1], "b"),
            set_attribute(tags[3], "e", "1"),
        ],
    )
    assert "a = 'it&apos;s &lt;2&gt;' new=\"x\"  />" in text.replace("&lt;2>", "&lt;2&gt;")
    assert '<d e="1"/>' in text
    assert [dict(t.attributes).keys() for t in scan(text)][1] == {"a", "new"}


def test_a_first_child_is_indented_like_the_next() -> None:
    tags = scan(TEXT)
    assert "<mujoco>\n  <new/>\n  <Größe" in apply_changes(
        TEXT, [first_child(TEXT.encode(), tags[0], "<new/>")]
    )
    assert "<c><new/><d/>" in apply_changes(TEXT, [first_child(TEXT.encode(), tags[2], "<new/>")])


def test_overlapping_changes_are_refused() -> None:
    with pytest.raises(InputError, match="overlap"):
        apply_changes("abcdef", [Change(0, 4, "x"), Change(2, 5, "y")])


def test_includes_are_inlined_recursively(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<mujoco><!-- a --><include file='b.xml'></include></mujoco>")
    (tmp_path / "b.xml").write_text("<mujoco><geom/></mujoco>")
    text = "<mujoco>\n<include file='a.xml'/>\n</mujoco>"
    files = {name: tmp_path / name for name in ("a.xml", "b.xml")}
    assert inline_includes(text, files) == "<mujoco>\n<!-- a --><geom/>\n</mujoco>"
