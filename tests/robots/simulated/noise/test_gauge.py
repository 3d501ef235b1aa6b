"""The sensors themselves: gain, cross-talk, curvature, hysteresis, ripple."""

from __future__ import annotations

import numpy as np
import pytest
from noises import ARM, model

from palpate.robots.simulated.noise.gauge import Gauges
from palpate.robots.simulated.noise.values import Streams

Q = ARM.home


def gauges(seed: int = 0, **torque: object) -> Gauges:
    return Gauges(model(torque=torque).torque, ARM.limits.tau_max, Streams(seed))


def shown(found: Gauges, torque: np.ndarray) -> np.ndarray:
    return found.read(torque, np.tile(Q, (len(torque), 1)))


def test_gains_are_uniform_within_their_half_width() -> None:
    ones = np.ones((1, 7))
    gains = np.array([shown(gauges(seed, gain_max=0.02), ones)[0] for seed in range(300)]) - 1.0
    assert np.abs(gains).max() <= 0.02
    assert gains.std() == pytest.approx(0.02 / np.sqrt(3), rel=0.06)
    assert np.mean(np.abs(gains) < 0.01) == pytest.approx(0.5, abs=0.04), "flat"


def test_crosstalk_reads_other_joints_torques() -> None:
    pure = np.eye(7) * 10.0
    leaks = np.array([shown(gauges(seed, crosstalk=0.01), pure) for seed in range(60)])
    own = np.diagonal(leaks, axis1=1, axis2=2)
    assert own == pytest.approx(np.full((60, 7), 10.0))
    assert leaks[:, ~np.eye(7, dtype=bool)].std() == pytest.approx(0.1, rel=0.06)


def test_curvature_is_quadratic_and_a_share_of_the_range() -> None:
    found = gauges(nonlinearity_max={"fixed": 1e-3}, range=50.0)
    torque = np.array([[0.0], [25.0], [50.0], [-50.0]]) * np.ones(7)
    off = (shown(found, torque) - torque)[:, 0]
    assert off == pytest.approx([0.0, 0.0125, 0.05, 0.05])


@pytest.mark.parametrize("swing", [4.0, 20.0])
def test_hysteresis_opens_a_loop_as_wide_as_its_share_of_the_swing(swing: float) -> None:
    found = gauges(hysteresis=0.01)
    up = np.linspace(0.0, swing, 200)
    cycle = np.concatenate([up, up[::-1], up, up[::-1]])
    out = shown(found, np.outer(cycle, np.ones(7)))[:, 0]
    loading, unloading = out[400:600], out[600:800][::-1]
    assert np.abs(unloading - loading).max() == pytest.approx(0.01 * swing, rel=0.45)
    assert loading[0] == pytest.approx(out[-1], abs=1e-9), "closed"


def test_ripple_repeats_with_its_cycles_in_a_turn() -> None:
    found = gauges(ripple={"size": 0.05, "cycles": 50})
    angles = np.linspace(0.0, 2 * np.pi, 2000, endpoint=False)
    out = found.read(np.zeros((2000, 7)), np.outer(angles, np.ones(7)))
    assert out.std(0) == pytest.approx(np.full(7, 0.05), rel=1e-3)
    assert np.abs(np.fft.rfft(out[:, 0])).argmax() == 50
