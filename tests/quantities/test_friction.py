"""Friction from drags: bias, direction, pressure."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.parameter import Parameter
from palpate.quantities.friction import estimate_friction

STATIC, DYNAMIC = 0.41, 0.34
PARAMETER = Parameter("bottle", "friction")
FALLING, CONSTANT = (0.012, 0.003), (0.006, 0.006)


def drag(bench, noise, seed=0, press=FALLING, there_and_back=True, goal=(0.6, 0.1, 0.2)):
    b = bench(noise, seed)
    above, grasp = (0.5, 0.1, 0.3), (0.5, 0.1, 0.2)
    b.go("bottle_pose + z_offset", above)
    b.go("bottle_pose", grasp)
    b.close("bottle", 0.254)
    b.go("bottle_pose + z_offset", above)
    b.measure()
    b.go("bottle_pose", grasp)
    b.drag("place", goal, STATIC, DYNAMIC, press)
    if there_and_back:
        b.drag("bottle_pose", grasp, STATIC, DYNAMIC, press)
    b.open()
    b.go("bottle_pose + z_offset", above)
    return b.trace()


def test_perfect_sensors(bench, noises):
    found = estimate_friction(drag(bench, noises["none"]), PARAMETER, None)
    assert found.value[0] == pytest.approx(DYNAMIC, abs=2e-3)
    assert found.parts["static"].value == pytest.approx(STATIC, abs=0.03)
    assert found.verdict == "identified"
    assert len(found.evidence) == 2


@pytest.mark.parametrize("world", ["lab", "datasheet"])
def test_the_arms_own_friction_does_not_reach_the_estimate(bench, noises, world):
    found = [
        estimate_friction(drag(bench, noises[world], seed), PARAMETER, None) for seed in range(10)
    ]
    dynamic = np.array([e.value[0] for e in found])
    static = np.array([e.parts["static"].value for e in found])
    covers = [low <= DYNAMIC <= high for ((low, high),) in (e.ci95 for e in found)]
    assert np.abs(dynamic - DYNAMIC).max() < 0.02
    assert np.abs(static.mean() - STATIC) < 0.03
    assert sum(covers) >= 8


def test_a_constant_pressure_leaves_the_bias_in_and_says_so(bench, noises):
    trace = drag(bench, noises["lab"], 1, CONSTANT)
    falling = estimate_friction(drag(bench, noises["lab"], 1, FALLING), PARAMETER, None)
    constant = estimate_friction(trace, PARAMETER, None)
    assert constant.std[0] > 3 * falling.std[0]
    assert abs(constant.value[0] - DYNAMIC) < 3 * constant.std[0]


@pytest.mark.parametrize("goal", [(0.6, 0.1, 0.2), (0.5, 0.2, 0.2), (0.43, 0.03, 0.2)])
def test_independent_of_direction(bench, noises, goal):
    found = estimate_friction(
        drag(bench, noises["none"], goal=goal, there_and_back=False), PARAMETER, None
    )
    assert found.value[0] == pytest.approx(DYNAMIC, abs=2e-3)


def test_nothing_dragged_nothing_known(weighing, noises):
    trace = weighing(0.254, noises["none"])
    found = estimate_friction(trace, PARAMETER, None)
    assert found.verdict == "not identified"
    assert len(found.value) == 0


def test_a_friction_that_cannot_be_told_from_none_has_no_value(bench, noises):
    trace = drag(bench, noises["lab"], 1, CONSTANT)
    unsure = replace(trace, hand=replace(trace.hand, torque_gain=0.8))
    found = estimate_friction(unsure, PARAMETER, None)
    assert found.verdict == "not identified"
    assert len(found.value) == 0
    assert not found.parts
    assert "cannot be told from none" in found.method
    assert len(found.evidence) == 2
