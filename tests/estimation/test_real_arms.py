"""A load that is not there: windows of real arms' empty motion, labelled as holding something."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.carried import fit_carried_load
from palpate.estimation.estimate import half95
from palpate.estimation.load_fit import fit_whole
from palpate.estimation.load_noise import SignalLevels
from palpate.estimation.logs.trace import Carrying, trace_of
from palpate.robots.owner import load_description
from palpate.trace.recording import ArmLog

REAL = Path(os.environ.get("PALPATE_SHARED", Path(__file__).parents[3] / "shared")) / "real"
LENGTH, STEP = 3.0, 1.2
"""s of a window, and from each to the next."""
GRAVITY = 9.81


def recorded() -> ArmLog:
    """The FR3 of `real/SOURCE.txt`, as `real/read.py` unpacks it, each 5 ms."""
    data = np.load(REAL / "fr3_free_1.npz")
    t = np.cumsum(data["dt_us"].astype(float)) * 1e-6
    step = {"q": 1e-6, "dq": 1e-5, "tau": 1e-4}
    q, dq, tau = (np.cumsum(data[f"{key}_steps"], axis=0) * size for key, size in step.items())
    fresh = np.concatenate([[True], np.abs(np.diff(tau, axis=0)).sum(axis=1) > 0.0])
    fresh &= np.concatenate([[True], np.diff(t) > 0.0])
    rows = t - t[0], q, dq, tau
    return ArmLog(*(signal[fresh] for signal in rows), None, "fr3_free_1")


@pytest.mark.skipif(not REAL.is_dir(), reason="recordings of real arms are not at hand")
def test_intervals_of_nothing_hold_nothing() -> None:
    log, arm = recorded(), load_description("fr3")
    unknown = SignalLevels(np.full(7, 4e-4), np.zeros(7), 20.0)
    errors: list[tuple[float, float, float]] = []
    for start in np.arange(0.1, float(log.t[-1]) - LENGTH - 0.1, STEP):
        carrying = Carrying("load", ((start, start + LENGTH),))
        asked = [Parameter("load", "mass")]
        trace = trace_of(log, carrying, asked, arm, Pose.of([0.0, 0.0, 0.0]), GRAVITY)
        whole = fit_whole(trace, "load", unknown, 0.01)
        assert whole is not None
        errors.append((whole.force, whole.force_std, half95(whole.posterior.freedom)))
    force, std, half = np.array(errors).T
    assert len(force) >= 6
    assert np.mean(np.abs(force) < half * std) >= 0.8
    assert 0.5 < np.sqrt(np.mean((force / std) ** 2)) < 1.6
    assert np.sqrt(np.mean(std**2)) / GRAVITY < 0.025


@pytest.mark.skipif(not REAL.is_dir(), reason="recordings of real arms are not at hand")
def test_friction_that_varies_within_a_turn_is_no_load() -> None:
    """With one and two periods a turn alone, these windows showed 19 g (rms)."""
    log, arm = recorded(), load_description("fr3")
    found: list[tuple[float, float]] = []
    for start in (3.7, 4.32, 4.94, 5.56):
        carrying = Carrying("load", ((start, start + LENGTH),))
        asked = [Parameter("load", "mass")]
        trace = trace_of(log, carrying, asked, arm, Pose.of([0.0, 0.0, 0.0]), GRAVITY)
        load = fit_carried_load(trace, "load")
        assert load is not None
        found.append((load.value[0], np.sqrt(load.covariance[0, 0])))
    mass, std = np.array(found).T
    assert np.sqrt(np.mean(mass**2)) < 0.014
    assert np.all(np.abs(mass) < 1.96 * std)
