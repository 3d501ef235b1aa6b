"""What a fit would know of a load after passes that nobody has made yet."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimation.weighing import Lift
from palpate.estimation.wrench_observation import observation_of_torques
from palpate.robots.owner import load_description

ARM = load_description()
GRAVITY = 9.81


def lift(white: float = 1e-5) -> Lift:
    """Of 12 cm, in a line in joint space, by signals with `white` (N m)² s of noise."""
    q = np.array([ARM.home, ARM.home + np.array((0.0, -0.2, 0.0, 0.06, 0.0, -0.28, 0.0))])
    chain = ARM.nominal.chain
    assert chain is not None
    observed = observation_of_torques(np.zeros((0, 7)), chain, np.eye(3))
    return Lift(q, 0.12, 0.05, 1.0, observed, np.full(7, white), np.zeros(7))


def test_slow_passes_average_what_is_white() -> None:
    slow, fast = (lift().noise(1, speed, 2.0, GRAVITY, ARM.nominal) for speed in (0.05, 0.2))
    assert slow < 0.7 * fast


def test_noisier_signals_leave_more() -> None:
    quiet, loud = (lift(w).noise(1, 0.1, 2.0, GRAVITY, ARM.nominal) for w in (1e-6, 1e-4))
    assert loud > 3 * quiet


def test_gains_leave_what_is_in_proportion_to_the_load() -> None:
    noises = [lift().noise(1, 0.05, weight, GRAVITY, ARM.nominal) for weight in (2.0, 4.0)]
    one, two = (lift().floor(1, 0.05, weight, GRAVITY, ARM.nominal) for weight in (2.0, 4.0))
    assert noises[1] == pytest.approx(noises[0], rel=0.1)
    assert two == pytest.approx(2 * one, rel=0.2)
    assert one == pytest.approx(2.0 * ARM.nominal.torque_gain / np.sqrt(3), rel=0.5)


def test_more_cycles_show_how_well_passes_agree() -> None:
    one, two = (lift().noise(cycles, 0.1, 2.0, GRAVITY, ARM.nominal) for cycles in (1, 2))
    assert two < one / np.sqrt(2)


def test_slow_cycles_take_longer() -> None:
    assert lift().seconds(0.02) > 2 * lift().seconds(0.06)
