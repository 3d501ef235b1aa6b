"""Faults during a run that weighs a bottle: more than sixty kinds, each at five moments.

Every run must end without a traceback, keep its trace, and drop nothing that holding still would
have kept.
"""

from __future__ import annotations

import resource
import tempfile
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import Mock, patch

import numpy as np

from bench.campaign.ledger import Row, touches_of
from bench.faults.faulty import FaultyRobot
from bench.faults.kinds import FAULTS, OBJECT, Fault
from bench.harm.judge import Harm, harm
from palpate.common.errors import PalpateError
from palpate.execution.harm import FALLS
from palpate.execution.rehearsal import AFTERWARDS
from palpate.execution.simulated_cell import SimulatedCell, simulated_cell
from palpate.runs import executing, pipeline, workplace
from palpate.runs.callbacks import RunCallbacks
from palpate.runs.run import Run
from palpate.studies.scenarios.catalogue import scenario

SCENARIO = "one_missing_mass"
MOMENTS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the undisturbed run's robot time."""


@dataclass(frozen=True, slots=True)
class Case:
    """A fault at one of the moments."""

    fault: str
    moment: float

    @property
    def name(self) -> str:
        return f"{self.fault} @ {self.moment:g}"

    def blank(self) -> Row:
        return Row.named("runtime", self.name, self.fault)


# All faults at mid-run first, with the bottle in the hand.
CASES = tuple(
    sorted(
        (Case(fault.name, moment) for fault in FAULTS for moment in MOMENTS),
        key=lambda case: abs(case.moment - 0.5),
    )
)


class _Cell:
    """A cell with a faulty robot."""

    def __init__(self, cell: SimulatedCell, fault: Fault, moment: float) -> None:
        self._cell, self._fault, self._moment = cell, fault, moment
        self.made: FaultyRobot | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cell, name)

    def robot(self) -> FaultyRobot:
        self.made = FaultyRobot(self._cell.robot(), self._moment)
        self._fault.meddle(self.made)
        return self.made


class _Watcher:
    """Observer that fails at a moment."""

    def __init__(self, moment: float) -> None:
        self._moment = moment

    def on_tick(self, snapshot: Any) -> None:
        if snapshot.elapsed >= self._moment:
            raise RuntimeError("the watcher fails")


@cache
def duration() -> float:
    """Robot time of the undisturbed run, s."""
    settings = scenario(SCENARIO).settings(noise="lab", seed=0)
    made = pipeline.plan(settings, pipeline.load(settings))
    cell = simulated_cell(made.scene, settings.world, noise="lab", seed=0)
    return executing.perform(made.plan, made.scene, cell.robot()).robot_seconds


def strike(case: Case, blank: Row) -> Row:
    """Carry out a run with a fault, from the plan to the folder on disk."""
    (fault,) = [fault for fault in FAULTS if fault.name == case.fault]
    moment = case.moment * duration()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as patched:
        settings = scenario(SCENARIO).settings(noise="lab", seed=0, out=Path(folder) / "run")
        scene = pipeline.load(settings)
        inner = simulated_cell(scene, settings.world, noise="lab", seed=0)
        cell = _Cell(inner, fault, moment)
        patched.enter_context(patch.object(workplace, "cell_for", return_value=cell))
        patched.enter_context(_small_disk(fault.bytes))
        failing: list[Mock] = []
        for place in fault.patches:
            failing.append(
                patched.enter_context(patch(place.replace(":", "."), side_effect=_failing))
            )
        observer = _Watcher(moment) if fault.name == "watcher fails" else None
        run, said = None, ()
        try:
            run = pipeline.run(settings, RunCallbacks(observer))
        except PalpateError as error:
            status, said = type(error).__name__, (str(error)[:300],)
        else:
            status = run.status
        blank = replace(blank, outcome=status, said=said)
        if cell.made is None:
            return blank
        wrong = wrong_estimates(run) if run and fault.honest else []
        row = _row(blank, fault, cell.made, Path(folder) / "run", wrong)
        struck = cell.made.last >= moment and all(part.called for part in failing)
        return replace(row, figures=row.figures | {"struck": struck})


@contextmanager
def _small_disk(size: int | None) -> Generator[None]:
    """Limit the size of files to `size` bytes inside the block."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        if size is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


def wrong_estimates(run: Run) -> list[str]:
    """Identified values that are off by more than five standard deviations and more than 5 %."""
    found: list[str] = []
    for estimate in run.estimates:
        true = run.truth.get(estimate.parameter)
        if true is None or estimate.verdict != "identified":
            continue
        error = np.abs(estimate.values - true)
        if (error > 5 * estimate.stds).any() and (error > 0.05 * np.abs(true)).any():
            shown = f"{estimate.values.round(4).tolist()} ± {estimate.stds.round(4).tolist()}"
            found.append(f"{estimate.parameter} identified as {shown}, is {list(true)}")
    return found


def _row(blank: Row, fault: Fault, robot: FaultyRobot, folder: Path, wrong: list[str]) -> Row:
    robot.outlast(AFTERWARDS)
    seen = harm(robot.witness, (OBJECT,))
    figures, kept = _kept(folder, robot)
    stopped_by = figures.pop("stopped_by")
    beyond = [*chargeable(seen, fault), *wrong]
    if not kept and fault.bytes is None:
        beyond.append("trace lost")
    return replace(
        blank,
        said=blank.said or ((str(stopped_by),) if stopped_by else ()),
        beyond=tuple(beyond),
        touches=touches_of(seen),
        figures=figures | {"dropped": list(seen.fallen), "preventable": fault.holds},
    )


def chargeable(seen: Harm, fault: Fault) -> list[str]:
    """Harm that the arm is responsible for: without forces that somebody outside causes, and without
    the loss of a load that holding still would not have kept."""
    found: list[str] = []
    if fault.honest:
        found += seen.forces
    for fate in seen.fates:
        pushed = not fault.honest and fate.what not in FALLS
        lost = not fault.holds and fate.name == OBJECT
        if not pushed and not lost:
            found.append(str(fate))
    return found


def _kept(folder: Path, robot: FaultyRobot) -> tuple[dict[str, Any], bool]:
    """Figures read from the run's folder, and whether its trace reaches the fault."""
    figures: dict[str, Any] = {"robot_seconds": round(robot.last, 2), "stopped_by": ""}
    if not (folder / "result.json").exists():
        return figures, False
    again = pipeline.reopen(folder)
    trace, ended = again.trace, again.execution
    until = float(trace.samples.t[-1]) if trace and len(trace.samples.t) else 0.0
    reach = min(robot.moment, robot.last) - 0.2
    stopped = ended.stopped_by if ended else ""
    return {**figures, "trace": round(until, 2), "stopped_by": stopped}, until >= reach


def _failing(*_: Any, **__: Any) -> None:
    raise RuntimeError("on purpose")
