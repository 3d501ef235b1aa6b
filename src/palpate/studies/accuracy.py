"""Accuracy study: errors and coverage of a scenario's estimates over many seeds, against the hidden
truth.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.balance import accuracy as pose_accuracy
from palpate.estimation.estimate import Estimate, Verdict
from palpate.execution.cell import Cell
from palpate.execution.simulated_cell import SimulatedCell
from palpate.planning.registry import OWN
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.runs.workplace import cell_for
from palpate.scene.load import rearrange
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import scenario
from palpate.studies.workers import spread

CRASHED = "crashed"  # Status of a seed that ended in an error of the program itself
# Index of the random stream for displaced objects, independent of all other streams of a seed.
POSE_STREAM = 16


@dataclass(frozen=True, slots=True)
class ScoredEstimate:
    """Component of a seed's estimate and its true value, in the quantity's SI unit."""

    parameter: Parameter  # estimated
    component: int  # index into a vector quantity; 0 for a scalar
    seed: int  # of the run
    # value, std: the estimate and its stated standard deviation.
    value: float
    std: float
    # low, high: its 95 % interval.
    low: float
    high: float
    truth: float  # value of the hidden world
    single_shot: float | None  # for masses, the naive mean of F_z/g from the same recording
    unit: str = ""  # as printed
    verdict: Verdict = "identified"  # of this component
    # The interval reaches a physical bound, which is the only obstacle to its identification.
    at_bound: bool = False

    @property
    def is_evidence(self) -> bool:
        """True if the value depends on the recordings only, as `Estimate.is_evidence`."""
        return self.verdict == "identified" or self.at_bound

    @property
    def is_covered(self) -> bool:
        """True if the 95 % interval contains the truth."""
        return self.low <= self.truth <= self.high

    @property
    def error(self) -> float:
        """Error: value less truth."""
        return self.value - self.truth


@dataclass(frozen=True, slots=True)
class MissingComponent:
    """Component that a seed left without a value."""

    parameter: Parameter
    component: int
    seed: int
    truth: float
    unit: str
    reason: str

    @property
    def verdict(self) -> Verdict:
        """The only verdict without a value."""
        return "not identified"


@dataclass(frozen=True, slots=True)
class SeedRun:
    """Result of a seed: end of the run, effort, and estimates with their true values."""

    seed: int  # of the run
    status: str  # of the run, or `CRASHED`
    actions: int  # leaves that were started
    robot_seconds: float  # duration of the execution
    # Components that depend on the recordings only: identified ones, and those at a physical bound.
    estimates: tuple[ScoredEstimate, ...]
    doubted: tuple[ScoredEstimate, ...] = ()  # other components with a value
    unmeasured: tuple[MissingComponent, ...] = ()  # components without a value
    # wall_seconds, cpu_seconds: of the whole run, with planning and estimation.
    wall_seconds: float = field(default=0.0, compare=False)
    cpu_seconds: float = field(default=0.0, compare=False)
    crash: str = ""  # a traceback


@dataclass(frozen=True, slots=True)
class Question:
    """A bundled scenario that is run over all seeds. `changes` are fields of its `Settings`."""

    scenario: str
    changes: tuple[tuple[str, Any], ...] = ()

    @property
    def settings(self) -> Settings:
        """Settings of the run. The machine that runs it finds the scenario's files."""
        return scenario(self.scenario).settings(**dict(self.changes))


@dataclass(frozen=True, slots=True)
class StudyCase:
    """A question with a seed."""

    question: Question
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class PreparedStudy:
    """Checked plan of a question, and its simulated world as read from the file."""

    run: Run
    cell: Cell | None  # None for a world without a file, whose unknowns each seed draws

    @classmethod
    def of(cls, settings: Settings) -> PreparedStudy:
        """Plan by the settings, and read their world."""
        planned = pipeline.plan(settings, pipeline.load(settings))
        if not planned.ready or settings.world is None:
            return cls(planned, None)
        return cls(planned, cell_for(settings, planned.scene, planned.seen is not None))

    def for_seed(self, settings: Settings) -> tuple[Run, Cell | None]:
        """Return the planned run with the seed of `settings`, and its cell."""
        planned = replace(self.run, settings=replace(self.run.settings, seed=settings.seed))
        if isinstance(self.cell, SimulatedCell):
            return planned, replace(self.cell, seed=settings.seed)
        return planned, self.cell


@lru_cache(1)
def _prepare(question: Question) -> PreparedStudy | None:
    """Prepare plan and cell once for all seeds; None if a seed may change the plan (a picture) or the cell."""
    settings = question.settings
    varies = settings.scene is None or settings.images or settings.robot_config is not None
    return None if varies or settings.planner not in OWN else PreparedStudy.of(settings)


def accuracy(settings: Settings, seeds: Sequence[int], workers: int = 1) -> list[SeedRun]:
    """Run all seeds, in order. Each run is deterministic, and independent of the count of workers."""
    return spread(partial(run_seed, settings), seeds, workers)


def run_case(case: StudyCase) -> SeedRun:
    """Run a case with randomly displaced objects. An exception becomes a crashed run."""
    try:
        shared = _prepare(case.question)
        return run_seed(case.question.settings, case.seed, displaced=True, shared=shared)
    except Exception:  # one failed seed must not end a campaign of hours
        return crashed_run(case.seed, traceback.format_exc(limit=-8))


def crashed_run(seed: int, reason: str) -> SeedRun:
    """Result of a seed whose run failed with an exception."""
    return SeedRun(seed, CRASHED, 0, 0.0, (), crash=reason)


def run_seed(
    settings: Settings, seed: int, displaced: bool = False, shared: PreparedStudy | None = None
) -> SeedRun:
    """Plan, execute and estimate once, without twin and report.

    With `displaced`, the world's objects are displaced by the accuracy of their poses. A plan that the runs of a
    study have `shared` is not made again.
    """
    wall, cpu = time.perf_counter(), time.process_time()
    settings = replace(settings, seed=seed)
    planned, cell = (shared or PreparedStudy.of(settings)).for_seed(settings)
    # Measure, in a displaced world if requested.
    if displaced:
        cell = displaced_cell(settings, planned.scene, planned.seen is not None, cell)
    run = pipeline.measure(planned, cell=cell)
    done = run.execution
    if done is None:
        return SeedRun(seed, run.status, 0, 0.0, ())
    # Leave out twin and report: the truth is known here, and a study takes many runs.
    scored = [each for estimate in run.estimates for each in scored_estimates(run, estimate)]
    return SeedRun(
        seed,
        run.status,
        done.actions,
        done.robot_seconds,
        estimates=tuple(each for each in scored if each.is_evidence),
        doubted=tuple(each for each in scored if not each.is_evidence),
        unmeasured=tuple(
            each for estimate in run.estimates for each in unmeasured_components(run, estimate)
        ),
        wall_seconds=time.perf_counter() - wall,
        cpu_seconds=time.process_time() - cpu,
    )


def displaced_cell(
    settings: Settings, scene: Scene | None, seen: bool = False, cell: Cell | None = None
) -> Cell:
    """Displace the objects of the `cell`, by default of the one that the settings name.

    Each object is displaced in the plane by the stated accuracy of its pose (1 sigma an axis),
    seeded by the settings. The detection has displaced objects `seen` in a picture already.
    """
    # Objects exactly at their poses would make the pose errors in the intervals look too large.
    cell = cell or cell_for(settings, scene, seen)
    if scene is None or seen or not isinstance(cell, SimulatedCell):
        return cell
    # Draw a horizontal shift for each object from its pose accuracy.
    random = np.random.default_rng([settings.seed, POSE_STREAM])
    poses: dict[str, Pose] = {}
    for name, believed in scene.objects.items():
        shift = pose_accuracy(believed) * random.standard_normal(2)
        poses[name] = cell.world.body(name).pose_world.translate(np.array([*shift, 0.0]))
    return replace(cell, world=rearrange(cell.world, poses), scene=scene)


def scored_estimates(run: Run, estimate: Estimate) -> Iterator[ScoredEstimate]:
    """Yield the components of an estimate with a value, if its truth is known."""
    truth = run.truth.get(estimate.parameter)
    if truth is None or not estimate.has_value:
        return
    # The naive mass is a part of the estimate of a mass.
    naive = estimate.parts.get("single-shot")
    for i, true_value in enumerate(truth):
        low, high = estimate.intervals[i].tolist()
        yield ScoredEstimate(
            parameter=estimate.parameter,
            component=i,
            seed=run.settings.seed,
            value=float(estimate.values[i]),
            std=float(estimate.stds[i]),
            low=low,
            high=high,
            truth=true_value,
            single_shot=naive.value if naive else None,
            unit=estimate.unit,
            verdict=estimate.verdicts[i],
            at_bound=estimate.is_evidence and estimate.at_bound[i] is not None,
        )


def unmeasured_components(run: Run, estimate: Estimate) -> Iterator[MissingComponent]:
    truth = run.truth.get(estimate.parameter)
    if truth is None or estimate.has_value:
        return
    seed, unit, reason = run.settings.seed, estimate.unit, estimate.method
    for i, true_value in enumerate(truth):
        yield MissingComponent(estimate.parameter, i, seed, true_value, unit, reason)
