"""Whatever fails while a run is made, what was measured is in its folder, and the run says what it
falls short of."""

from __future__ import annotations

import errno
import json
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from desk import DESK, MASS, Bench
from failing import Failing
from standin import StandIn

import palpate as pp
from palpate.cli.show_run import show_result
from palpate.runs import building, keeper
from palpate.runs.api import Plan
from palpate.runs.stored import finish
from palpate.trace.mcap import read_mcap


@pytest.fixture(scope="module")
def plan() -> Plan:
    return pp.load(DESK).plan("how heavy is the mug?")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The twin is not touched in simulation, which takes longer than all the rest: it fails."""

    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("no twin today")

    monkeypatch.setattr(building, "build", broken)
    monkeypatch.setenv("MUJOCO_GL", "disable")


def result(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "result.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("moment", [0.0, 2.0, 5.0])
@pytest.mark.parametrize("member", ["state", "advance", "drain", "close"])
def test_a_robot_that_fails(plan: Plan, tmp_path: Path, member: str, moment: float) -> None:
    bench = Bench(wrap=lambda arm: Failing(arm, member, moment))
    run = plan.run(bench, out=tmp_path / "run")
    found = result(tmp_path / "run")
    assert found["stage"] is None
    assert len(read_mcap(tmp_path / "run" / "trace.mcap").samples) >= moment / 0.02 - 2
    assert (tmp_path / "run" / "report.html").exists()
    if member == "close":
        assert (run.status, found["status"]) == ("complete", "complete")
        assert run["mug.mass"].values == pytest.approx([MASS], rel=0.01)
        return
    assert found["status"] == run.status == "aborted"
    assert "ConnectionError: no answer" in found["execution"]["stopped_by"]


@pytest.mark.parametrize("part", ["truth", "footage"])
def test_a_cell_that_fails(plan: Plan, part: str) -> None:
    bench = Bench()

    def broken(*_: object) -> None:
        raise OSError("the camera is gone")

    setattr(bench, part, broken)
    run = plan.run(bench)
    assert run.status == "complete"
    assert run.truth == {}


def test_a_robot_that_cannot_be_reached_leaves_no_folder(plan: Plan, tmp_path: Path) -> None:
    bench = Bench()

    def unplugged() -> None:
        raise ConnectionError("no route to host")

    bench.robot = unplugged  # type: ignore[method-assign]
    with pytest.raises(pp.Unavailable, match="no route to host"):
        plan.run(bench, out=tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


def test_numbers_that_are_none_are_no_estimate(plan: Plan, tmp_path: Path) -> None:
    bench = Bench()

    def faulty(arm: StandIn) -> None:
        if arm.state.gripping and arm.state.t > 3.5:
            arm.put(wrench=np.full(6, np.nan))

    bench.arm.on_advance = faulty
    run = plan.run(bench, out=tmp_path / "run")
    assert run["mug.mass"].verdict == "not identified"
    assert result(tmp_path / "run")["parameters"][0]["value"] is None
    assert np.isnan(read_mcap(tmp_path / "run" / "trace.mcap").wrench).any()


@pytest.mark.parametrize(
    ("part", "left_out"),
    [
        ("take_stills", "the pictures were not made"),
        ("write_report", "report.html was not written"),
    ],
)
def test_a_page_that_fails(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: str, left_out: str
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no OpenGL\ncontext")

    monkeypatch.setattr(f"palpate.runs.report.writing.{part}", broken)
    run = plan.run(Bench(), out=tmp_path / "run")
    assert run.status == "complete"
    assert run.shortfalls == (
        "building the twin failed: RuntimeError: no twin today",
        f"{left_out}: RuntimeError: no OpenGL",
    )
    assert result(tmp_path / "run")["shortfalls"] == list(run.shortfalls)
    assert (tmp_path / "run" / "report.html").exists() == (part == "take_stills")


def test_a_folder_that_cannot_be_written_is_found_before_anything_moves(
    plan: Plan, tmp_path: Path
) -> None:
    bench = Bench()
    (tmp_path / "file").write_text("")
    with pytest.raises(pp.InputError, match="cannot write"):
        plan.run(bench, out=tmp_path / "file" / "run")
    assert bench.arm.calls == []


@contextmanager
def small_disk(size: int) -> Iterator[None]:
    """No file may grow beyond `size` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("error", [OSError("the disk is gone"), IndexError("out of range")])
def test_a_growing_trace_that_fails_is_reported(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    calls: list[object] = []

    def broken(*_: object) -> None:
        calls.append(None)
        raise error

    monkeypatch.setattr("palpate.trace.mcap.TraceStream.write", broken)
    run = plan.run(Bench(), out=tmp_path / "run")
    assert run.status == "complete"
    assert len(calls) == 1, "it is not tried again"
    line = f"the trace was not written down while it grew: {type(error).__name__}: {error}"
    assert line in run.shortfalls
    assert line in result(tmp_path / "run")["shortfalls"]
    assert len(read_mcap(tmp_path / "run" / "trace.mcap").samples) == len(run.trace.samples)  # type: ignore[union-attr]


def test_a_disk_that_is_full(plan: Plan, tmp_path: Path) -> None:
    with small_disk(30_000):
        run = plan.run(Bench(), out=tmp_path / "run")
    assert run.status == "complete"
    assert run["mug.mass"].values == pytest.approx([MASS], rel=0.01)
    assert any(
        line.startswith("trace.mcap was not written: File too large") for line in run.shortfalls
    )
    assert result(tmp_path / "run")["status"] == "complete"
    assert 10 < len(read_mcap(tmp_path / "run" / "trace.mcap").samples) < len(run.trace.samples)  # type: ignore[union-attr]
    assert not list((tmp_path / "run").glob("*.part"))


KILLED = """
import os, sys
sys.path[:0] = {path}
import desk
import palpate as pp

def kill(arm):
    calls = [call for call, _ in arm.calls]
    if calls.count({call!r}) == {times}:
        os._exit(9)

cell = desk.Bench()
cell.arm.on_advance = kill
pp.load(desk.DESK).plan("how heavy is the mug?").run(cell, out={out!r})
"""


@pytest.mark.parametrize(
    ("call", "times", "verdict"),
    [
        pytest.param("close_gripper", 1, "not identified", id="before it was weighed"),
        pytest.param("open_gripper", 2, "identified", id="after", marks=pytest.mark.long),
    ],
)
def test_a_process_that_is_killed_leaves_a_run_to_finish(
    tmp_path: Path, call: str, times: int, verdict: str
) -> None:
    out = tmp_path / "run"
    path = [str(Path(__file__).parent / "helpers")]
    code = KILLED.format(path=path, call=call, times=times, out=str(out))
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True)
    assert done.returncode == 9
    assert (result(out)["status"], result(out)["stage"]) == ("running", "executing")
    assert pp.open(out).status == "running"
    written = read_mcap(out / "trace.mcap")

    run = finish(out)
    assert run.status == result(out)["status"] == "aborted"
    assert run.estimates[0].verdict == verdict
    assert (out / "report.html").exists()
    np.testing.assert_array_equal(read_mcap(out / "trace.mcap").t, written.t)


def test_every_estimate_is_on_disk_when_it_is_made(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[str, str, int]] = []

    def look(*_: object, **__: object) -> None:
        found = result(tmp_path / "run")
        seen.append((found["status"], found["stage"], len(found["parameters"])))
        raise KeyboardInterrupt

    monkeypatch.setattr(building, "build", look)
    run = plan.run(Bench(), out=tmp_path / "run")
    assert seen == [("running", "building the twin", 1)]
    assert run.status == "aborted"
    assert run.interrupted == "interrupted while building the twin"

    monkeypatch.setattr(building, "build", lambda *_, **__: None)
    again = finish(tmp_path / "run")
    assert (again.status, again.interrupted) == ("complete", None)
    assert again["mug.mass"].values == run["mug.mass"].values


def test_a_file_that_cannot_be_written_is_named_as_lost(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The exit status says that the values are in no file, although all of them were measured."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(keeper, "write_trace", full)
    run = plan.run(Bench(), out=tmp_path / "run")
    assert run.status == "complete"
    assert run.lost == ("trace.mcap",)
    assert "trace.mcap was not written: No space left on device" in run.shortfalls
    assert show_result(run, as_json=True) == 4


def test_a_damaged_trace_is_named_and_what_was_made_from_it_is_kept(
    plan: Plan, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    plan.run(Bench(), out=folder)
    files = {name: (folder / name).read_bytes() for name in ("result.json", "report.html")}
    trace = folder / "trace.mcap"
    trace.write_bytes(trace.read_bytes()[:3000])
    run = finish(folder)
    assert run.lost == ("trace.mcap",)
    assert any("trace.mcap is damaged" in line for line in run.shortfalls)
    assert show_result(run, as_json=False) == 4
    assert files == {name: (folder / name).read_bytes() for name in files}


@pytest.mark.parametrize("kept", [0, 300])
def test_a_damaged_result_is_made_again_from_request_plan_and_trace(
    plan: Plan, tmp_path: Path, kept: int
) -> None:
    folder = tmp_path / "run"
    before = plan.run(Bench(), out=folder)["mug.mass"].value
    (folder / "result.json").write_bytes((folder / "result.json").read_bytes()[:kept])
    with pytest.raises(pp.InputError, match=r"result\.json' is not JSON"):
        pp.open(folder)
    run = finish(folder)
    assert run.status == result(folder)["status"] == "complete"
    assert run["mug.mass"].value == pytest.approx(before, rel=1e-9)
    assert pp.open(folder)["mug.mass"].value == pytest.approx(before, rel=1e-9)
