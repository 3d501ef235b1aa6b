"""Lines of results: what is there stays, a cut-off line goes, another file is not touched."""

from __future__ import annotations

from math import inf, nan
from pathlib import Path

import pytest

from palpate.common.errors import InputError
from palpate.studies.workers import Lines


def test_rows_come_back_in_order(tmp_path: Path) -> None:
    lines = Lines(tmp_path / "new" / "rows.jsonl")
    assert lines.read() == []
    lines.add()
    assert lines.file.exists()
    lines.add({"a": 1}, {"b": "Ü\n"})
    lines.add({"c": [None, 2.5]})
    assert lines.read() == [{"a": 1}, {"b": "Ü\n"}, {"c": [None, 2.5]}]


def test_infinite_numbers_are_written_as_words(tmp_path: Path) -> None:
    lines = Lines(tmp_path / "rows.jsonl")
    lines.add({"widths": (inf, -inf), "of": {"nothing": nan}})
    assert lines.read() == [{"widths": ["inf", "-inf"], "of": {"nothing": "nan"}}]


def test_a_line_that_a_kill_cut_short_is_left_out_and_overwritten(tmp_path: Path) -> None:
    lines = Lines(tmp_path / "rows.jsonl")
    lines.add({"a": 1})
    with lines.file.open("a", encoding="utf-8") as file:
        file.write('{"b"')
    assert lines.read() == [{"a": 1}]
    assert lines.file.read_text(encoding="utf-8").endswith('{"b"')  # reading changes nothing
    lines.add({"c": 3})
    assert lines.read() == [{"a": 1}, {"c": 3}]


@pytest.mark.parametrize("content", ["my notes\n", "[1, 2]\n"])
def test_another_file_is_not_taken_for_results(tmp_path: Path, content: str) -> None:
    file = tmp_path / "notes.txt"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=r"notes\.txt.*--out"):
        Lines(file).read()
    assert file.read_text(encoding="utf-8") == content


def test_a_place_that_cannot_be_written_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="cannot write"):
        Lines(tmp_path / "file" / "rows.jsonl").add()
