"""A run folder appears at once, whole, or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from palpate.common.errors import InputError
from palpate.runs.folder import default_folder, new_folder, write_json


def test_a_folder_appears_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "down" / "run"
    with new_folder(target) as scratch:
        (scratch / "result.json").write_text("{}")
        assert not target.exists()
    assert [p.name for p in target.iterdir()] == ["result.json"]
    assert [p.name for p in target.parent.iterdir()] == ["run"]
    assert target.stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_nothing_is_left_of_a_block_that_fails(tmp_path: Path, error: type[BaseException]) -> None:
    def write() -> None:
        with new_folder(tmp_path / "run") as scratch:
            (scratch / "half.json").write_text("{")
            raise error

    with pytest.raises(error):
        write()
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(InputError, match="exists already"), new_folder(tmp_path / "run"):
        pytest.fail("not reached")


def test_two_runs_at_once_do_not_overwrite_and_lose_nothing(tmp_path: Path) -> None:
    target = tmp_path / "run"

    def both() -> None:
        with new_folder(target) as late:
            (late / "result.json").write_text("late")
            with new_folder(target) as early:
                (early / "result.json").write_text("early")

    with pytest.raises(InputError, match=r"cannot be made any more .* kept in '.*'") as caught:
        both()
    assert (target / "result.json").read_text() == "early"
    kept = Path(str(caught.value).rpartition("kept in ")[2].strip("'"))
    assert (kept / "result.json").read_text() == "late"


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match=r"cannot write '.*run'"),
        new_folder(tmp_path / "file" / "run"),
    ):
        pytest.fail("not reached")


def test_the_default_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = []
    for _ in range(3):
        folder = default_folder("bottle")
        assert folder.parent == Path("runs")
        assert folder.name.startswith("bottle-")
        folder.mkdir(parents=True)
        rows.append(folder)
    assert len(set(rows)) == 3
    assert default_folder("").name.startswith("run-2")


def test_json_is_strict_and_readable(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"name": "Flasche α", "value": 0.25})
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert "Flasche α" in text
    assert json.loads(text) == {"name": "Flasche α", "value": 0.25}
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "b.json", float("nan"))
