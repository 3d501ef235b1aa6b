"""`palpate run --robot franky://HOST`, as a person at a terminal sees it: from rehearsal to report."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.fci.served import ROOT, Served, served

pytestmark = pytest.mark.long

pytest.importorskip("franky", reason="franky-control has no wheel for this machine")

DESK = """<mujoco><worldbody>
  <geom name="desk" type="box" size=".3 .4 .1" pos=".5 0 {z}"/>
  <body name="mug" pos=".5 .2 .25"><freejoint/><geom type="box" size=".03 .03 .05" mass=".3"/></body>
</worldbody></mujoco>"""
TOP = 0.2
PATIENCE = 120.0
"""s of wall time for anything to be said."""


@dataclass(frozen=True)
class Desk:
    """A served arm before a desk of unknown height, and the user's file."""

    bench: Served
    scene: Path


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    folder = tmp_path_factory.mktemp("desk")
    scene, world = folder / "desk.xml", folder / "world.xml"
    scene.write_text(DESK.format(z="?"))
    world.write_text(DESK.format(z=".1"))
    with served(scene, world, fastest=1.0) as bench:
        yield Desk(bench, scene)


def command(desk: Desk, out: Path, *more: str) -> list[str]:
    words = [sys.executable, "-m", "palpate", "run", "--scene", str(desk.scene)]
    words += ["-r", "how high is the desk?"]
    return [*words, "--robot", f"franky://{desk.bench.address}", "--out", str(out), *more]


def environment() -> dict[str, str]:
    paths = {"PYTHONPATH": str(ROOT / "src"), "TERM": "dumb", "COLUMNS": "400"}
    return {**os.environ, **paths, "OMP_NUM_THREADS": "1"}


@dataclass
class Terminal:
    """A person at a terminal, with a command under way."""

    words: list[str]
    seen: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self.line, theirs = pty.openpty()
        self.process = subprocess.Popen(
            self.words,
            cwd=ROOT,
            env=environment(),
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
        )
        os.close(theirs)

    def sees(self, words: str) -> None:
        """Wait until that was printed."""
        until = time.monotonic() + PATIENCE
        while words not in self.seen:
            assert time.monotonic() < until, self.seen
            try:
                self.seen += os.read(self.line, 4096).decode(errors="replace")
            except OSError:
                pytest.fail(f"it ended without '{words}':\n{self.seen}")

    def types(self, words: str) -> None:
        os.write(self.line, f"{words}\n".encode())

    def ends(self) -> int:
        """Its exit status, once all that it prints was read."""
        while True:
            try:
                more = os.read(self.line, 4096)
            except OSError:  # Linux says so of a terminal that nobody writes to any more
                return self.process.wait(PATIENCE)
            self.seen += more.decode(errors="replace")

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.line)


def test_a_stopped_arm_without_anybody_at_a_terminal_is_unavailable(
    desk: Desk, tmp_path: Path
) -> None:
    desk.bench.ask("user_stop", pressed=True)
    out = tmp_path / "run"
    words = command(desk, out, "--yes", "--on-failure", "replan")
    done = subprocess.run(
        words, cwd=ROOT, env=environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert done.returncode == 5
    assert "stopped by the user stop: release the user stop" in done.stderr
    assert "at a terminal" in done.stderr
    assert not out.exists()


def test_a_confirmed_run_goes_from_rehearsal_to_report(desk: Desk, tmp_path: Path) -> None:
    """Somebody left the user stop pressed; it is released before the answer."""
    desk.bench.ask("user_stop", pressed=True)
    out = tmp_path / "run"
    with closing(Terminal(command(desk, out))) as person:
        person.sees("move? (--yes skips this question)")
        assert "rehearsal: " in person.seen
        person.types("y")
        person.sees("Let it go on?")
        assert "stopped by the user stop" in person.seen
        desk.bench.ask("user_stop", pressed=False)
        person.types("y")
        assert person.ends() == 0, person.seen
    result = json.loads((out / "result.json").read_text())
    (height,) = result["parameters"]
    assert result["status"] == "complete"
    assert not result["simulated"]
    assert result["rehearsal"]["failure"] is None
    assert "a person let the robot go on at" in result["execution"]["setbacks"][0]
    assert height["value"] == pytest.approx(TOP, abs=1e-3)
    assert height["std"] == pytest.approx(5e-3, rel=0.1)
    assert "calibrate --gauge" in height["method"]
    assert (out / "report.html").exists()
    assert not (out / "cycles.npz").exists()
    assert desk.bench.ask("counts")["lost"] == 0


def test_nothing_moves_without_an_answer(desk: Desk, tmp_path: Path) -> None:
    moved = desk.bench.ask("counts")["commanded"]
    out = tmp_path / "run"
    with closing(Terminal(command(desk, out))) as person:
        person.sees("move? (--yes skips this question)")
        person.types("n")
        assert person.ends() == 4
    assert "nothing has moved" in person.seen
    assert desk.bench.ask("counts")["commanded"] == moved
    assert not out.exists()
