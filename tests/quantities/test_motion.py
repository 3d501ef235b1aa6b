"""Velocity, momentum, position."""

import numpy as np
import pytest

from palpate.quantities.motion import estimate_momentum, estimate_position, estimate_velocity
from palpate.trace.recording import Context as Where
from palpate.trace.recording import Conversion, Recording
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
    return b.trace(), recording


def test_velocity_is_displacement_over_duration(bench, noises):
    trace, recording = carried(bench, noises["lab"])
    found = estimate_velocity(
        trace, Conversion("Force2Velocity", "can", "velocity", recording, 99.0)
    )
    samples = trace.of(recording)
    expected = 0.12 / (samples.t[-1] - samples.t[0])
    assert found.value[2] == pytest.approx(expected, abs=3 * found.std[2] + 0.002)
    assert np.abs(found.value[:2]).max() < 1e-3
    assert found.components["mean twist z"][0] == pytest.approx(found.value[2], rel=0.05)


def test_momentum_is_the_objects_alone(bench, noises):
    trace, recording = carried(bench, noises["lab"])
    velocity = estimate_velocity(
        trace, Conversion("Force2Velocity", "can", "velocity", recording, 99.0)
    )
    found = estimate_momentum(
        trace, Conversion("Force2Momentum", "can", "momentum", recording, 99.0)
    )
    assert found.value[2] == pytest.approx(0.3 * velocity.value[2], rel=0.1)
    assert found.ci95[2][0] <= 0.3 * velocity.value[2] <= found.ci95[2][1]


def test_position_is_where_the_fingers_hold(bench, noises):
    b = bench(noises["none"])
    b.go("g", (0.5, 0.1, 0.2))
    b.close("can", 0.2)
    recording = b.measure(0.3, "contact", buffer=POSE)
    found = estimate_position(b.trace(), Conversion("Pose2Plan", "can", "position", recording, b.t))
    assert found.value == pytest.approx((0.5, 0.1), abs=1e-4)
    assert min(found.std) >= 1e-4


def test_velocity_of_nothing_is_an_error(bench, noises):
    b = bench(noises["none"])
    b.dwell(0.1)
    empty = Recording(FORCES, 5.0, 6.0, Where("moving"))
    with pytest.raises(ValueError, match="velocity needs two"):
        estimate_velocity(
            b.trace(), Conversion("Force2Velocity", "gripper", "velocity", empty, 6.0)
        )
