"""Efficiency of the estimators: root mean square error over the Cramér-Rao bound."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from bench.bounds.bound import bounds_of
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.studies.accuracy import displaced_cell
from palpate.studies.efficiency import RangedValue
from palpate.studies.scenarios.catalogue import scenario
from palpate.studies.workers import spread

Ratio = tuple[str, float]
"""Name of a parameter's component, and its error over its bound in one run."""


@dataclass(frozen=True, slots=True)
class OverBound:
    """Root mean square of error / bound over the identified values of one component."""

    scenario: str
    component: str
    values: int
    ratio: RangedValue


def over_bounds(
    names: Sequence[str], noise: str, seeds: Sequence[int], workers: int = 1
) -> list[OverBound]:
    """Make a row for each component of every scenario that has a bound.

    Raises:
        InputError: no such scenario.
    """
    cases = list(product([scenario(name).name for name in names], seeds))
    runs = spread(partial(_ratios, noise=noise), cases, workers)
    groups: dict[tuple[str, str], list[float]] = {}
    for (name, _), ratios in zip(cases, runs, strict=True):
        for component, ratio in ratios:
            groups.setdefault((name, component), []).append(ratio)
    return [
        OverBound(*key, len(ratios), RangedValue.rms(np.array(ratios)))
        for key, ratios in groups.items()
    ]


def _ratios(case: tuple[str, int], noise: str) -> list[Ratio]:
    """Run a scenario with a seed and displaced objects."""
    name, seed = case
    settings = replace(scenario(name).settings(noise=noise), seed=seed)
    made = pipeline.plan(settings, pipeline.load(settings))
    cell = displaced_cell(settings, made.scene, made.seen is not None)
    return list(_of_run(pipeline.measure(made, cell=cell)))


def _of_run(run: Run) -> Iterator[Ratio]:
    for estimate in run.estimates:
        truth = run.truth.get(estimate.parameter)
        bounds = bounds_of(run, estimate)
        if truth is None or bounds is None or not estimate.has_value:
            continue
        for i, bound in enumerate(bounds):
            if bound and estimate.verdicts[i] == "identified":
                name = f"{estimate.parameter}[{i}]" if len(bounds) > 1 else str(estimate.parameter)
                yield name, (float(estimate.values[i]) - truth[i]) / bound
