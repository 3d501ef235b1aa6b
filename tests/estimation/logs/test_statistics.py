"""Statistics of a recording of free motion: what is put in is found, and what is not there is not seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.recorded import free_motion, real
from palpate.common.errors import InputError
from palpate.estimation.logs.noise_model import statistics
from palpate.robots.owner import load_description
from palpate.trace.recording import ArmLog

ARM = load_description("fr3")
REAL = Path(__file__).parents[4] / "shared" / "real"
COULOMB = np.array([0.5, 0.4, 0.3, 0.25, 0.35, 0.25, 0.15])
PRESLIDING, OFFSET, STEP, WHITE, RIPPLE, SECOND = 2e-3, -0.2, 0.024, 0.03, 0.1, 0.15


@pytest.fixture(scope="module")
def perfect() -> ArmLog:
    return free_motion("none", 0, 20.0)


def dahl(q: np.ndarray) -> np.ndarray:
    """Friction of unit level."""
    out, state = np.empty_like(q), np.zeros(7)
    for i, step in enumerate(np.diff(q, axis=0, prepend=q[:1])):
        way = np.sign(step)
        state = way + (state - way) * np.exp(-np.abs(step) / PRESLIDING)
        out[i] = state
    return out


@pytest.fixture(scope="module")
def spoiled(perfect: ArmLog) -> ArmLog:
    """A perfect arm's recording with errors of its torques."""
    random, waves = np.random.default_rng(1), np.sqrt(2.0) * np.sin(240 * perfect.q)
    waves = RIPPLE * waves + SECOND * np.sqrt(2.0) * np.sin(480 * perfect.q + 1.0)
    tau = perfect.tau + OFFSET + COULOMB * dahl(perfect.q) + waves
    tau += WHITE * random.standard_normal(tau.shape)
    return replace(perfect, tau=STEP * np.round(tau / STEP))


def test_errors_that_are_put_in_are_found(spoiled: ArmLog) -> None:
    found = statistics(spoiled, ARM)
    assert found.quantisation.value == pytest.approx(np.full(7, STEP), rel=0.01)
    assert found.white.value == pytest.approx(np.full(7, np.hypot(WHITE, 0.289 * STEP)), rel=0.35)
    # What a load weighs on joints 2, 4 and 6 is told from an offset by the motion alone.
    assert found.offset.value[[0, 2, 4, 6]] == pytest.approx(np.full(4, OFFSET), abs=0.04)
    assert found.coulomb.value == pytest.approx(COULOMB, rel=0.1)
    assert found.presliding.value == pytest.approx(np.full(7, PRESLIDING), abs=1.2e-3)
    wrist = slice(2, 7)  # the first joints' own acceleration hides a part
    assert found.cycles.value[wrist] == pytest.approx(np.full(5, 240.0), abs=10)
    assert found.ripple.value[wrist] == pytest.approx(np.full(5, RIPPLE), rel=0.25)
    assert found.second.value[wrist] == pytest.approx(np.full(5, SECOND), rel=0.1)


def test_intervals_hold_what_is_put_in(spoiled: ArmLog) -> None:
    found = statistics(spoiled, ARM)
    held = [
        (figure.low <= true) & (true <= figure.high)
        for figure, true in ((found.coulomb, COULOMB), (found.offset, OFFSET))
    ]
    assert np.sum(held) >= 12


def test_a_perfect_arm_shows_none_of_them(perfect: ArmLog) -> None:
    found = statistics(perfect, ARM)
    for figure in (found.quantisation, found.ripple, found.second, found.encoder_ripple):
        assert np.isnan(figure.value).all()
    assert np.nan_to_num(found.coulomb.value).max() < 0.05
    assert found.residual.value.max() < 0.05


def test_a_slow_recording_shows_neither_noise_of_samples_nor_ripple(spoiled: ArmLog) -> None:
    every = {name: getattr(spoiled, name)[::33] for name in ("t", "q", "dq", "tau")}
    found = statistics(replace(spoiled, **every), ARM)
    for figure in (found.white, found.ripple, found.cycles, found.shaking):
        assert np.isnan(figure.value).all()
    assert found.coulomb.value == pytest.approx(COULOMB, rel=0.25)


def test_a_joint_that_never_turns_shows_no_friction(spoiled: ArmLog) -> None:
    first = spoiled.t < 5.2
    q = spoiled.q[first].copy()
    q[:, 6] = q[0, 6]
    still = replace(spoiled, t=spoiled.t[first], q=q, dq=spoiled.dq[first], tau=spoiled.tau[first])
    found = statistics(still, ARM)
    assert np.isnan([found.coulomb.value[6], found.presliding.value[6]]).all()


def test_a_short_recording_is_refused(perfect: ArmLog) -> None:
    short = replace(
        perfect, t=perfect.t[:99], q=perfect.q[:99], dq=perfect.dq[:99], tau=perfect.tau[:99]
    )
    with pytest.raises(InputError, match=r"none, seed 0: give at least 5 s of free motion"):
        statistics(short, ARM)


@pytest.mark.skipif(not REAL.is_dir(), reason="the recordings of real arms are not here")
def test_the_measured_level_agrees_with_a_real_arm() -> None:
    there = statistics(real(REAL / "fr3_free_1.npz"), ARM)
    here = statistics(free_motion("measured", 1, 30.0), ARM)
    ratios = {
        name: np.nanmedian(getattr(here, name).value / getattr(there, name).value)
        for name in ("white", "quantisation", "coulomb", "residual", "ripple", "cycles")
    }
    assert all(0.5 < ratio < 2.0 for ratio in ratios.values()), ratios
    assert (here.shaking_left.value[:4] > here.shaking.value[:4]).all(), "as the real one's"
