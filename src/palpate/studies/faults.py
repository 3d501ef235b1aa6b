"""Things that go wrong on purpose: how each mishap ends over many seeds, and whether anything was
dropped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate import pipeline
from palpate.geometry.pose import Array
from palpate.pictures.footage import Footage
from palpate.scenarios.catalogue import names, scenario

FALL = 0.5
"""m/s downwards: free fall of 13 mm; the arm lowers things at a third of it."""

TIPPED = np.deg2rad(15)
"""rad from its first attitude: an object lies."""


@dataclass(frozen=True, slots=True)
class Ending:
    """How one run of a mishap ended.

    Attributes:
        status: as in `result.json`; `expected`: as the scenario says. reason: why it stopped or was
            rejected.
        dropped: objects that fell or tipped over. holding: what the hand still holds.
    """

    scenario: str
    seed: int
    status: str
    expected: str
    reason: str
    dropped: tuple[str, ...]
    holding: str | None


@dataclass(frozen=True, slots=True)
class Row:
    """A mishap over all seeds: how often it ended how, how often as it should, and what was
    dropped."""

    scenario: str
    runs: int
    endings: dict[str, int]
    as_expected: int
    dropped: int
    holding: int
    reason: str


def mishaps() -> list[str]:
    """The bundled scenarios in which something goes wrong."""
    return [name for name in names() if name.startswith("mishaps/")]


def faults(
    chosen: Sequence[str], noise: str, seeds: Sequence[int], workers: int = 1
) -> list[Ending]:
    """Every chosen mishap with every seed.

    Raises:
        InputError: no such scenario.
    """
    jobs = list(product([scenario(name).name for name in chosen], [noise], seeds))
    if workers == 1:
        return [ending(*job) for job in jobs]
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(ending, *zip(*jobs, strict=True)))


def ending(name: str, noise: str, seed: int) -> Ending:
    """Run a mishap once."""
    task = scenario(name)
    settings = task.settings(noise=noise, seed=seed).checked()
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    done = run.execution
    if done is None:
        reason = "; ".join(f.message for f in run.findings) or run.plan.explanation
        return Ending(name, seed, run.status, task.status, reason, (), None)
    fallen = dropped(run.footage, tuple(run.scene.objects)) if run.footage else ()
    return Ending(
        name,
        seed,
        run.status,
        task.status,
        done.stopped_by or "",
        fallen,
        run.final_state.holding if run.final_state else None,
    )


def dropped(footage: Footage, objects: Sequence[str]) -> tuple[str, ...]:
    """The objects that fell or tipped over while the camera looked, by the hidden world."""
    t = np.array([time for time, _ in footage.frames])
    qpos = np.array([q for _, q in footage.frames])
    starts = {
        name: int(footage.model.jnt_qposadr[footage.model.body(name).jntadr[0]]) for name in objects
    }
    return tuple(name for name, at in starts.items() if _fell(t, qpos[:, at : at + 7]))


def _fell(t: Array, poses: Array) -> bool:
    """Whether a free body with `poses` (n, 7) at times `t` (n,) s fell, or lies in the end."""
    if len(t) < 2:
        return False
    speed = -np.diff(poses[:, 2]) / np.diff(t)
    up = [1 - 2 * (q[4] ** 2 + q[5] ** 2) for q in (poses[0], poses[-1])]
    tilt = abs(float(np.arccos(np.clip(up[1], -1, 1)) - np.arccos(np.clip(up[0], -1, 1))))
    return bool(speed.max() > FALL) or tilt > TIPPED


def table(endings: Sequence[Ending]) -> list[Row]:
    """One row for each mishap, in order of first appearance."""
    return [
        _row(name, [e for e in endings if e.scenario == name])
        for name in dict.fromkeys(e.scenario for e in endings)
    ]


def _row(name: str, runs: Sequence[Ending]) -> Row:
    reasons = Counter(e.reason for e in runs)
    return Row(
        name,
        len(runs),
        dict(Counter(e.status for e in runs)),
        sum(e.status == e.expected for e in runs),
        sum(bool(e.dropped) for e in runs),
        sum(e.holding is not None for e in runs),
        reasons.most_common(1)[0][0],
    )
