"""Signals at random moments to a real `palpate run`: its exit status, and its folder on disk."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

from bench.campaign.ledger import Drawn, Row
from palpate.common.errors import PalpateError
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.studies.scenarios.catalogue import scenario

SCENARIO = "one_missing_mass"
KINDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
SHARES = (0.4, 0.25, 0.15, 0.2)
TWICE = 0.25
"""Share of the signals, except SIGKILL, that are followed by a second one."""
PATIENCE = 180
"""s until a process counts as hung."""
DEAF = 0.2
"""Share of an undisturbed run: a run that goes on for longer after a signal, and completes, has
ignored it."""
PALPATE = (sys.executable, "-c", "import sys; from palpate.cli.main import main; sys.exit(main())")


@dataclass(frozen=True, slots=True)
class Blow:
    """A signal: when, as a share of an undisturbed run, and s until a second one, if any."""

    kind: signal.Signals
    when: float
    again: float | None

    @classmethod
    def of(cls, case: Drawn) -> Blow:
        """Draw the signal of a case."""
        random = case.random(7)
        kind = KINDS[int(random.choice(len(KINDS), p=SHARES))]
        when = float(random.uniform(0.0, 1.05))
        again = None
        if kind is not signal.SIGKILL and random.random() < TWICE:
            again = float(random.uniform(0.05, 1.0))
        return cls(kind, when, again)

    def __str__(self) -> str:
        again = f", again after {self.again:.2f} s" if self.again else ""
        return f"{self.kind.name} at {self.when:.2f} of the run{again}"


@dataclass(frozen=True, slots=True)
class Exit:
    """End of a process: exit status, output, and s after the signal, 0 if it had ended before."""

    code: int
    said: str
    after: float


def send(case: Drawn, blank: Row, undisturbed: float) -> Row:
    """Start a run and send it a signal; `undisturbed`: duration of a run without one, s."""
    blow = Blow.of(case)
    with tempfile.TemporaryDirectory() as folder:
        return _sent(replace(blank, what=str(blow)), blow, undisturbed, Path(folder))


def _sent(blank: Row, blow: Blow, whole: float, folder: Path) -> Row:
    out = folder / "run"
    process = _start(out)
    over = _ended_within(process, blow.when * whole)
    struck = time.perf_counter()
    process.send_signal(blow.kind)
    if blow.again is not None and not _ended_within(process, blow.again):
        process.send_signal(blow.kind)
    try:
        _, errors = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return replace(blank, outcome="hung", beyond=("the process hangs",))
    after = 0.0 if over else time.perf_counter() - struck
    ended = Exit(process.returncode, errors.strip(), after)
    figures = {"code": ended.code, "folder": out.exists(), "after": round(after, 2)}
    return replace(
        blank,
        outcome=f"exit {ended.code}",
        said=tuple(ended.said.splitlines()[-2:]),
        beyond=tuple(problems(blow.kind, ended, out, DEAF * whole)),
        figures=figures,
    )


def _start(out: Path) -> subprocess.Popen[str]:
    settings = scenario(SCENARIO).settings()
    asked = ["run", "--scene", str(settings.scene), "--world", str(settings.world)]
    return subprocess.Popen(
        [*PALPATE, *asked, "--out", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"MUJOCO_GL": "disabled"},
        # Children of a campaign under `nohup` would ignore SIGHUP, as it does.
        preexec_fn=partial(signal.signal, signal.SIGHUP, signal.SIG_DFL),
    )


def _ended_within(process: subprocess.Popen[str], seconds: float) -> bool:
    """Wait for a process; False if it did not end within so many seconds."""
    try:
        process.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def problems(kind: signal.Signals, ended: Exit, out: Path, deaf: float) -> Sequence[str]:
    """List what is wrong with the end of a run and its folder: `out` must be readable, agree with the
    exit status, and lie alone. `deaf`: s that the run may take to end."""
    found: list[str] = []
    if "Traceback" in ended.said:
        found.append("a traceback")
    if kind is signal.SIGKILL:
        found += _unfinished(out)
    else:
        found += _misjudged(kind, ended, out, deaf)
    found += _unreadable(out)
    strays = [path.name for path in out.parent.iterdir() if path != out]
    if strays:
        found.append(f"left behind: {', '.join(strays)}")
    return found


def _misjudged(kind: signal.Signals, ended: Exit, out: Path, deaf: float) -> Sequence[str]:
    """The exit status must be 0 if the run was complete before the signal, 4 if that stopped it."""
    if ended.code == 0:
        if ended.after > deaf:
            return [f"not heard: it went on for {ended.after:.0f} s"]
        return [] if _status(out) == "complete" else [f"exit 0, {_status(out)}"]
    if ended.code == 4:
        if not ended.said:
            return ["exit 4 without a word"]
        return [] if _status(out) in (None, "aborted") else [f"exit 4, {_status(out)}"]
    # Before palpate has installed its handlers, a signal has its default effect.
    too_early = ended.code in (130, -kind) and not out.exists()
    return [] if too_early else [f"exit {ended.code}"]


def _status(out: Path) -> str | None:
    """Status in a run's folder; None without a folder."""
    try:
        run = _opened(out)
    except PalpateError:
        return "unreadable"
    return run.status if run else None


def _unfinished(out: Path) -> Sequence[str]:
    """Finish a killed run by `palpate report`, and list what that fails to do."""
    if not (out / "result.json").exists():
        return []
    finished = subprocess.run(
        [*PALPATE, "report", str(out)], capture_output=True, text=True, timeout=PATIENCE
    )
    if finished.returncode not in (0, 1, 4):
        return [f"palpate report: {finished.stderr.strip()[-200:]}"]
    if _status(out) == "running" or not (out / "report.html").exists():
        return ["palpate report does not finish it"]
    return []


def _unreadable(out: Path) -> Sequence[str]:
    try:
        run = _opened(out)
        lost = run is not None and (out / "trace.mcap").exists() and run.trace_if_any is None
    except PalpateError as error:
        return [f"not readable: {error}"[:200]]
    return ["the trace is not found again"] if lost else []


def _opened(out: Path) -> Run | None:
    return pipeline.reopen(out) if out.exists() else None


@cache
def undisturbed_seconds() -> float:
    """Wall time of an undisturbed run on this machine, s."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        _start(Path(folder) / "run").communicate(timeout=PATIENCE)
        return time.perf_counter() - began
