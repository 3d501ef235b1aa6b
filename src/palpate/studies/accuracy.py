"""Accuracy study: errors and coverage of a scenario's estimates over many seeds, against the hidden
truth."""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from palpate import pipeline
from palpate.estimation.estimate import Estimate, Verdict
from palpate.parameter import Parameter
from palpate.runs.run import Run
from palpate.scenarios.catalogue import scenario
from palpate.settings import Settings
from palpate.studies.engine.workers import spread
from palpate.studies.places import about_there

CRASHED = "crashed"
"""Status of a seed that ended in an error of the program itself."""


@dataclass(frozen=True, slots=True)
class ScoredEstimate:
    """Component of a seed's estimate and its true value, in the quantity's SI unit.

    Attributes:
        component: index into a vector quantity; 0 for a scalar.
        value, std: the estimate and its stated standard deviation.
        low, high: its 95 % interval.
        truth: the hidden world's value.
        single_shot: for masses, the naive mean of F_z/g from the same recording.
        unit: as printed.
        verdict: of this component.
    """

    parameter: Parameter
    component: int
    seed: int
    value: float
    std: float
    low: float
    high: float
    truth: float
    single_shot: float | None
    unit: str = ""
    verdict: Verdict = "identified"

    @property
    def covered(self) -> bool:
        """The truth lies in the 95 % interval."""
        return self.low <= self.truth <= self.high

    @property
    def error(self) -> float:
        """Value less truth."""
        return self.value - self.truth


@dataclass(frozen=True, slots=True)
class Unmeasured:
    """Component that a seed left without a value."""

    parameter: Parameter
    component: int
    seed: int
    truth: float
    unit: str
    reason: str

    @property
    def verdict(self) -> Verdict:
        """None but one has no value."""
        return "not identified"


@dataclass(frozen=True, slots=True)
class SeedRun:
    """Result of a seed: end of the run, effort, estimates with their true values.

    Attributes:
        status: of the run, or `CRASHED`.
        estimates: what was identified.
        doubted: what has a value, but another verdict.
        unmeasured: what has none.
        wall_seconds, cpu_seconds: of all of it, planning and estimation as well.
        crash: a traceback.
    """

    seed: int
    status: str
    actions: int
    robot_seconds: float
    estimates: tuple[ScoredEstimate, ...]
    doubted: tuple[ScoredEstimate, ...] = ()
    unmeasured: tuple[Unmeasured, ...] = ()
    wall_seconds: float = field(default=0.0, compare=False)
    cpu_seconds: float = field(default=0.0, compare=False)
    crash: str = ""


@dataclass(frozen=True, slots=True)
class Question:
    """A bundled scenario as it is run over all seeds; `changes` are fields of its `Settings`."""

    scenario: str
    changes: tuple[tuple[str, Any], ...] = ()

    @property
    def settings(self) -> Settings:
        """Settings of the run; the scenario's files are found on the machine that runs it."""
        return scenario(self.scenario).settings(**dict(self.changes))


@dataclass(frozen=True, slots=True)
class Case:
    """Question to be run with a seed."""

    question: Question
    seed: int


def accuracy(settings: Settings, seeds: Sequence[int], workers: int = 1) -> list[SeedRun]:
    """Run all seeds, in order; each run is deterministic, independent of the number of workers."""
    return spread(partial(run_seed, settings), seeds, workers)


def survived(case: Case) -> SeedRun:
    """Run a case with randomly displaced objects (`places`); an exception becomes a crashed run."""
    try:
        return run_seed(case.question.settings, case.seed, off=True)
    except Exception:
        return crashed(case.seed, traceback.format_exc(limit=-8))


def crashed(seed: int, reason: str) -> SeedRun:
    """A seed without a run."""
    return SeedRun(seed, CRASHED, 0, 0.0, (), crash=reason)


def run_seed(settings: Settings, seed: int, off: bool = False) -> SeedRun:
    """Plan, execute and estimate once; no twin and no report. `off`: objects stand only about where
    the scene has them."""
    wall, cpu = time.perf_counter(), time.process_time()
    settings = replace(settings, seed=seed)
    made = pipeline.plan(settings, pipeline.load(settings))
    cell = about_there(settings, made.scene, made.seen is not None) if off else None
    run = pipeline.measure(made, cell=cell)
    done = run.execution
    if done is None:
        return SeedRun(seed, run.status, 0, 0.0, ())
    scored = [each for estimate in run.estimates for each in _scored(run, estimate)]
    return SeedRun(
        seed,
        run.status,
        done.actions,
        done.robot_seconds,
        tuple(each for each in scored if each.verdict == "identified"),
        tuple(each for each in scored if each.verdict != "identified"),
        tuple(each for estimate in run.estimates for each in _unmeasured(run, estimate)),
        time.perf_counter() - wall,
        time.process_time() - cpu,
    )


def _scored(run: Run, estimate: Estimate) -> Iterator[ScoredEstimate]:
    """Each component of an estimate that has a value, where somebody knows the truth."""
    truth = run.truth.get(estimate.parameter)
    if truth is None or not estimate.has_value:
        return
    naive = estimate.parts.get("single-shot")
    for i, true_value in enumerate(truth):
        low, high = estimate.intervals[i].tolist()
        yield ScoredEstimate(
            estimate.parameter,
            i,
            run.settings.seed,
            float(estimate.values[i]),
            float(estimate.stds[i]),
            low,
            high,
            true_value,
            naive.value if naive else None,
            estimate.unit,
            estimate.verdicts[i],
        )


def _unmeasured(run: Run, estimate: Estimate) -> Iterator[Unmeasured]:
    truth = run.truth.get(estimate.parameter)
    if truth is None or estimate.has_value:
        return
    for i, true_value in enumerate(truth):
        yield Unmeasured(
            estimate.parameter,
            i,
            run.settings.seed,
            true_value,
            estimate.unit,
            estimate.method,
        )
