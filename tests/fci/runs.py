"""One run of the command line on a served arm, and what it gave beside the truth."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.robots.owner import load_description
from palpate.studies.scenarios.catalogue import scenario

from .served import ROOT, Served, files, served

SCENARIOS = ("bottle_and_table", "friction", "hammer", "occlusion", "one_missing_mass")
PATIENCE = 900.0
"""s of wall time after which a run is given up."""
GAUGED = 2e-4
"""m (1 sigma) to which somebody has gauged the fingertips of these arms, as their worlds draw them."""
MASTER = [sys.executable, "-m", "palpate", "run"]


@dataclass(frozen=True)
class Ended:
    """A process that has ended.

    Attributes:
        exit: its status. told: what it wrote to stderr. seconds: of wall time that it took.
        processor: s of one that it took.
    """

    exit: int
    told: str
    seconds: float
    processor: float


def command(name: str, bench: Served, folder: Path) -> list[str]:
    """The command line that runs a bundled scenario on a served arm."""
    settings = scenario(name).settings()
    known = folder.with_name(f"{folder.name}.robot.yaml")
    known.write_text(f"tip_offset: {{value: {load_description().tip}, std: {GAUGED}}}\n")
    words = [*MASTER, "--robot", f"franky://{bench.address}", "--out", str(folder), "--yes"]
    words += ["--scene", str(settings.scene), "--robot-config", str(known)]
    if settings.poses is not None:
        words += ["--poses", str(settings.poses)]
    if settings.request is not None:
        words += ["-r", settings.request]
    return words


def ran(
    words: list[str], meanwhile: Callable[[subprocess.Popen[str]], None] | None = None
) -> Ended:
    """What came of a command line; `meanwhile` is called while it runs."""
    began, used = time.perf_counter(), _processor()
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        words,
        cwd=ROOT,
        env=environment,
        text=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    if meanwhile is not None:
        meanwhile(process)
    _, told = process.communicate(timeout=PATIENCE)
    return Ended(process.returncode, told, time.perf_counter() - began, _processor() - used)


def _processor() -> float:
    """s of a processor that processes took which this one waited for."""
    waited = resource.getrusage(resource.RUSAGE_CHILDREN)
    return waited.ru_utime + waited.ru_stime


def processor_of(pid: int) -> float:
    """s of a processor that a running process took (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measured(name: str, noise: str, seed: int, folder: Path) -> dict[str, Any]:
    """A scenario on the arm and in the world of a seed: errors, stated widths, cycles, forces."""
    with served(**files(name), noise=noise, seed=seed, fastest=1.0) as bench:
        ended = ran(command(name, bench, folder))
        counts = bench.ask("counts")
        row = {
            "exit": ended.exit,
            "wall": ended.seconds,
            "lost": counts["lost"],
            "commanded": counts["commanded"],
            "ms": counts["ms"],
            "peak": counts["peak"],
            "fell": counts["fell"],
        }
        if not folder.exists():
            nothing = {"step": 0.0, "robot_seconds": 0.0, "values": {}, "status": None}
            return row | nothing | {"stopped_by": ended.told[-300:]}
        run = pp.open(folder)
        values = {str(e.parameter): _beside_truth(e, bench) for e in run.estimates}
    done = run.execution
    return row | {
        "status": run.status,
        "stopped_by": None if done is None else done.stopped_by,
        "robot_seconds": 0.0 if done is None else done.robot_seconds,
        "step": largest_step(run),
        "values": values,
    }


def _beside_truth(estimate: Any, bench: Served) -> dict[str, Any]:
    """The component that is off by most of what is stated: its error, the half width of its 95 %
    interval, and whether all components are inside theirs."""
    truth = bench.ask("truth", name=str(estimate.parameter))
    if not estimate.value or truth is None:
        return {"error": float("nan"), "within": 0.0, "inside": False, "verdict": estimate.verdict}
    seen = [verdict == "identified" for verdict in estimate.verdicts or [estimate.verdict]]
    off = np.array(estimate.value) - np.array(truth)[: len(estimate.value)]
    bounds = np.array(estimate.intervals)
    half = (bounds[:, 1] - bounds[:, 0]) / 2
    kept = np.array(seen) if any(seen) else np.ones(len(off), dtype=bool)
    worst = int(np.argmax(np.where(kept, np.abs(off) / half, -1.0)))
    return {
        "error": float(off[worst]),
        "within": float(half[worst]),
        "inside": bool((np.abs(off) <= half)[kept].all()),
        "verdict": estimate.verdict,
        "errors": off.tolist(),
    }


def largest_step(run: pp.Run) -> float:
    """m that the commanded target moved in a cycle at most, while a probe was under way."""
    trace, most = run.trace_if_any, 0.0
    if trace is None:
        return most
    for leaf in trace.leaves:
        if not leaf.label.startswith("MoveUntilContact"):
            continue
        samples = trace.samples.between(leaf.start, leaf.end)
        steps = np.linalg.norm(np.diff(samples.target_world_tcp[:, :3], axis=0), axis=1)
        cycles = np.maximum(np.round(np.diff(samples.t) / 0.001), 1)
        if len(steps):
            most = max(most, float((steps / cycles).max()))
    return most
