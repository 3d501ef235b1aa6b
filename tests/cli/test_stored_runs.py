"""Commands on folders of finished runs, as a shell would use them."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import palpate as pp
from palpate.cli.show_run import show_run
from palpate.common.parameter import Parameter
from palpate.common.processes import interrupts
from palpate.perception.renderer import gl_available
from palpate.runs.keeper import Keeper

from .conftest import TABLE, Answer, cube

Palpate = Callable[..., Answer]
SCENE = TABLE.format(bodies=cube())
MASS = 0.3
WORLD = TABLE.format(bodies=cube(mass=f'mass="{MASS}"'))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of two runs that weighed a cube with two arms."""
    folder = tmp_path_factory.mktemp("runs")
    scene, world = folder / "scene.xml", folder / "world.xml"
    scene.write_text(SCENE)
    world.write_text(WORLD)
    result: list[Path] = []
    for seed in (0, 1):
        run = pp.run(scene, "how heavy is the cube?", world=world, seed=seed, fast=True)
        assert run[Parameter("cube", "mass")].identified
        run.save(folder / f"run{seed}")
        result.append(folder / f"run{seed}")
    return result


@pytest.fixture(scope="module")
def stored(folders: list[Path]) -> Path:
    return folders[0]


@pytest.mark.long
def test_estimates_are_made_again(palpate: Palpate, stored: Path) -> None:
    answer = palpate("estimate", stored, "--json")
    assert answer.status == 0
    stored_result = json.loads((stored / "result.json").read_text())
    assert json.loads(answer.out)["parameters"] == stored_result["parameters"]
    validation = json.loads(answer.out)["validation"]["held_out"]
    assert validation == stored_result["validation"]["held_out"]
    assert validation["agrees"]
    assert "validation agrees the way down with the cube" in palpate("estimate", stored).out
    other = palpate("estimate", stored, "--estimator", "mass=single-shot", "--json")
    assert json.loads(other.out)["parameters"][0]["method"].startswith("Mean vertical force")


@pytest.mark.long
def test_a_fast_run_is_completed_later(palpate: Palpate, stored: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(stored, copy)
    before = json.loads((copy / "result.json").read_text("utf-8"))
    assert before["twin"]["validation"]["residual_twin"]["note"] == "not replayed"
    answer = palpate("report", copy, "--json")
    assert answer.status == 0, answer.err
    after = json.loads((copy / "result.json").read_text("utf-8"))
    assert after == json.loads(answer.out)
    marks = after["twin"]["validation"]
    assert marks["residual_twin"]["force_N"] < marks["residual_template"]["force_N"]
    assert after["parameters"] == before["parameters"]
    assert after["stage"] is None
    if gl_available()[0]:
        assert palpate("report", copy, "--film").status == 0
        assert (copy / "images" / "played-again.mp4").stat().st_size > 1000
        page = (copy / "report.html").read_text("utf-8")
        assert "rendered from the trace" in page
        assert "data:video/mp4" in page


def test_an_unknown_estimator_is_bad_input(palpate: Palpate, stored: Path) -> None:
    unknown = palpate("estimate", stored, "--estimator", "mass=guess")
    assert (unknown.status, unknown.out) == (2, "")
    assert "single-shot" in unknown.err
    assert palpate("estimate", stored, "--estimator", "guess").status == 2
    assert palpate("estimate", stored.parent).status == 2


def test_a_twin_is_exported(palpate: Palpate, stored: Path, tmp_path: Path) -> None:
    out = tmp_path / "urdf"
    answer = palpate("export", stored, "--to", "urdf", "--out", out, "--json")
    assert answer.status == 0
    document = json.loads(answer.out)
    kept = json.loads((out / "export.json").read_text())
    assert document == kept | {"file": str(out / "scene.urdf")}
    (row,) = document["parameters"]
    assert row["read_back"]
    assert (out / "scene.urdf").read_text().count("<mass ") == 2
    again = palpate("export", stored, "--to", "urdf", "--out", out)
    assert (again.status, again.out) == (2, "")
    assert "exists already" in again.err
    assert palpate("export", stored, "--to", "sdf").status == 2
    beside = palpate("export", stored, "--to", "mjcf")
    assert beside.status == 0
    assert "read back" in beside.out
    assert (stored / "export-mjcf" / "scene.xml").read_text() == (stored / "twin.xml").read_text()


@pytest.mark.long
def test_a_twin_is_proved_and_the_report_shows_it(
    palpate: Palpate, stored: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "run"
    shutil.copytree(stored, copy)
    answer = palpate("prove", copy, "--json")
    assert answer.status == 0
    document = json.loads(answer.out)
    assert document == json.loads((copy / "proof.json").read_text("utf-8"))
    assert {row["task"] for row in document["tasks"]} >= {"topple", "throw to a mark"}
    for row in document["tasks"]:
        assert abs(row["twin"][0]) < abs(row["prior"][0])
    assert "What the twin is good for" in (copy / "report.html").read_text("utf-8")
    (copy / "proof.json").write_text('{"tasks": [{}]}')
    assert "is no proof" in palpate("report", copy).out + palpate("report", copy).err


def test_two_runs_are_fused(palpate: Palpate, folders: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "fused"
    answer = palpate("fuse", *folders, "--out", out, "--json")
    assert answer.status == 0
    result = json.loads(answer.out)
    assert result == json.loads((out / "result.json").read_text())
    (fused,) = result["parameters"]
    parts = [json.loads((at / "result.json").read_text())["parameters"][0] for at in folders]
    values = [part["value"] for part in parts]
    assert min(values) < fused["value"] < max(values)
    assert fused["std"] < min(part["std"] for part in parts)
    assert fused["ci95"][0] < MASS < fused["ci95"][1]
    assert [run["name"] for run in result["runs"]] == ["run0", "run1"]
    twin = pp.load(out / "twin.xml")
    assert twin.bodies["cube"].known["mass"] == pytest.approx((fused["value"],), abs=1e-4)
    table = palpate("fuse", *folders)
    assert "together" in table.out
    assert palpate("fuse", *folders, "--out", out).status == 2


def test_a_run_is_not_counted_twice_nor_one_of_another_scene(
    palpate: Palpate, stored: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(stored, copy)
    twice = palpate("fuse", stored, copy)
    assert (twice.status, twice.out) == (2, "")
    assert "not counted twice" in twice.err
    itself = palpate("compare", stored, copy)
    assert itself.status == 0
    assert "hold the same recordings: they cannot differ" in " ".join(
        (itself.out + itself.err).split()
    )
    assert palpate("fuse", stored).status == 2
    other = tmp_path / "other.xml"
    other.write_text(SCENE.replace("0.35 0 -0.03", "0.36 0 -0.03"))
    _edit(copy / "request.json", scene=str(other), world=None)
    alone = palpate("fuse", stored, copy)
    assert alone.status == 2
    for word in ("not of one scene", "0.35 0 -0.03", "worlds differ"):
        assert word in alone.err


@pytest.mark.parametrize("file", ["twin.xml", "scene.xml"])
@pytest.mark.parametrize("content", ["<mujoco><worldbody>", "PNG", ""])
def test_a_damaged_file_of_a_run_is_named(
    palpate: Palpate, stored: Path, tmp_path: Path, file: str, content: str
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(stored, copy)
    (copy / file).write_text(content)
    answer = palpate("compare", copy, stored)
    assert answer.status == 2, answer.out
    assert f"copy/{file}' is damaged" in "".join(answer.err.split("\n"))


def test_runs_are_compared(palpate: Palpate, folders: list[Path]) -> None:
    answer = palpate("compare", *folders, "--json")
    assert answer.status == 0
    result = json.loads(answer.out)
    assert [run["name"] for run in result["runs"]] == ["run0", "run1"]
    assert result["remarks"] == []
    (mass,) = result["parameters"]
    first, second = mass["runs"]
    assert first["difference"] is None
    assert second["difference"] == pytest.approx(second["value"] - first["value"])
    # Two arms share nothing.
    gap = math.hypot(first["std"], second["std"])
    assert second["difference_std"] == pytest.approx(gap)
    assert second["z"] == pytest.approx(second["difference"] / second["difference_std"])
    table = palpate("compare", *folders)
    assert (table.status, table.err) == (0, "")
    assert f"{second['z']:+.1f}" in table.out
    assert palpate("compare", folders[0]).status == 2
    comparison = pp.compare(folders)
    assert f"cube.mass {abs(second['z']):.1f} std apart" in repr(comparison)
    assert comparison["cube.mass"][1].difference == pytest.approx(second["difference"])
    with pytest.raises(KeyError, match=r"'cube.height' is in none of the runs; there is cube.mass"):
        comparison["cube.height"]


def test_shared_errors_cancel_in_the_difference_of_runs(
    palpate: Palpate, stored: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(stored, copy)
    result = json.loads((copy / "result.json").read_text())
    row = result["parameters"][0]
    shift = 0.01
    row["value"] += shift
    row["ci95"] = [bound + shift for bound in row["ci95"]]
    (copy / "result.json").write_text(json.dumps(result))
    answer = json.loads(palpate("compare", stored, copy, "--json").out)
    second = answer["parameters"][0]["runs"][1]
    shared = math.hypot(*(item["effect"][0] for item in row["shared"]))
    assert shared > 0.1 * row["std"]
    own = math.sqrt(row["std"] ** 2 - shared**2)
    assert second["difference_std"] == pytest.approx(math.sqrt(2) * own)
    assert second["difference"] == pytest.approx(shift)


def test_runs_of_different_scenes_are_compared_with_a_remark(
    palpate: Palpate, stored: Path, tmp_path: Path
) -> None:
    unknown = _unknown(stored, tmp_path / "unknown")
    other = tmp_path / "other.xml"
    other.write_text(SCENE.replace("0.35 0 -0.03", "0.36 0 -0.03"))
    _edit(unknown / "request.json", scene=str(other))
    answer = palpate("compare", stored, unknown)
    assert answer.status == 0
    for words in ("not of one scene", "not identified", "–"):
        assert words in answer.out, words


def test_a_report_is_opened(
    palpate: Palpate, stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    there = True

    def browser(url: str) -> bool:
        opened.append(url)
        return there

    monkeypatch.setattr("webbrowser.open", browser)
    missing = palpate("open", tmp_path)
    assert (missing.status, missing.out) == (2, "")
    copy = tmp_path / "a copy"
    shutil.copytree(stored, copy)
    (copy / "report.html").unlink(missing_ok=True)
    assert "palpate report" in palpate("open", copy).err
    page = copy / "report.html"
    page.write_text("<!doctype html>")
    answer = palpate("open", copy)
    assert (answer.status, answer.out, answer.err) == (0, f"{page}\n", "")
    assert opened == [page.as_uri()]
    there = False
    without = palpate("open", copy)
    assert (without.status, without.out) == (0, f"{page}\n")
    assert "no browser" in without.err


def test_contradicted_estimates_are_left_out_of_a_fusion(
    palpate: Palpate, folders: list[Path], tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folders[1], copy)
    result = json.loads((copy / "result.json").read_text())
    pulled = {"name": "pulled", "statistic": 9.0, "limit": 1.0, "finding": "Something pulls."}
    result["parameters"][0] |= {"verdict": "contradicted", "tests": [pulled]}
    (copy / "result.json").write_text(json.dumps(result))
    answer = json.loads(palpate("fuse", folders[0], copy, "--json").out)
    stored = json.loads((folders[0] / "result.json").read_text())["parameters"][0]
    assert answer["parameters"][0]["value"] == stored["value"]
    assert answer["left_out"] == ["cube.mass of copy is contradicted: Something pulls."]
    both = palpate("fuse", copy, _unknown(folders[0], tmp_path / "unknown"))
    assert both.status == 1


def _unknown(run: Path, copy: Path) -> Path:
    """A copy of a run that identified nothing."""
    shutil.copytree(run, copy)
    result = json.loads((copy / "result.json").read_text())
    nothing = {"value": None, "std": None, "ci95": None, "verdict": "not identified", "shared": []}
    result["parameters"][0] |= nothing
    (copy / "result.json").write_text(json.dumps(result))
    return copy


def _edit(file: Path, **changes: object) -> None:
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def test_the_twin_is_written_where_it_is_wanted(stored: Path, tmp_path: Path) -> None:
    wanted = tmp_path / "new" / "my_twin.xml"
    run = pp.open(stored)
    with interrupts() as signals:
        keeper = Keeper(tmp_path, signals)
        keeper.twin(replace(run, settings=replace(run.settings, twin=wanted)))
    assert wanted.read_text() == run.twin.xml == (tmp_path / "twin.xml").read_text()


def test_a_twin_that_predicts_no_better_than_the_scene_is_not_validated(
    stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = pp.open(stored)
    assert run.held_out is not None
    motions = tuple(replace(item, chi2_template=item.chi2 / 2) for item in run.held_out.motions)
    show_run(replace(run, held_out=replace(run.held_out, motions=motions)), as_json=False)
    shown = capsys.readouterr().out
    assert "validation open the way down with the cube" in shown
    assert "which is no worse" in shown
