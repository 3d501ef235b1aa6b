"""Signals to a real process: every stage ends with exit status 4 and a line, and what there is, is
kept."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from installed import install

from palpate.trace.mcap import read_mcap

TESTS = Path(__file__).parents[1]
SCENE = """<mujoco model="desk"><worldbody>
  <site name="robot_base"/>
  <body name="desk" pos="0.4 0 -0.03"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="mug" pos="0.5 0.1 0.05"><freejoint/>
    <geom type="box" size=".03 .02 .05" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>
"""
DRIVER = """import os, signal, time
from palpate.execution.cell_drivers import Driver
from palpate.runs import building
from test_nothing_lost import Bench

built = building.build

def build(*inputs, **named):
    # the signal comes while it is built, however busy the machine is
    time.sleep(20)
    return built(*inputs, **named)

if "SLOW_TWIN" in os.environ:
    building.build = build

def cell(url, scene):
    bench = Bench()
    bench.arm.on_advance = lambda arm: time.sleep(0.001)
    return bench

driver = Driver("scripted", cell)
"""
PLANNER = """import time

class Slow:
    name = "slow"

    def plan(self, request, scene, images=()):
        time.sleep(20)

planner = Slow
"""


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """A folder with a scene, and with a package that brings a scripted arm."""
    points = {
        "palpate.cells": "scripted = scripted_driver",
        "palpate.planners": "slow = slow_planner",
    }
    install(tmp_path, "scripted", points, {"scripted_driver": DRIVER, "slow_planner": PLANNER})
    (tmp_path / "desk.xml").write_text(SCENE)
    return tmp_path


def interrupted(
    desk: Path,
    word: str,
    *signals: signal.Signals,
    planner: str = "symbolic",
) -> tuple[subprocess.Popen[str], str, str]:
    """A run that gets the signals as soon as it says `word` on stderr; the process, and what else
    it printed."""
    path = os.pathsep.join(map(str, (desk, TESTS, TESTS / "helpers", *sys.path)))
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "palpate", "run", "--scene", "desk.xml", "--json"),
            *("-r", "how heavy is the mug?", "--robot", "scripted://here", "--yes"),
            *("--planner", planner, "--out", "run"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=desk,
        # under nohup, which palpate respects, it would inherit that SIGHUP is ignored
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
        env={**os.environ, "MUJOCO_GL": "disable", "PYTHONPATH": path},
    )
    assert process.stderr is not None
    for line in process.stderr:
        if word in line:
            break
    for number in signals:
        process.send_signal(number)
    out, err = process.communicate(timeout=60)
    return process, out, err


@pytest.mark.parametrize(
    ("stage", "number", "planner"),
    [("planning", signal.SIGTERM, "slow"), ("rehearsing", signal.SIGINT, "symbolic")],
)
def test_a_signal_before_any_motion_writes_nothing(
    desk: Path, stage: str, number: signal.Signals, planner: str
) -> None:
    process, out, err = interrupted(desk, stage, number, planner=planner)
    assert process.returncode == 4
    assert err.splitlines()[-1].endswith(f"while {stage}; nothing has moved")
    assert json.loads(out)["status"] == "aborted"
    assert not (desk / "run").exists()
    assert not list(desk.glob(".run*"))


@pytest.mark.parametrize(
    "others",
    [
        pytest.param((), id="one"),
        pytest.param((signal.SIGINT,), id="two", marks=pytest.mark.long),
    ],
)
def test_a_signal_during_motion_stops_the_arm_and_keeps_the_run(
    desk: Path, others: tuple[signal.Signals, ...]
) -> None:
    """One puts down what is held, two hold it. The latest is told: of two that wait together, Python
    takes SIGINT first."""
    process, out, err = interrupted(desk, "CloseGripper", *others, signal.SIGTERM)
    assert process.returncode == 4
    assert "interrupted by SIGTERM" in err.splitlines()[-1]
    assert "what there is, is in 'run'" in err.splitlines()[-1]
    document = json.loads((desk / "run" / "result.json").read_text("utf-8"))
    assert document == json.loads(out)
    assert document["status"] == "aborted"
    trace = read_mcap(desk / "run" / "trace.mcap")
    put_down = [leaf.label for leaf in trace.leaves if leaf.node == "stop"]
    assert put_down == ([] if others else ["PutDown()"])
    assert document["parameters"] == [] or document["parameters"][0]["verdict"] == "not identified"


@pytest.mark.long
def test_a_signal_during_building_keeps_the_estimates(
    desk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SLOW_TWIN", "1")
    process, out, err = interrupted(desk, "building the twin", signal.SIGHUP)
    assert process.returncode == 4
    assert "interrupted by SIGHUP while building the twin" in err.splitlines()[-1]
    document = json.loads(out)
    assert (document["status"], document["stage"]) == ("aborted", "building the twin")
    assert document["parameters"][0]["verdict"] == "identified"
    assert document == json.loads((desk / "run" / "result.json").read_text("utf-8"))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_result_that_cannot_be_printed_is_no_success(desk: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "palpate", "gap", "desk.xml", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
            text=True,
            cwd=desk,
        )
    assert done.returncode == 1
    assert done.stderr == "palpate: [Errno 28] No space left on device\n"


def test_a_scratch_folder_of_a_killed_process_is_swept(tmp_path: Path) -> None:
    from palpate.runs import folder

    parent = tmp_path / "runs"
    parent.mkdir()
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    host = folder._HOST  # pyright: ignore[reportPrivateUsage]
    stale = parent / f".cup.palpate-{host}-{gone.pid}-abcd1234"
    alive = parent / f".cup.palpate-{host}-{os.getpid()}-abcd1234"
    elsewhere = parent / f".cup.palpate-00000000-{gone.pid}-abcd1234"
    other = parent / ".cup.abcd1234"
    for path in (stale, alive, elsewhere, other):
        path.mkdir()
    folder.growing_folder(parent / "cup")
    assert sorted(parent.iterdir()) == sorted([alive, elsewhere, other, parent / "cup"])
