"""Velocity, momentum, position."""

import numpy as np
import pytest

from palpate.parameter import Parameter
from palpate.quantities.momentum import estimate_momentum
from palpate.quantities.position import estimate_position
from palpate.quantities.velocity import estimate_velocity
from palpate.trace.recording import Context as Where
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, POSE


def carried(bench, noise, mass=0.3):
    b = bench(noise, 4)
    above, grasp = (0.5, 0.1, 0.32), (0.5, 0.1, 0.2)
    b.go("a", above)
    b.go("g", grasp)
    b.close("can", mass)
    begin = b.t
    b.go("a", above)
    recording = Recording(FORCES, begin, b.t - 0.4, b.context("moving"))
    b.measure()
    b.go("g", grasp)
    b.open()
    b.go("a", above)
    b.convert("Force2Velocity", "can", "velocity", recording)
    b.convert("Force2Momentum", "can", "momentum", recording)
    return b.trace(), recording


def test_velocity_is_displacement_over_duration(bench, noises):
    trace, recording = carried(bench, noises["lab"])
    found = estimate_velocity(trace, Parameter("can", "velocity"), None)
    samples = trace.of(recording)
    expected = 0.12 / (samples.t[-1] - samples.t[0])
    assert found.value[2] == pytest.approx(expected, abs=3 * found.std[2] + 0.002)
    assert np.abs(found.value[:2]).max() < 1e-3
    assert found.parts["mean twist z"].value == pytest.approx(found.value[2], rel=0.05)


def test_momentum_is_the_objects_alone(bench, noises):
    trace, _ = carried(bench, noises["lab"])
    velocity = estimate_velocity(trace, Parameter("can", "velocity"), None)
    found = estimate_momentum(trace, Parameter("can", "momentum"), None)
    assert found.value[2] == pytest.approx(0.3 * velocity.value[2], rel=0.1)
    assert found.ci95[2][0] <= 0.3 * velocity.value[2] <= found.ci95[2][1]


def test_position_is_where_the_fingers_hold(bench, noises):
    b = bench(noises["none"])
    b.go("g", (0.5, 0.1, 0.2))
    b.close("can", 0.2)
    recording = b.measure(0.3, "contact", buffer=POSE)
    b.convert("Pose2Plan", "can", "position", recording)
    found = estimate_position(b.trace(), Parameter("can", "position"), None)
    assert found.value == pytest.approx((0.5, 0.1), abs=1e-4)
    assert min(found.std) >= 1e-4


def test_velocity_of_nothing_is_an_error(bench, noises):
    b = bench(noises["none"])
    b.dwell(0.1)
    empty = Recording(FORCES, 5.0, 6.0, Where("moving"))
    b.convert("Force2Velocity", "gripper", "velocity", empty)
    with pytest.raises(ValueError, match="velocity needs two"):
        estimate_velocity(b.trace(), Parameter("gripper", "velocity"), None)
