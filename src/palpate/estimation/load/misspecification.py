"""Tests of model misspecification: models extended by forces other than the weight of the load."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.load.equations import (
    FORCE_Z,
    SIDEWAYS,
    Rows,
    each_its_own,
    in_each,
)
from palpate.estimation.regression import Cause, Posterior
from palpate.geometry.pose import Array


def tests_of(
    rows: Sequence[Rows], grasps: Sequence[float], found: Posterior, left: float
) -> tuple[FitTest, ...]:
    """Test each extended model, for a load with `left` N (1 sigma) of residual stiction."""
    # Tolerated: the uncertainty of kinematics and friction, in proportion to the load.
    force = float(found.mean[0])
    rub = float(np.hypot(tuning.RUB_SMALL, tuning.RUB_SHARE * force))
    pull = float(np.hypot(tuning.PULL_SMALL, tuning.PULL_SHARE * force))
    tests = [sideways_test(rows, grasps, found, rub), *vertical_tests(rows, found, rub, pull, left)]
    if len(grasps) > 1:
        tests.append(weighings_test(rows, grasps, found, rub))
    return tuple(tests)


def vertical_tests(
    rows: Sequence[Rows], posterior: Posterior, rub: float, pull: float, left: float
) -> list[FitTest]:
    """Test for vertical forces, one at a time: in proportion to the height, changing sign with the direction,
    at rest only, and a step. `rub` N, `pull` N/m and `left` N (1 sigma) are tolerated."""
    stuck = float(np.hypot(rub, left))
    since = each_its_own([row.since for row in rows])
    columns: list[Array] = []
    for row, later in zip(rows, since, strict=True):
        on_load = np.column_stack([row.height, row.way, row.rest])
        columns.append(np.hstack([row.wrench[:, [FORCE_Z]] * on_load, later]))
    forces, variances = posterior.each_alone(np.concatenate(columns), tuning.LOAD_PRIOR)
    kinds = [
        ("along the lift", pull),
        ("up against down", rub),
        ("rest against pass", stuck),
        # One for each possible onset of a step; the worst counts.
        *[("before against after", stuck)] * since[0].shape[1],
    ]
    found: dict[str, FitTest] = {}
    for kind, force, variance in zip(kinds, forces.tolist(), variances.tolist(), strict=True):
        name, small = kind
        statistic = force**2 / (variance + small**2)
        # A force that cannot be separated from the load is not tested.
        separable = variance < (tuning.TELLING * tuning.LOAD_PRIOR) ** 2
        if separable and (name not in found or statistic > found[name].statistic):
            # The tolerated part is known exactly (Welch and Satterthwaite; GUM, annex G.4).
            freedom = posterior.freedom * (1.0 + small**2 / variance) ** 2
            found[name] = chi_squared(name, statistic, 1, _finding(name, force), freedom)
    return list(found.values())


def _finding(name: str, force: float) -> str:
    size, positive = abs(force), force > 0
    if name == "along the lift":
        return (
            f"The force {'grows' if positive else 'falls'} with the height, by {size:.2g} N/m: something pulls on it "
            "or carries part of it."
        )
    if name == "up against down":
        return (
            f"It is {2 * size:.2g} N heavier on the way {'up' if positive else 'down'} than back: something rubs on "
            "it, or the force jumped."
        )
    if name == "rest against pass":
        return f"At rest it is {size:.2g} N {'heavier' if positive else 'lighter'} than in motion."
    return (
        f"From some moment on {size:.2g} N {'more' if positive else 'less'} are measured, with the object and without: "
        "the sensors' zero jumped, or approaches leave more in the joints than the datasheet says."
    )


def sideways_test(
    rows: Sequence[Rows], grasps: Sequence[float], posterior: Posterior, small: float
) -> FitTest:
    """Test for a sideways force, or a moment about the vertical, in any grasp; `small` N (1 sigma)
    is tolerated."""
    count = len(SIDEWAYS) * len(grasps)

    def finding(mean: Array) -> str:
        forces = mean[:count].reshape(-1, len(SIDEWAYS))[:, :2]
        most = float(np.linalg.norm(forces, axis=1).max())
        return (
            f"It is pushed or pulled sideways with {most:.2g} N, as nothing is that hangs free: "
            "something besides the hand holds it."
        )

    columns = np.concatenate([in_each(row, grasps, SIDEWAYS) for row in rows])
    tolerated = np.tile((small, small, small * tuning.TORQUE_LEVER), len(grasps))
    cause = Cause("sideways", columns, np.full(count, tuning.LOAD_PRIOR))
    return posterior.test(cause, tolerated, finding)


def weighings_test(
    rows: Sequence[Rows], grasps: Sequence[float], posterior: Posterior, small: float
) -> FitTest:
    """Test for the same force in every grasp."""
    count = len(grasps) - 1

    def finding(mean: Array) -> str:
        forces = ", ".join(f"{mean[count] + part:.3g}" for part in [0.0, *mean[:count].tolist()])
        return f"The weighings disagree: {forces} N."

    columns = np.concatenate([in_each(row, grasps[1:], (FORCE_Z,)) for row in rows])
    cause = Cause("weighing against weighing", columns, np.full(count, tuning.LOAD_PRIOR))
    return posterior.test(cause, np.full(count, small), finding)
