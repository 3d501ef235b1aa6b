"""The example package, found through its entry point by a palpate of its own process, which knows
nothing of it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.studies.scenarios.catalogue import scenario

EXAMPLE = Path(__file__).parents[2] / "examples" / "palpate-thermometer"
PLAN = EXAMPLE / "plan.json"
JOB = scenario("thermometer").settings()
D = ["--scene", str(JOB.scene), "--poses", str(JOB.poses)]
R = ["--request", str(JOB.request)]
W = ["--world", str(JOB.world), "--planner", f"replay:{PLAN}", "--out", "run", "--fast"]
READINGS = (61.8, 61.9, 62.0, 62.1, 62.2)

Palpate = Callable[..., "subprocess.CompletedProcess[str]"]


def command(**environment: str) -> Palpate:
    def run(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "palpate.cli.main", *arguments],
            capture_output=True,
            text=True,
            check=False,
            cwd=cwd,
            env={**os.environ, **environment},
            timeout=120,
        )

    return run


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a palpate with the example installed, as an editable install would: the
    package's folder on the path, and metadata with its entry point. A thermometer is logging."""
    site = tmp_path_factory.mktemp("site")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text("utf-8"))["project"]
    metadata = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (metadata / "entry_points.txt").write_text("\n".join(groups))
    log = site / "thermometer.log"
    log.write_text("".join(f"{reading}\n" for reading in (20.0, *READINGS)))
    paths = os.pathsep.join(filter(None, [str(site), str(EXAMPLE), os.environ.get("PYTHONPATH")]))
    return {"PYTHONPATH": paths, "PALPATE_THERMOMETER": str(log)}


@pytest.fixture(scope="module")
def palpate(installed: dict[str, str]) -> Palpate:
    return command(**installed)


def test_the_prompt_offers_the_primitive_and_its_quantity(palpate: Palpate) -> None:
    system = json.loads(palpate("prompt", *R, *D, "--json").stdout)["system"]
    assert (
        "- MeasureTemperature(): Read the thermometer while it is held still over an object"
        in system
    )
    assert "- temperature °C, of an object: hold the thermometer over the object" in system


@pytest.mark.long
def test_the_schema_and_the_bt_cpp_model_have_the_primitive(palpate: Palpate) -> None:
    assert "MeasureTemperature" in json.dumps(json.loads(palpate("vocabulary", "--json").stdout))
    assert '<Action ID="MeasureTemperature">' in palpate("vocabulary", "--btcpp").stdout


def test_the_check_knows_the_primitive_only_with_the_package(palpate: Palpate) -> None:
    with_it = palpate("check", str(PLAN), *D, "--json")
    assert (with_it.returncode, json.loads(with_it.stdout)) == (0, {"valid": True, "findings": []})
    without = command()("check", str(PLAN), *D, "--json")
    assert without.returncode == 3
    assert {"unknown-primitive", "unknown-parameter"} <= {
        f["rule"] for f in json.loads(without.stdout)["findings"]
    }


def test_the_check_holds_the_primitive_to_its_own_preconditions(
    palpate: Palpate, tmp_path: Path
) -> None:
    plan = json.loads(PLAN.read_text("utf-8"))
    steps = plan["tree"]["children"]
    measuring = next(i for i, step in enumerate(steps) if step["type"] == "MeasureTemperature")
    steps.insert(2, steps.pop(measuring))
    early = tmp_path / "early.json"
    early.write_text(json.dumps(plan))
    found = json.loads(palpate("check", str(early), *D, "--json").stdout)["findings"]
    assert any("the thermometer is not in the gripper" in finding["message"] for finding in found)


@pytest.mark.long
def test_the_request_is_measured_and_reported(palpate: Palpate, tmp_path: Path) -> None:
    done = palpate("run", *R, *D, *W, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "run" / "result.json").read_text("utf-8"))
    assert result["status"] == "complete"
    found = {(p["object"], p["quantity"]): p for p in result["parameters"]}
    assert set(found) == {("left_cup", "temperature"), ("right_cup", "temperature")}
    for parameter in found.values():
        assert parameter["value"] == pytest.approx(sum(READINGS) / len(READINGS))
        assert parameter["unit"] == "°C"
        low, high = parameter["ci95"]
        assert 61.5 < low < 62.0 < high < 62.5
    assert result["execution"]["stopped_by"] is None
    assert '<Action ID="MeasureTemperature"' in (tmp_path / "run" / "tree.xml").read_text("utf-8")
    report = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert "MeasureTemperature" in report
    assert "°C" in report


@pytest.mark.long
def test_a_thermometer_that_cannot_be_read_ends_in_a_controlled_stop_with_the_reason(
    installed: dict[str, str], tmp_path: Path
) -> None:
    dumb = command(**{**installed, "PALPATE_THERMOMETER": str(tmp_path / "unplugged.log")})
    rehearsed = dumb("run", *R, *D, *W, cwd=tmp_path)
    assert rehearsed.returncode == 3, rehearsed.stderr
    assert "the thermometer's log cannot be read" in " ".join(rehearsed.stderr.split())
    shutil.rmtree(tmp_path / "run")
    done = dumb("run", *R, *D, *W, "--no-rehearse", cwd=tmp_path)
    assert done.returncode == 4, done.stderr
    result = json.loads((tmp_path / "run" / "result.json").read_text("utf-8"))
    assert "the thermometer's log cannot be read" in result["execution"]["stopped_by"]
    assert {p["verdict"] for p in result["parameters"]} <= {"not identified"}
