"""What else than its weight might act on a load: models that hold the one of a load that hangs free,
each with a test of whether it is needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.load.equations import FORCE_Z, SIDEWAYS, Model, Rows, in_each
from palpate.geometry.pose import Array


def tests_of(
    rows: Sequence[Rows], grasps: Sequence[float], model: Model, force: float
) -> tuple[FitTest, ...]:
    """Of all models that hold this one. What other forces may be in proportion to the load, and no
    harm, is what kinematics and friction are not known better than."""
    rub = float(np.hypot(tuning.RUB_SMALL, tuning.RUB_SHARE * force))
    pull = float(np.hypot(tuning.PULL_SMALL, tuning.PULL_SHARE * force))
    found = [
        _sideways(rows, grasps, model, rub),
        _one(rows, model, lambda row: row.height, pull, ("along the lift", _pulled)),
        _one(rows, model, lambda row: row.way, rub, ("up against down", _rubbed)),
        _one(rows, model, lambda row: row.rest, rub, ("rest against pass", _rested)),
    ]
    if len(grasps) > 1:
        found.append(_weighings(rows, grasps, model, rub))
    return tuple(test for test in found if test is not None)


def _one(
    rows: Sequence[Rows],
    model: Model,
    column: Callable[[Rows], Array],
    small: float,
    said: tuple[str, Callable[[float], str]],
) -> FitTest | None:
    """A test of a vertical force in proportion to `column`, `small` (1 sigma) of which is no harm;
    None where it cannot be told from the load."""
    columns = [row.white((row.wrench[:, FORCE_Z] * column(row))[:, None]) for row in rows]
    mean, covariance = model.extended(np.concatenate(columns), tuning.LOAD_PRIOR).solve(1)
    if covariance[0, 0] > (tuning.TELLING * tuning.LOAD_PRIOR) ** 2:
        return None
    statistic = float(mean[0] ** 2 / (covariance[0, 0] + small**2))
    name, worded = said
    return chi_squared(name, statistic, 1, worded(float(mean[0])), model.freedom)


def _sideways(rows: Sequence[Rows], grasps: Sequence[float], model: Model, small: float) -> FitTest:
    """Whether a force acts to the side, or a moment about the vertical, in any grasp; `small` N
    (1 sigma) is no harm."""
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


def _weighings(
    rows: Sequence[Rows], grasps: Sequence[float], model: Model, small: float
) -> FitTest:
    """Whether the force is the same in every grasp."""
    columns = [row.white(in_each(row, grasps[1:], (FORCE_Z,))) for row in rows]
    count = len(grasps) - 1
    mean, covariance = model.extended(np.concatenate(columns), tuning.LOAD_PRIOR).solve(count)
    more, spread = mean[:count], covariance[:, :count] + small**2 * np.eye(count)
    statistic = float(more @ np.linalg.solve(spread, more))
    forces = ", ".join(f"{mean[count] + part:.3g}" for part in [0.0, *more.tolist()])
    finding = f"The weighings disagree: {forces} N."
    return chi_squared("weighing against weighing", statistic, count, finding, model.freedom)


def _pulled(slope: float) -> str:
    way = "grows" if slope > 0 else "falls"
    return (
        f"The force {way} with the height, by {abs(slope):.2g} N/m: something pulls on it or "
        "carries part of it."
    )


def _rubbed(force: float) -> str:
    more = "up" if force > 0 else "down"
    return (
        f"It is {2 * abs(force):.2g} N heavier on the way {more} than back: something rubs on it, "
        "or the force jumped."
    )


def _rested(force: float) -> str:
    more = "heavier" if force > 0 else "lighter"
    return f"At rest it is {abs(force):.2g} N {more} than in motion."
