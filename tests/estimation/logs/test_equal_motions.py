"""Stretches with the same motion: errors that depend on the motion alone cancel in their differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.estimation.arm_motion import (
    DIFFERENCE,
    MEAN,
    OWN,
    REPEAT,
    EqualMotions,
    JointMotion,
    ResidualSpectrum,
    equal_motions,
    frequencies,
    uniform_runs,
)
from palpate.trace.recording import ArmLog

from .conftest import MASS, WINDOW, Log

PERIOD = 5.0


def motion(start: float, periods: float) -> JointMotion:
    """A periodic motion of seven joints at 100 Hz."""
    t = np.arange(round(100 * periods * PERIOD)) / 100
    phase = 2.0 * np.pi / PERIOD * (t[:, None] + start) * np.array([1, 2, 1, 3, 2, 1, 4])
    q, dq = np.sin(phase), 2.0 * np.pi / PERIOD * np.cos(phase)
    (found,) = uniform_runs(ArmLog(t, q, dq, np.zeros_like(q), None, ""))
    return found


def test_periods_with_and_without_a_load_are_one_group() -> None:
    found, equal = equal_motions([motion(0.0, 2.1)], [motion(3.0, 3.2)])
    (loaded, empty), *others = equal.groups
    assert len(loaded) == len(empty) == 2
    assert all(found[i][1] for i in loaded)
    assert not any(found[i][1] for i in empty)
    first = found[loaded[0]][0]
    for i in (*loaded, *empty):
        assert np.abs(found[i][0].q - first.q).max() < 0.01
    # All other motion stays, each part alone.
    assert sorted([*loaded, *empty, *(i for group in others for part in group for i in part)]) == [
        *range(len(found))
    ]


def test_other_motion_is_not_equal() -> None:
    other = motion(0.0, 2.1)
    shifted = JointMotion(
        other.t, 0.9 * other.q, other.dq, other.ddq, other.tau, None, other.dahl, other.strained
    )
    _, equal = equal_motions([motion(0.0, 2.1)], [shifted])
    assert all(not (loaded and empty) for loaded, empty in equal.groups)


def test_combined_rows_keep_the_noise_white() -> None:
    equal = EqualMotions((((0, 1), (2, 3, 4)), ((), (5,))))
    parts = [np.eye(6)[[i]] for i in range(6)]
    combined = equal.combine(parts)
    assert combined @ combined.T == pytest.approx(np.eye(6), abs=1e-12)
    _, kinds = equal.spread([np.zeros(1)] * 6)
    assert kinds.tolist() == [MEAN, DIFFERENCE, REPEAT, REPEAT, REPEAT, OWN]
    # The load is in the mean and in the difference alone.
    carried = equal.combine([np.ones((1, 1))] * 2 + [np.zeros((1, 1))] * 4)[:, 0]
    assert np.flatnonzero(np.abs(carried) > 1e-12).tolist() == [0, 1]


def test_errors_that_depend_on_the_place_alone_do_not_widen_the_mass(
    recording: Log, tmp_path: Path
) -> None:
    """A torque of 0.3 N m that varies with each angle, as of uneven friction, ripple or a cable."""
    uneven = 0.3 * np.sin(7.0 * recording["q"] + np.arange(7))
    file = tmp_path / "uneven.npz"
    np.savez(file, **{**recording, "tau": recording["tau"] + uneven})
    mass = pp.estimate(file, [WINDOW])["load.mass"]
    assert abs(float(mass.z_score(MASS))) < 3.0
    # Without the differences it is 17 g; what is left are the sensors' gains.
    assert mass.stds[0] < 4e-3


def test_zeros_that_drift_between_the_motions_are_in_the_interval(
    recording: Log, tmp_path: Path
) -> None:
    """5 mN m in each joint, as much as a well kept sensor wanders in a quarter of a minute."""
    drifted = 5e-3 * (recording["t"] > 15.0)[:, None] * np.array([1, -1, 1, 1, -1, 1, 1])
    file = tmp_path / "drifted.npz"
    np.savez(file, **{**recording, "tau": recording["tau"] + drifted})
    (low, high), *_ = pp.estimate(file, [WINDOW])["load.mass"].intervals
    assert low < MASS < high


def test_the_spectrum_of_a_white_residual_is_white():
    """On average over 200 residuals, the slowest coefficients are stated less than a fifth too large."""
    random, frequency = np.random.default_rng(0), frequencies(120, 2400, 0.005)
    spectrum = ResidualSpectrum(frequency, is_difference=True)
    slowest = [
        spectrum.std(random.standard_normal(120), np.zeros(120))[:5].mean() for _ in range(200)
    ]
    assert 1.0 < np.mean(slowest) < 1.19
