"""Things that go wrong on purpose: how each mishap ends over many seeds, and whether anything was
dropped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from palpate import pipeline
from palpate.geometry.pose import Array
from palpate.pictures.film import Footage
from palpate.runs.run import Run
from palpate.scenarios.catalogue import scenario, scenarios
from palpate.studies.workers import spread

FALL = 0.5
"""m/s downwards: free fall of 13 mm; the arm lowers things at a third of it."""

TIPPED = np.deg2rad(15)
"""rad from its first attitude: an object lies."""


@dataclass(frozen=True, slots=True)
class Ending:
    """How one run of a mishap ended.

    Attributes:
        status: as in `result.json`.
        expected: as the scenario says.
        reason: why it stopped or was rejected.
        dropped: objects that fell or tipped over.
        holding: what the hand still holds.
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
        endings: how often it ended with which status.
        as_expected: how often as it should.
        dropped, holding: runs in which something was dropped, or was still held in the end.
        reason: the commonest one.
    """

    scenario: str
    runs: int
    endings: dict[str, int]
    as_expected: int
    dropped: int
    holding: int
    reason: str


def mishaps() -> list[str]:
    """The bundled scenarios in which something goes wrong."""
    return [name for name in scenarios() if name.startswith("mishaps/")]


def faults(
    chosen: Sequence[str], noise: str, seeds: Sequence[int], workers: int = 1
) -> list[Ending]:
    """Every chosen mishap with every seed.

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
    settings = task.settings(noise=noise, seed=seed).checked()
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    done = run.execution
    if done is None:
        return Ending(name, seed, run.status, task.status, _rejection(run))
    reason = done.stopped_by or ""
    holding = run.final_state.holding if run.final_state else None
    return Ending(name, seed, run.status, task.status, reason, _dropped(run), holding)


def _rejection(run: Run) -> str:
    """Why nothing moved."""
    findings = [finding.message for finding in run.findings]
    return "; ".join(findings) or run.plan.explanation


def _dropped(run: Run) -> tuple[str, ...]:
    if run.footage is None:
        return ()
    return dropped(run.footage, tuple(run.scene.objects))


def dropped(footage: Footage, objects: Sequence[str]) -> tuple[str, ...]:
    """The objects that fell or tipped over while the camera looked, by the hidden world."""
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
    """Whether a free body with `poses` (n, 7) at `times` (n,) s fell, or lies in the end."""
    if len(times) < 2:
        return False
    speed = -np.diff(poses[:, 2]) / np.diff(times)
    tipped = abs(_tilt(poses[-1]) - _tilt(poses[0]))
    return bool(speed.max() > FALL) or tipped > TIPPED


def _tilt(pose: Array) -> float:
    """Angle (rad) between a body's z axis and the world's; pose (7,): position, quaternion wxyz."""
    _, x, y, _ = pose[3:]
    up = 1 - 2 * (x**2 + y**2)
    return float(np.arccos(np.clip(up, -1, 1)))


def table(endings: Sequence[Ending]) -> list[Row]:
    """One row for each mishap, in order of first appearance."""
    groups: dict[str, list[Ending]] = {}
    for each in endings:
        groups.setdefault(each.scenario, []).append(each)
    return [_row(name, group) for name, group in groups.items()]


def _row(name: str, runs: Sequence[Ending]) -> Row:
    endings = Counter[str]()
    reasons = Counter[str]()
    as_expected = with_dropped = with_held = 0
    for run in runs:
        endings[run.status] += 1
        reasons[run.reason] += 1
        as_expected += run.status == run.expected
        with_dropped += bool(run.dropped)
        with_held += run.holding is not None
    ((reason, _),) = reasons.most_common(1)
    return Row(name, len(runs), dict(endings), as_expected, with_dropped, with_held, reason)
