"""The table of requests and arms."""

from __future__ import annotations

from pathlib import Path

from bench.arms import ArmRow, compare


def test_a_request_has_one_tree_on_all_arms() -> None:
    rows = list(compare(["friction"], ["fr3", "fr3-ft", "ur5e"], "measured", range(1), None))
    assert [row.arm for row in rows] == ["fr3", "fr3-ft", "ur5e"]
    assert len({row.tree for row in rows}) == 1


def test_rows_of_a_file_are_not_run_again(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    text = '{"request": "friction", "arm": "ur5e", "seed": 3, "tree": "abc", "status": "complete", '
    out.write_text(text + '"values": [["bottle.mass[0]", 0.3, 0.01, 0.32]]}\n', encoding="utf-8")
    (row,) = compare(["friction"], ["ur5e"], "measured", [3], out)
    assert row == ArmRow(
        "friction", "ur5e", 3, "abc", "complete", [["bottle.mass[0]", 0.3, 0.01, 0.32]]
    )
