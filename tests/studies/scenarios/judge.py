"""How a scenario's run is judged: by its execution trace, the hidden world's truth, and where
everything ends."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from palpate.common.errors import Unavailable
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.studies.judgement import objection
from palpate.studies.scenarios.catalogue import Scenario
from palpate.twin.export import FORMATS, export_twin, require_format
from palpate.twin.twin import build_twin

TOLERANCE = {
    "height": 0.0005,
    "friction": 0.02,
    "com": 0.003,
    "stiffness": 60.0,
    "contact_damping": 40.0,
    "frictionloss": 0.2,
    "damping": 1.5,
}
"""At `--noise lab`: m, -, m (horizontally: no torque tells the height of a centre of mass), N/m, N·s/m; of a joint N or
N·m, and N·s/m or N·m·s/rad."""
MASS = 0.02
"""Relative."""
LIGHT = 0.004
"""kg, of things of less than 200 g: two standard deviations that a weighing states."""
STATIC = 0.03
"""Of breakaway."""
MOVED = 0.005
"""m that an object may be from where it stood."""
SETTLED = 30
"""Frame, at 30 Hz, by which everything stands as the world let it."""


def executed(scenario: Scenario, plan: str | None = None) -> Run:
    """A run at `--noise lab`, by the scenario's planner or by one of its recorded plans."""
    settings = (
        scenario.settings(planner=f"replay:{plan}", noise="lab")
        if plan
        else scenario.settings(noise="lab")
    ).check_values()
    return pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))


def assert_acquired(
    run: Run, expected: Collection[Parameter], may_touch: Collection[str] = ()
) -> None:
    """From the trace alone: the right sensing on the right objects, nothing redundant, no safety
    stop."""
    assert run.findings == ()
    assert run.execution is not None
    assert run.execution.stopped_by is None
    assert objection(run.trace, expected, may_touch) == ""


def assert_exported(run: Run, folder: Path) -> None:
    """The twin is read back from every format."""
    twin = build_twin(run.scene, run.estimates)
    for to in FORMATS:
        try:
            chosen = require_format(to)
        except Unavailable:
            continue
        result, scratch = folder / to, folder / f"{to}-scratch"
        result.mkdir()
        scratch.mkdir()
        assert export_twin(twin, run.estimates, chosen, result, scratch).file.exists()


def assert_near_truth(run: Run) -> None:
    """Every estimate is within the tolerance of its quantity; the truth is looked up only now."""
    assert {estimate.parameter for estimate in run.estimates} == set(run.plan.parameters)
    for estimate in run.estimates:
        truth = np.array(run.truth[estimate.parameter])
        error = np.abs(np.array(estimate.values) - truth)
        if estimate.parameter.quantity == "com":
            error = error[:2]
        assert (error <= _allowed(estimate.parameter, truth)).all(), (
            str(estimate.parameter),
            estimate.values,
            truth,
        )
        if estimate.parameter.quantity == "friction":
            _assert_static(estimate, run)


def assert_restored(run: Run) -> None:
    """Every object is back, upright, where it stood before the arm came near it."""
    for name, (distance, tilt) in displacements(run).items():
        assert distance < MOVED, (name, distance)
        assert tilt < np.radians(2.0), (name, tilt)


def displacements(run: Run) -> dict[str, tuple[float, float]]:
    """How far (m) and how much turned (rad) each object ends from where it stood."""
    assert run.footage is not None
    (_, first), (_, last) = run.footage.frames[SETTLED], run.footage.frames[-1]
    return {name: between(first, last, joint_of(run, name)) for name in run.scene.objects}


def joint_of(run: Run, name: str) -> slice:
    """Where an object's pose is in the world's configuration."""
    assert run.footage is not None
    model = run.footage.model
    start = int(model.jnt_qposadr[model.body(name).jntadr[0]])
    return slice(start, start + 7)


def between(first: np.ndarray, last: np.ndarray, joint: slice) -> tuple[float, float]:
    """Distance (m) and angle (rad) of two poses of a free joint."""
    (a, b) = first[joint], last[joint]
    turn = 2 * np.arccos(min(1.0, abs(float(a[3:] @ b[3:]))))
    return float(np.linalg.norm(b[:3] - a[:3])), float(turn)


def _allowed(parameter: Parameter, truth: np.ndarray) -> float:
    if parameter.quantity == "mass":
        return max(MASS * truth[0], LIGHT)
    return TOLERANCE[parameter.quantity]


def _assert_static(estimate: Estimate, run: Run) -> None:
    assert run.footage is not None
    truth = run.footage.model.numeric(f"static_friction_{estimate.parameter.object}").data[0]
    static = estimate.parts["static"]
    assert abs(static.value - truth) <= STATIC, (static, truth)
    assert static.std < 0.2 * truth
    assert static.value > estimate.values[0]
