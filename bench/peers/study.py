"""Errors of palpate and of published estimators on the same recordings."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from bench.peers.baselines import BASELINES
from bench.peers.recordings import ARM, Case, LoadedLog, recorded
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose, tensor_of
from palpate.estimation.estimate import Z95
from palpate.estimation.logs.trace import Carrying, trace_of
from palpate.estimation.quantities.estimators import estimate_all
from palpate.robots.owner import load_description
from palpate.trace.samples import STANDARD_GRAVITY

PALPATE = "palpate"
QUANTITIES = ("mass", "com", "inertia")
LOAD = "load"


@dataclass(frozen=True, slots=True)
class Row:
    """Errors of a method on a recording: of mass, kg, com, m, and inertia about the centre, kg m².

    Attributes:
        errors, stds: of each component, by quantity.
        held: for each component, True if the 95 % interval holds the truth.
        seconds: processor time of the estimate.
        verdict: of the mass, by palpate.
    """

    method: str
    noise: str
    seed: int
    mass: float
    errors: dict[str, list[float]]
    stds: dict[str, list[float]]
    held: dict[str, list[bool]]
    seconds: float
    verdict: str = ""


@dataclass(frozen=True, slots=True)
class Line:
    """Summary of some rows of a method for one quantity, SI units.

    Attributes:
        rms: error. stated: root mean square of the stated deviations. z: root mean square of errors over deviations.
        coverage: share of 95 % intervals that hold the truth.
    """

    quantity: str
    noise: str
    load: str
    method: str
    values: int
    rms: float
    stated: float
    z: float
    coverage: float
    seconds: float


def study(cases: Iterable[Case], folder: Path | None, out: Path | None) -> Iterator[Row]:
    """Yield the rows of all methods; palpate's are appended to `out`, one JSON object a line."""
    for case in cases:
        recording = recorded(case, folder)
        rows = [judge_palpate(case, recording)]
        rows += [judge_peer(case, recording, name) for name in BASELINES]
        for row in rows:
            if out is not None:
                with out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(row)) + "\n")
            yield row


def judge_palpate(case: Case, recording: LoadedLog) -> Row:
    """Estimate the load as `palpate estimate` does, after reading the file."""
    asked = [Parameter(LOAD, quantity) for quantity in QUANTITIES]
    began = time.process_time()
    carrying = Carrying(LOAD, (recording.window,))
    base = Pose.of([0.0, 0.0, 0.0])
    arm = load_description(ARM)
    trace = trace_of(recording.log, carrying, asked, arm, base, STANDARD_GRAVITY)
    found = estimate_all(asked, trace, {})
    seconds = time.process_time() - began
    errors: dict[str, list[float]] = {}
    stds: dict[str, list[float]] = {}
    held: dict[str, list[bool]] = {}
    for quantity, estimate in zip(QUANTITIES, found, strict=True):
        truth = true_values(recording, quantity)
        if len(estimate.values) == len(truth):
            errors[quantity] = (estimate.values - truth).tolist()
            stds[quantity] = estimate.stds.tolist()
            low, high = estimate.intervals.T
            held[quantity] = ((low <= truth) & (truth <= high)).tolist()
    return Row(
        PALPATE, case.noise, case.seed, case.mass, errors, stds, held, seconds, found[0].verdict
    )


def judge_peer(case: Case, recording: LoadedLog, name: str) -> Row:
    """Estimate the load by a published method, with normal intervals of its own deviations."""
    began = time.process_time()
    made = BASELINES[name](recording)
    seconds = time.process_time() - began
    errors: dict[str, list[float]] = {}
    stds: dict[str, list[float]] = {}
    for quantity in QUANTITIES:
        # Propagate the covariance by central differences.
        steps = 1e-6 * np.eye(10)
        slopes = np.column_stack(
            [
                (_of(made.value + step, quantity) - _of(made.value - step, quantity)) / 2e-6
                for step in steps
            ]
        )
        errors[quantity] = (_of(made.value, quantity) - true_values(recording, quantity)).tolist()
        stds[quantity] = np.sqrt(np.diag(slopes @ made.covariance @ slopes.T)).tolist()
    held = {
        name: [abs(e) <= Z95 * s for e, s in zip(errors[name], stds[name], strict=True)]
        for name in errors
    }
    return Row(name, case.noise, case.seed, case.mass, errors, stds, held, seconds)


def _of(value: Array, quantity: str) -> Array:
    """Convert ten parameters about the TCP to a quantity."""
    if quantity == "mass":
        return value[:1]
    centre = value[1:4] / value[0]
    if quantity == "com":
        return centre
    steiner = value[0] * (float(centre @ centre) * np.eye(3) - np.outer(centre, centre))
    tensor = tensor_of(value[4:].tolist()) - steiner
    return tensor[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]


def true_values(recording: LoadedLog, quantity: str) -> Array:
    """Return the truth of a quantity."""
    load = recording.load
    return {"mass": np.array([load.mass]), "com": load.com, "inertia": load.inertia}[quantity]


def summary(rows: Iterable[Row]) -> list[Line]:
    """Summarise rows by quantity, noise, load and method, and over all loads."""
    listed, found = list(rows), list[Line]()
    grouped = {"all": listed}
    by_mass = sorted(listed, key=lambda row: row.mass)
    grouped |= {f"{mass:g} kg": list(some) for mass, some in groupby(by_mass, lambda r: r.mass)}
    for quantity in QUANTITIES:
        for noise in dict.fromkeys(row.noise for row in listed):
            for load, some in grouped.items():
                for method in dict.fromkeys(row.method for row in listed):
                    mine = [row for row in some if (row.noise, row.method) == (noise, method)]
                    if line := _line(quantity, noise, load, method, mine):
                        found.append(line)
    return found


def _line(quantity: str, noise: str, load: str, method: str, rows: Sequence[Row]) -> Line | None:
    """Summarise the rows of a method for one quantity; None without a value."""
    rows = [row for row in rows if quantity in row.errors]
    if not rows:
        return None
    error = np.concatenate([row.errors[quantity] for row in rows])
    std = np.concatenate([row.stds[quantity] for row in rows])
    held = np.concatenate([row.held[quantity] for row in rows])
    return Line(
        quantity=quantity,
        noise=noise,
        load=load,
        method=method,
        values=len(error),
        rms=float(np.sqrt(np.mean(error**2))),
        stated=float(np.sqrt(np.mean(std**2))),
        z=float(np.sqrt(np.mean((error / std) ** 2))),
        coverage=float(held.mean()),
        seconds=float(np.mean([row.seconds for row in rows])),
    )
