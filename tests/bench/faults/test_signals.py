"""How a run that a signal came to may end, and how not."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from bench.campaign.ledger import drawn
from bench.faults.signals import Blow, Exit, problems

INT, KILL = signal.SIGINT, signal.SIGKILL


def run_folder(parent: Path, status: str, stage: str | None = None) -> Path:
    """A run's folder with nothing in it but how it ended."""
    out = parent / "run"
    out.mkdir()
    execution = {"status": "stopped", "stopped_by": "interrupted", "actions": 3, "setbacks": []}
    execution |= {"robot_seconds": 4.0, "wall_seconds": 1.0}
    if status == "complete":
        execution |= {"status": "complete", "stopped_by": None}
    result = {
        "status": status,
        "stage": stage,
        "interrupted": None,
        "simulated": True,
        "parameters": [],
        "rehearsal": None,
        "twin": None,
        "plan": {"findings": []},
        "execution": execution,
        "provenance": {"world": "here"},
        "shortfalls": [],
    }
    plan = {
        "parameters": [],
        "explanation": "",
        "tree": {"type": "Sequence", "children": [{"type": "OpenGripper"}]},
    }
    for name, content in (("result", result), ("plan", plan), ("request", {})):
        (out / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    return out


def found(ended: Exit, out: Path, kind: signal.Signals = INT) -> list[str]:
    return list(problems(kind, ended, out, deaf=5.0))


def test_a_run_may_end_well_before_a_signal_and_stopped_after_it(tmp_path: Path) -> None:
    nowhere = tmp_path / "run"
    assert found(Exit(130, "", 0.1), nowhere) == []
    assert found(Exit(-INT, "", 0.1), nowhere) == []
    assert found(Exit(4, "interrupted while planning", 0.1), nowhere) == []
    out = run_folder(tmp_path, "complete")
    assert found(Exit(0, "", 0.0), out) == []


def test_every_other_ending_is_found(tmp_path: Path) -> None:
    out = run_folder(tmp_path, "complete")
    assert found(Exit(0, "", 9.0), out) == ["not heard: it went on for 9 s"]
    assert found(Exit(4, "stopped", 1.0), out) == ["exit 4, complete"]
    assert found(Exit(4, "", 1.0), out) == ["exit 4 without a word"]
    assert found(Exit(130, "", 1.0), out) == ["exit 130"]
    assert found(Exit(1, "Traceback (most recent…", 1.0), out) == ["a traceback", "exit 1"]


def test_a_folder_that_says_something_else_is_found(tmp_path: Path) -> None:
    out = run_folder(tmp_path, "aborted")
    assert found(Exit(4, "stopped", 1.0), out) == []
    assert found(Exit(0, "", 1.0), out) == ["exit 0, aborted"]
    (tmp_path / ".run-scratch").mkdir()
    assert found(Exit(4, "stopped", 1.0), out) == ["left behind: .run-scratch"]
    (out / "result.json").write_text("{", encoding="utf-8")
    status, folder, stray = found(Exit(4, "stopped", 1.0), out)
    assert (status, stray) == ("exit 4, unreadable", "left behind: .run-scratch")
    assert folder.startswith("not readable: ")


def test_signals_of_all_kinds_are_drawn_over_the_whole_run() -> None:
    blows = [Blow.of(case) for case in drawn("signals", 0, 100)]
    assert {blow.kind for blow in blows} == {INT, KILL, signal.SIGTERM, signal.SIGHUP}
    assert min(blow.when for blow in blows) < 0.05
    assert max(blow.when for blow in blows) > 0.95
    assert any(blow.again for blow in blows)
    assert "SIG" in str(blows[0])


@pytest.mark.parametrize("kind", [INT, signal.SIGTERM])
def test_a_hang_up_before_palpate_has_begun_is_itself(kind: signal.Signals, tmp_path: Path) -> None:
    assert found(Exit(-kind, "", 0.0), tmp_path / "run", kind) == []
    assert found(Exit(-KILL, "", 0.0), tmp_path / "run", kind) == [f"exit {-KILL}"]
