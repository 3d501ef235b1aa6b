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
from palpate.estimation.regression import Model
from palpate.geometry.pose import Array


def tests_of(
    rows: Sequence[Rows], grasps: Sequence[float], model: Model, force: float, left: float
) -> tuple[FitTest, ...]:
    """Test each extended model, for a load of `force` N with `left` N (1 sigma) of residual stiction."""
    # Tolerated: the uncertainty of kinematics and friction, in proportion to the load.
    rub = float(np.hypot(tuning.RUB_SMALL, tuning.RUB_SHARE * force))
    pull = float(np.hypot(tuning.PULL_SMALL, tuning.PULL_SHARE * force))
    found = [sideways_test(rows, grasps, model, rub), *vertical_tests(rows, model, rub, pull, left)]
    if len(grasps) > 1:
        found.append(weighings_test(rows, grasps, model, rub))
    return tuple(found)


def vertical_tests(
    rows: Sequence[Rows], model: Model, rub: float, pull: float, left: float
) -> list[FitTest]:
    """Test for vertical forces, one at a time: in proportion to the height, changing sign with the direction,
    at rest only, and a step. `rub` N, `pull` N/m and `left` N (1 sigma) are tolerated."""
    stuck = float(np.hypot(rub, left))
    since = each_its_own([row.since for row in rows])
    white: list[Array] = []
    for row, later in zip(rows, since, strict=True):
        on_load = np.column_stack([row.height, row.way, row.rest])
        white.append(row.white(np.hstack([row.wrench[:, [FORCE_Z]] * on_load, later])))
    forces, variances = model.each_alone(np.concatenate(white), tuning.LOAD_PRIOR)
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
            freedom = model.freedom * (1.0 + small**2 / variance) ** 2
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
    rows: Sequence[Rows], grasps: Sequence[float], model: Model, small: float
) -> FitTest:
    """Test for a sideways force, or a moment about the vertical, in any grasp; `small` N (1 sigma)
    is tolerated."""
    columns = [row.white(in_each(row, grasps, SIDEWAYS)) for row in rows]
    count = len(SIDEWAYS) * len(grasps)
    mean, covariance = model.extended(np.concatenate(columns), tuning.LOAD_PRIOR).solve(count)
    force = mean[:count]
    allowed = np.tile((small, small, small * tuning.TORQUE_LEVER), len(grasps))
    spread = covariance[:, :count] + np.diag(allowed**2)
    statistic = float(force @ np.linalg.solve(spread, force))
    most = float(np.linalg.norm(force.reshape(-1, len(SIDEWAYS))[:, :2], axis=1).max())
    finding = (
        f"It is pushed or pulled sideways with {most:.2g} N, as nothing is that hangs free: "
        "something besides the hand holds it."
    )
    return chi_squared("sideways", statistic, count, finding, model.freedom)


def weighings_test(
    rows: Sequence[Rows], grasps: Sequence[float], model: Model, small: float
) -> FitTest:
    """Test for the same force in every grasp."""
    columns = [row.white(in_each(row, grasps[1:], (FORCE_Z,))) for row in rows]
    count = len(grasps) - 1
    mean, covariance = model.extended(np.concatenate(columns), tuning.LOAD_PRIOR).solve(count)
    more, spread = mean[:count], covariance[:, :count] + small**2 * np.eye(count)
    statistic = float(more @ np.linalg.solve(spread, more))
    forces = ", ".join(f"{mean[count] + part:.3g}" for part in [0.0, *more.tolist()])
    finding = f"The weighings disagree: {forces} N."
    return chi_squared("weighing against weighing", statistic, count, finding, model.freedom)
