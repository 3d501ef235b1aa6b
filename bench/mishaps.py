"""Bundled mishap scenarios over many seeds: endings, and dropped objects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from palpate.common.pose import Array
from palpate.execution.harm import FALLING, TIPPED
from palpate.perception.film import Footage
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario, scenarios
from palpate.studies.workers import spread


@dataclass(frozen=True, slots=True)
class Ending:
    """End of one run of a mishap.

    Attributes:
        status: as in `result.json`.
        expected: status that the scenario states.
        reason: of the stop or the rejection.
        dropped: objects that fell or tipped over.
        holding: object in the hand at the end.
    """

    scenario: str
    seed: int
    status: str
    expected: str
    reason: str
    dropped: tuple[str, ...] = ()
    holding: str | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """A mishap over all seeds.

    Attributes:
        endings: number of runs by status.
        as_expected: number of runs with the expected status.
        dropped, holding: number of runs with a dropped object, or with one still held.
        reason: the most frequent one.
    """

    scenario: str
    runs: int
    endings: dict[str, int]
    as_expected: int
    dropped: int
    holding: int
    reason: str


def mishaps() -> list[str]:
    """Names of the bundled mishap scenarios."""
    return [name for name in scenarios() if name.startswith("mishaps/")]


def faults(
    chosen: Sequence[str], noise: str, seeds: Sequence[int], workers: int = 1
) -> list[Ending]:
    """Run every chosen mishap with every seed.

    Raises:
        InputError: no such scenario.
    """
    cases: list[tuple[str, int]] = []
    for name in chosen:
        cases.extend(product([scenario(name).name], seeds))
    return spread(partial(_ending, noise=noise), cases, workers)


def _ending(case: tuple[str, int], noise: str) -> Ending:
    """Run a mishap with a seed."""
    name, seed = case
    task = scenario(name)
    settings = task.settings(noise=noise, seed=seed).check_values()
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    done = run.execution
    if done is None:  # the plan was rejected: nothing moved
        findings = [finding.message for finding in run.findings]
        reason = "; ".join(findings) or run.plan.explanation
        return Ending(name, seed, run.status, task.status, reason)
    lost = dropped(run.footage, tuple(run.scene.objects)) if run.footage is not None else ()
    return Ending(
        name,
        seed,
        run.status,
        task.status,
        reason=done.stopped_by or "",
        dropped=lost,
        holding=run.final_state.holding if run.final_state else None,
    )


def dropped(footage: Footage, objects: Sequence[str]) -> tuple[str, ...]:
    """Objects that fell or tipped over in the footage of the hidden world."""
    model = footage.model
    moments, positions = zip(*footage.frames, strict=True)
    times, qpos = np.array(moments), np.array(positions)
    fallen: list[str] = []
    for name in objects:
        start = int(model.jnt_qposadr[model.body(name).jntadr[0]])
        if _fell(times, qpos[:, start : start + 7]):
            fallen.append(name)
    return tuple(fallen)


def _fell(times: Array, poses: Array) -> bool:
    """True if a free body with `poses` (n, 7) at `times` (n,) s fell, or is tipped over at the end."""
    if len(times) < 2:
        return False
    speed = -np.diff(poses[:, 2]) / np.diff(times)
    tipped = abs(_tilt(poses[-1]) - _tilt(poses[0]))
    return bool(speed.max() > FALLING) or tipped > TIPPED


def _tilt(pose: Array) -> float:
    """Angle (rad) between a body's z axis and the world's; pose (7,): position, quaternion wxyz."""
    _, x, y, _ = pose[3:]
    up = 1 - 2 * (x**2 + y**2)
    return float(np.arccos(np.clip(up, -1, 1)))


def table(endings: Sequence[Ending]) -> list[Row]:
    """Make a row for each mishap, in order of first appearance."""
    groups: dict[str, list[Ending]] = {}
    for each in endings:
        groups.setdefault(each.scenario, []).append(each)
    return [_row(name, group) for name, group in groups.items()]


def _row(name: str, runs: Sequence[Ending]) -> Row:
    ((reason, _),) = Counter(run.reason for run in runs).most_common(1)
    return Row(
        name,
        len(runs),
        endings=dict(Counter(run.status for run in runs)),
        as_expected=sum(run.status == run.expected for run in runs),
        dropped=sum(bool(run.dropped) for run in runs),
        holding=sum(run.holding is not None for run in runs),
        reason=reason,
    )
