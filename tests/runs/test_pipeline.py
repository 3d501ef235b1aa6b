"""The whole way on the paper's first scenario, through the command line, with every file it
leaves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.runs import pipeline
from palpate.runs.callbacks import RunCallbacks
from palpate.runs.run import Run
from palpate.scene.load import load_scene
from palpate.studies.accuracy import run_seed
from palpate.studies.scenarios.catalogue import scenario
from palpate.trace.mcap import read_mcap
from palpate.twin.validate import NOT_REPLAYED

FILES = {
    "request.json",
    "plan.json",
    "tree.xml",
    "trace.mcap",
    "result.json",
    "twin.xml",
    "report.html",
    "images",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("demo") / "run"
    subprocess.run(
        [sys.executable, "-m", "palpate.cli.main", "demo", "--noise", "lab", "--out", str(path)],
        check=True,
        capture_output=True,
    )
    return path


def test_folder_is_complete(folder: Path) -> None:
    assert {p.name for p in folder.iterdir()} == FILES


def test_result_is_the_contract(folder: Path) -> None:
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert result["status"] == "complete"
    by_name = {(p["object"], p["quantity"]): p for p in result["parameters"]}
    mass, height = by_name["bottle", "mass"], by_name["table", "height"]
    assert mass["unit"] == "kg"
    assert mass["verdict"] == "identified"
    assert abs(mass["value"] - 0.254) < 0.006
    assert mass["ci95"][0] < 0.254 < mass["ci95"][1]
    assert abs(height["value"] - 0.765) < 0.0005
    assert result["plan"]["planner"] == "symbolic"
    assert result["execution"]["stopped_by"] is None
    assert Path(result["files"]["twin"]).read_text(encoding="utf-8").startswith("<!--")


def test_twin_is_the_users_file_with_the_gap_closed(folder: Path) -> None:
    template = scenario("bottle_and_table").folder / "scene.xml"
    before, after = (
        template.read_text(encoding="utf-8").splitlines(),
        (folder / "twin.xml").read_text().splitlines(),
    )
    changed = ("?", 'material="glass" friction', '<body name="bottle"')
    kept = [line for line in before if not any(word in line for word in changed)]
    assert [line for line in after if line in kept] == kept
    twin = load_scene(folder / "twin.xml")
    # What stands on the measured table stands on it.
    assert twin.body("bottle").bottom_z() == pytest.approx(twin.body("table").top_z(), abs=1e-5)
    assert twin.missing == ()
    assert twin.body("bottle").known["mass"][0] == pytest.approx(0.254, abs=0.006)


def test_twin_gives_the_touch_back(folder: Path) -> None:
    marks = json.loads((folder / "result.json").read_text(encoding="utf-8"))["twin"]["validation"]
    assert marks["settled"]
    assert marks["residual_twin"]["position_m"] < 0.0002 < marks["residual_template"]["position_m"]
    assert marks["residual_twin"]["force_N"] < marks["residual_template"]["force_N"]


def test_trace_can_be_read_again(folder: Path) -> None:
    trace = read_mcap(folder / "trace.mcap")
    assert trace.leaves[0].primitive == "MoveJoints"
    assert {c.quantity for c in trace.conversions} == {"mass", "height"}


@pytest.mark.long
def test_equal_seeds_give_equal_results_bit_for_bit() -> None:
    settings = scenario("bottle_and_table").settings(noise="datasheet")
    first, second, other = run_seed(settings, 3), run_seed(settings, 3), run_seed(settings, 4)
    assert first == second
    assert first.estimates[1].value != other.estimates[1].value


@pytest.mark.long
def test_every_stage_can_start_from_the_folder(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    settings = scenario("bottle_and_table").settings(
        out=out, planner=f"replay:{folder / 'plan.json'}", fast=True
    )
    run = pipeline.run(replace(settings))
    assert run.status == "complete"
    assert (
        run.plan.parameters
        == pipeline.run(replace(settings, out=tmp_path / "third")).plan.parameters
    )


def test_values_are_shown_before_twin_film_and_report() -> None:
    messages: list[str] = []
    settings = scenario("one_missing_mass").settings(fast=True)
    planned_run = pipeline.plan(settings, pipeline.load(settings))

    def measured(run: Run) -> None:
        assert run.finished is None
        messages.extend(str(estimate.parameter) for estimate in run.estimates)

    run = pipeline.carry_out(planned_run, RunCallbacks(progress=messages.append, measured=measured))
    assert messages.index("green_bottle.mass") < messages.index("building the twin")
    assert run.twin.validation is not None
    assert run.twin.validation.settled
    assert run.twin.validation.twin == NOT_REPLAYED
    assert "validating the twin in simulation" not in messages


def test_interrupt_puts_the_bottle_down(tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate.cli.main", "demo", "--fast", "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "MUJOCO_GL": "disable"},
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "CloseGripper" in line:
            process.send_signal(signal.SIGINT)
            break
    process.stderr.read()
    assert process.wait() == 4
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["status"] == "aborted"
    assert result["execution"]["stopped_by"] == "interrupted"
    last = read_mcap(out / "trace.mcap").leaves[-1]
    assert last.status == "SUCCESS"
    assert "put bottle down" in last.message
