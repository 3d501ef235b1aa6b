"""A run with something going wrong at a random moment, and what may not come of it."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp

from .runs import Ended, command, processor_of, ran
from .served import Served, files, served


@dataclass(frozen=True)
class Setting:
    """A scenario that is run, what it weighs, and between which cycles a mishap strikes."""

    scenario: str
    object: str
    cycles: tuple[int, int]


ONE = Setting("one_missing_mass", "green_bottle", (1_000, 20_000))
TABLE = Setting("bottle_and_table", "bottle", (1_000, 31_000))
SLIDES = Setting("friction", "bottle", (1_000, 31_000))
ROUNDS = (ONE, ONE, TABLE, ONE, ONE, SLIDES)
"""Each mishap is met once a round."""
LATEST = 15.0
"""s of wall time from a mishap to the end of the process, on a computer that does little else."""
FALLING = 0.5
"""m/s: no arm lowers a thing so fast; what falls does it after 13 mm."""
STOPS = (4, 5)
"""Exit statuses of a run that could not go on."""
MASSES = (0.15, 0.6)
"""kg that the end effector is heavier or lighter by than Desk says, or should."""


@dataclass(frozen=True)
class Fault:
    """What happens, and with which exit status a run may end after it."""

    strike: Callable[[Served, np.random.Generator], object]
    exits: tuple[int, ...]
    first: bool = False
    """Before the run rather than in it."""


def _weigh(bench: Served, chance: np.random.Generator) -> None:
    off = chance.uniform(*MASSES) * chance.choice([-1.0, 1.0])
    bench.ask("end_effector", mass=max(0.73 + off, 0.05))


FAULTS = {
    "reflex": Fault(lambda bench, _: bench.ask("reflex"), STOPS),
    "user stop": Fault(lambda bench, _: bench.ask("user_stop", pressed=True), STOPS),
    "freeze": Fault(lambda bench, _: bench.ask("freeze", frozen=True), STOPS),
    "kill": Fault(lambda bench, _: bench.ask("kill"), STOPS),
    "cut": Fault(lambda bench, _: bench.ask("hang_up"), STOPS),
    "lost cycles": Fault(lambda bench, _: bench.ask("lose", share=0.2), (0,)),
    "hand refuses": Fault(lambda bench, _: bench.ask("hand_refuses", refuses=True), (0, *STOPS)),
    "end effector": Fault(_weigh, (0, *STOPS), first=True),
}


@dataclass
class Striker:
    """Waits for the moment of a mishap."""

    bench: Served
    fault: Fault
    held: str
    cycle: int
    chance: np.random.Generator
    at: float | None = None
    used: float = 0.0
    before: list[float] | None = None

    def __call__(self, process: subprocess.Popen[str]) -> None:
        while process.poll() is None:
            if self.fault.first or self.bench.ask("counts")["commanded"] >= self.cycle:
                break
            time.sleep(0.05)
        else:
            return
        self.before = self.bench.ask("pose", body=self.held)
        self.at, self.used = time.perf_counter(), processor_of(process.pid)
        self.fault.strike(self.bench, self.chance)


def faulted(seed: int, folder: Path) -> dict[str, Any]:
    """The run of a seed with its mishap."""
    chance = np.random.default_rng([17, seed])
    name, here = list(FAULTS)[seed % len(FAULTS)], ROUNDS[seed // len(FAULTS) % len(ROUNDS)]
    fault, cycle = FAULTS[name], int(chance.integers(*here.cycles))
    with served(**files(here.scenario), seed=seed, fastest=1.0) as bench:
        rest = bench.ask("pose", body=here.object)
        striker = Striker(bench, fault, here.object, cycle, chance)
        ended = ran(command(here.scenario, bench, folder), striker)
        over = time.perf_counter()
        fate = _fate(bench, name)
        truth = None if fate is None else bench.ask("truth", name=f"{here.object}.mass")
    end, work = 0.0, 0.0
    if striker.at is not None and ended.exit != 0:
        end, work = over - striker.at, ended.processor - striker.used
    row = {
        "fault": name,
        "scenario": here.scenario,
        "at": cycle * 1e-3,
        "struck": striker.at is not None,
        "exit": ended.exit,
        "end": end,
        "work": work,
        "fell": 0.0 if fate is None else fate["fell"],
        "held": striker.before is not None and striker.before[2] > rest[2] + 0.005,
        "said": _said(folder, ended),
    }
    return row | {"wrong": _wrong(row, fault, folder, ended, (f"{here.object}.mass", truth))}


def _fate(bench: Served, name: str) -> dict[str, Any] | None:
    """What became of the object; nobody knows where nobody answers any more."""
    if name == "kill":
        return None
    if name == "freeze":
        bench.ask("freeze", frozen=False)
        time.sleep(0.5)
    return bench.ask("counts")


def _said(folder: Path, ended: Ended) -> str:
    if folder.exists():
        done = pp.open(folder).execution
        if done is not None:
            return done.stopped_by or ""
    lines = [line for line in ended.told.splitlines() if line.strip()]
    return lines[-1] if lines else ""


def _wrong(
    row: dict[str, Any],
    fault: Fault,
    folder: Path,
    ended: Ended,
    truth: tuple[str, list[float] | None],
) -> list[str]:
    """What should not be so; `truth` is a name and its true value, where anybody could tell it."""
    name, value = truth
    found: list[str] = []
    if not row["struck"] and row["exit"] != 0:
        found.append("ended before anything happened")
    if row["struck"] and row["exit"] not in fault.exits:
        found.append(f"exit {row['exit']}")
    if row["end"] > LATEST:
        found.append(f"ended after {row['end']:.1f} s")
    if row["fell"] > FALLING:
        found.append("something fell")
    if row["exit"] and not row["said"]:
        found.append("nothing was said")
    if "Traceback" in ended.told:
        found.append("a traceback")
    if row["exit"] == 4:
        found += _unreadable(folder)
    if row["exit"] == 0 and value is not None:
        low, high = pp.open(folder)[name].intervals[0]
        if not low <= value[0] <= high:
            found.append("a wrong mass is called identified")
    return found


def _unreadable(folder: Path) -> list[str]:
    """What is wrong with the folder of a run that was stopped."""
    if not folder.exists():
        return ["no folder"]
    run = pp.open(folder)
    found = [name for name in ("result.json", "report.html") if not (folder / name).exists()]
    if run.status != "aborted":
        found.append(f"status {run.status}")
    if run.trace_if_any is None or not len(run.trace.samples):
        found.append("no trace")
    return found
