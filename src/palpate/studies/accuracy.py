"""How close, and how honestly: a scenario over many seeds, against the hidden truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from statistics import fmean, stdev

from palpate import pipeline
from palpate.parameter import Parameter
from palpate.runs.run import Run
from palpate.settings import Settings


@dataclass(frozen=True, slots=True)
class Trial:
    """One estimate of one seed. `single_shot` is the naive mean of F_z/g from the same recording,
    for masses."""

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
    """One seed: its trials (none of what was not identified), and how the run ended."""

    seed: int
    status: str
    actions: int
    robot_seconds: float
    trials: tuple[Trial, ...]


@dataclass(frozen=True, slots=True)
class Summary:
    """A gap over all seeds, in its SI unit. `claimed` is the mean of the stated standard
    deviations."""

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


def run_seed(settings: Settings, seed: int) -> SeedRun:
    """Plan, execute and estimate once; no twin and no report."""
    settings = replace(settings, seed=seed)
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    done = run.execution
    return SeedRun(
        seed,
        run.status,
        done.actions if done else 0,
        done.robot_seconds if done else 0.0,
        tuple(_trials(run, seed)),
    )


def _trials(run: Run, seed: int) -> Iterable[Trial]:
    for estimate in run.estimates:
        truth = run.truth.get(estimate.parameter) if estimate.has_value else None
        shot = estimate.parts.get("single-shot")
        for i, true_value in enumerate(truth or ()):
            low, high = estimate.ci95[i].tolist()
            yield Trial(
                estimate.parameter,
                i,
                seed,
                float(estimate.value[i]),
                float(estimate.std[i]),
                low,
                high,
                true_value,
                shot.value if shot else None,
            )


def accuracy(settings: Settings, seeds: Sequence[int], workers: int = 1) -> list[SeedRun]:
    """The run over all seeds, in order; each seed is deterministic whatever the number of
    workers."""
    if workers == 1:
        return [run_seed(settings, seed) for seed in seeds]
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(partial(run_seed, settings), seeds))


def summarise(runs: Sequence[SeedRun]) -> list[Summary]:
    """One row a gap and component, in order of first appearance."""
    groups: dict[tuple[Parameter, int], list[Trial]] = {}
    for trial in (t for run in runs for t in run.trials):
        groups.setdefault((trial.parameter, trial.component), []).append(trial)
    return [_summary(*key, trials) for key, trials in groups.items()]


def _summary(parameter: Parameter, component: int, trials: list[Trial]) -> Summary:
    errors = [t.value - t.truth for t in trials]
    shots = [t.single_shot - t.truth for t in trials if t.single_shot is not None]
    return Summary(
        parameter=parameter,
        component=component,
        runs=len(trials),
        truth=fmean(t.truth for t in trials),
        mean=fmean(t.value for t in trials),
        bias=fmean(errors),
        sd=_sd(errors),
        claimed=fmean(t.std for t in trials),
        covered=sum(t.covered for t in trials),
        single_shot_sd=_sd(shots) if shots else None,
    )


def _sd(values: Sequence[float]) -> float:
    return stdev(values) if len(values) > 1 else 0.0
