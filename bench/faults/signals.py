"""Signals at random moments at a real `palpate run`: how it exits, and what is left on disk."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

from bench.campaign.ledger import Drawn, Ledger, Row, drawn, within_time
from palpate import pipeline
from palpate.errors import PalpateError
from palpate.runs.run import Run
from palpate.scenarios.catalogue import scenario

SCENARIO = "one_missing_mass"
KINDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
SHARES = (0.4, 0.25, 0.15, 0.2)
TWICE = 0.25
"""Share of the signals, SIGKILL excepted, that a second one follows."""
PATIENCE = 180
"""s until a process counts as hung."""
DEAF = 0.2
"""Of a whole run: one that goes on for longer after a signal, and then ends well, has not heard it."""
PALPATE = (sys.executable, "-c", "import sys; from palpate.cli.main import main; sys.exit(main())")


@dataclass(frozen=True, slots=True)
class Blow:
    """A signal: when, as a share of a whole run, and s until the second one, if any."""

    kind: signal.Signals
    when: float
    again: float | None

    @classmethod
    def of(cls, case: Drawn) -> Blow:
        """The one that a case is about."""
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
    """How a process ended: its status, what it said, and s from the signal on, 0 where it had ended
    before."""

    code: int
    said: str
    after: float


def sent(case: Drawn, whole: float) -> Row:
    """What becomes of a run that is sent a signal; `whole`: s that an undisturbed one takes."""
    blow = Blow.of(case)
    blank = case.blank(str(blow))

    def work() -> Row:
        with tempfile.TemporaryDirectory() as folder:
            return _sent(blank, blow, whole, Path(folder))

    return within_time(work, blank)


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
        preexec_fn=_hear,
    )


def _hear() -> None:
    """A campaign under `nohup` hears no SIGHUP, and would hand that down."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def _ended_within(process: subprocess.Popen[str], seconds: float) -> bool:
    """Whether a process ended within so many seconds."""
    try:
        process.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def problems(kind: signal.Signals, ended: Exit, out: Path, deaf: float) -> Sequence[str]:
    """What is wrong with how a run ended, and with what lies on disk: its folder `out` is readable
    and says the same, and nothing else is there. `deaf`: s that it may take to end."""
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
    """An exit status is 0 when all was done before the signal, 4 when it stopped the run. Before
    Python has come as far as palpate, a signal does what it always does."""
    if ended.code == 0:
        if ended.after > deaf:
            return [f"not heard: it went on for {ended.after:.0f} s"]
        return [] if _status(out) == "complete" else [f"exit 0, {_status(out)}"]
    if ended.code == 4:
        if not ended.said:
            return ["exit 4 without a word"]
        return [] if _status(out) in (None, "aborted") else [f"exit 4, {_status(out)}"]
    too_early = ended.code in (130, -kind) and not out.exists()
    return [] if too_early else [f"exit {ended.code}"]


def _status(out: Path) -> str | None:
    """What a run's folder says of it; None without one."""
    try:
        run = _opened(out)
    except PalpateError:
        return "unreadable"
    return run.status if run else None


def _unfinished(out: Path) -> Sequence[str]:
    """What `palpate report` leaves undone of a run that was killed."""
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
def whole_run() -> float:
    """s of wall time that an undisturbed run takes on this machine now."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        _start(Path(folder) / "run").communicate(timeout=PATIENCE)
        return time.perf_counter() - began


def send(
    folder: Path, count: int, seed: int, workers: int, say: Callable[[str], None]
) -> list[Row]:
    """`count` runs, one signal each."""
    work = partial(sent, whole=whole_run())
    cases = drawn("signals", seed, count)
    return Ledger(folder / "signals.jsonl").complete(cases, work, workers, say)
