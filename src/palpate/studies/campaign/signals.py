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

import numpy as np

from palpate import pipeline
from palpate.errors import PalpateError
from palpate.scenarios.catalogue import scenario
from palpate.studies.campaign.ledger import Ledger, Row, within_time

SCENARIO = "one_missing_mass"
KINDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
SHARES = (0.4, 0.25, 0.15, 0.2)
TWICE = 0.25
"""Share of the signals, SIGKILL excepted, that a second one follows."""
PATIENCE = 180
"""s until a process counts as hung."""
CODES = {0, 4, 130}
"""Exit statuses that a signal may end in: done before it came, stopped, or not yet begun."""
PALPATE = (sys.executable, "-c", "import sys; from palpate.cli.main import main; sys.exit(main())")


@dataclass(frozen=True, slots=True)
class Case:
    """One run that is sent a signal, drawn from a seed."""

    seed: int
    number: int

    @property
    def name(self) -> str:
        return f"{self.seed}/{self.number}"

    def drawn(self) -> tuple[signal.Signals, float, float | None]:
        """The signal, when (share of a whole run), and s until the second one, if any."""
        random = np.random.default_rng([self.seed, self.number, 7])
        kind = KINDS[int(random.choice(len(KINDS), p=SHARES))]
        when = float(random.uniform(0.0, 1.05))
        again = None
        if kind is not signal.SIGKILL and random.random() < TWICE:
            again = float(random.uniform(0.05, 1.0))
        return kind, when, again


def sent(case: Case, whole: float) -> Row:
    """What becomes of a run that is sent a signal; `whole`: s that an undisturbed one takes."""
    kind, when, again = case.drawn()
    what = f"{kind.name} at {when:.2f} of the run" + (
        f", again after {again:.2f} s" if again else ""
    )
    command = f"palpate study faults --kind signals --seed {case.seed} --case {case.number}"
    blank = Row("signals", case.name, what, command, "")

    def work() -> Row:
        with tempfile.TemporaryDirectory() as folder:
            return _sent(blank, kind, when * whole, again, Path(folder))

    return within_time(work, blank)


def _sent(blank: Row, kind: signal.Signals, after: float, again: float | None, folder: Path) -> Row:
    out = folder / "run"
    process = _start(out)
    wait_for(process, after)
    process.send_signal(kind)
    if again is not None and not wait_for(process, again):
        process.send_signal(kind)
    try:
        _, errors = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return replace(blank, outcome="hung", beyond=("the process hangs",))
    beyond = [
        *_exit_problems(kind, process.returncode, errors),
        *_folder_problems(kind, out, folder),
    ]
    said = tuple(line for line in errors.strip().splitlines()[-2:])
    figures = {"code": process.returncode, "folder": out.exists(), "after": round(after, 2)}
    return replace(
        blank,
        outcome=f"exit {process.returncode}",
        said=said,
        beyond=tuple(beyond),
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
    )


def wait_for(process: subprocess.Popen[str], seconds: float) -> bool:
    """Whether a process ended within so many seconds."""
    try:
        process.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def _exit_problems(kind: signal.Signals, code: int, errors: str) -> Sequence[str]:
    problems: list[str] = []
    if "Traceback" in errors:
        problems.append("a traceback")
    if kind is signal.SIGKILL:
        return problems
    # Before Python has come as far as palpate, a signal does what it always does.
    if code not in CODES and code != -kind:
        problems.append(f"exit {code}")
    if code == 4 and not errors.strip():
        problems.append("exit 4 without a word")
    return problems


def _folder_problems(kind: signal.Signals, out: Path, folder: Path) -> Sequence[str]:
    """What is wrong with what lies on disk: a run folder is readable, and nothing else is there."""
    problems: list[str] = []
    if out.exists():
        if kind is signal.SIGKILL:
            finished = subprocess.run(
                [*PALPATE, "report", str(out)], capture_output=True, text=True, timeout=PATIENCE
            )
            if finished.returncode not in (0, 4) and (out / "trace.mcap").exists():
                problems.append(f"palpate report: {finished.stderr.strip()[-200:]}")
        problems += _unreadable(out)
    strays = [path.name for path in folder.iterdir() if path != out]
    if strays:
        problems.append(f"left behind: {', '.join(strays)}")
    return problems


def _unreadable(out: Path) -> Sequence[str]:
    try:
        trace = pipeline.reopen(out).trace
    except PalpateError as error:
        return [f"not readable: {error}"[:200]]
    if (out / "trace.mcap").exists() and trace is None:
        return ["the trace is not found again"]
    return []


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
    cases = [Case(seed, number) for number in range(count)]
    work = partial(sent, whole=whole_run())
    return Ledger(folder / "signals.jsonl").complete(cases, _name, work, workers, say)


def _name(case: Case) -> str:
    return case.name
