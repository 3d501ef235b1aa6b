"""How close, and how honestly: a scenario over many seeds, against the hidden truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import fmean, stdev

import numpy as np

from palpate import pipeline
from palpate.parameter import Parameter
from palpate.runs.run import Run
from palpate.settings import Settings
from palpate.studies.workers import spread


@dataclass(frozen=True, slots=True)
class ScoredEstimate:
    """One component of one seed's estimate beside the truth, all in the quantity's SI unit.

    Attributes:
        component: index into a vector quantity; 0 for a scalar.
        value, std: the estimate and its stated standard deviation.
        low, high: its 95 % interval.
        truth: the hidden world's value.
        single_shot: for masses, the naive mean of F_z/g from the same recording.
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

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval holds the truth."""
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, slots=True)
class SeedRun:
    """One seed: how its run ended, what it took, and its estimates beside the truth (none of what
    was not identified)."""

    seed: int
    status: str
    actions: int
    robot_seconds: float
    estimates: tuple[ScoredEstimate, ...]


@dataclass(frozen=True, slots=True)
class Summary:
    """A parameter's component over all seeds, in its SI unit.

    Attributes:
        runs: seeds that estimated it.
        truth, mean: over these. bias: mean error. sd: standard deviation of the errors.
        claimed: mean of the stated standard deviations, which an honest estimator holds near `sd`.
        covered: how many 95 % intervals hold the truth.
        single_shot_sd: as `sd`, of the naive weighing; None where there is none.
    """

    parameter: Parameter
    component: int
    runs: int
    truth: float
    mean: float
    bias: float
    sd: float
    claimed: float
    covered: int
    single_shot_sd: float | None


def accuracy(settings: Settings, seeds: Sequence[int], workers: int = 1) -> list[SeedRun]:
    """The run over all seeds, in order; each is deterministic whatever the number of workers."""
    return spread(partial(run_seed, settings), seeds, workers)


def run_seed(settings: Settings, seed: int) -> SeedRun:
    """Plan, execute and estimate once; no twin and no report."""
    settings = replace(settings, seed=seed)
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    done = run.execution
    if done is None:
        return SeedRun(seed, run.status, 0, 0.0, ())
    estimates = tuple(_scored(run, seed))
    return SeedRun(seed, run.status, done.actions, done.robot_seconds, estimates)


def _scored(run: Run, seed: int) -> Iterator[ScoredEstimate]:
    """Each component of each estimate whose truth somebody knows."""
    for estimate in run.estimates:
        truth = run.truth.get(estimate.parameter)
        if truth is None or not estimate.identified:
            continue
        naive = estimate.parts.get("single-shot")
        for i, true_value in enumerate(truth):
            low, high = estimate.ci95[i].tolist()
            yield ScoredEstimate(
                estimate.parameter,
                i,
                seed,
                float(estimate.value[i]),
                float(estimate.std[i]),
                low,
                high,
                true_value,
                naive.value if naive else None,
            )


def summarise(runs: Sequence[SeedRun]) -> list[Summary]:
    """One row a parameter and component, in order of first appearance."""
    groups: dict[tuple[Parameter, int], list[ScoredEstimate]] = {}
    for run in runs:
        for estimate in run.estimates:
            group = groups.setdefault((estimate.parameter, estimate.component), [])
            group.append(estimate)
    return [_summary(*key, group) for key, group in groups.items()]


def _summary(parameter: Parameter, component: int, estimates: Sequence[ScoredEstimate]) -> Summary:
    columns = np.array([(e.value, e.truth, e.std, e.covered) for e in estimates])
    values, truths, stated, covered = columns.T
    errors = (values - truths).tolist()
    naive_errors = [e.single_shot - e.truth for e in estimates if e.single_shot is not None]
    return Summary(
        parameter=parameter,
        component=component,
        runs=len(estimates),
        truth=fmean(truths),
        mean=fmean(values),
        bias=fmean(errors),
        sd=_sd(errors),
        claimed=fmean(stated),
        covered=int(np.sum(covered)),
        single_shot_sd=_sd(naive_errors) if naive_errors else None,
    )


def _sd(values: Sequence[float]) -> float:
    return stdev(values) if len(values) > 1 else 0.0
