"""Velocity, momentum, position."""

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.quantities.motion import estimate_momentum, estimate_velocity
from palpate.estimation.quantities.position import estimate_position
from palpate.mjcf.body import Body
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
    assert found.values[2] == pytest.approx(expected, abs=3 * found.stds[2] + 0.002)
    assert np.abs(found.values[:2]).max() < 1e-3
    assert found.parts["mean twist z"].value == pytest.approx(found.values[2], rel=0.05)
    (view,) = found.views
    assert view.measured[[0, -1]] == pytest.approx(view.predicted[[0, -1]], abs=1e-6), "mm"
    assert view.slopes @ found.values == pytest.approx(view.predicted)


def test_momentum_is_the_objects_alone(bench, noises):
    trace, _ = carried(bench, noises["lab"])
    velocity = estimate_velocity(trace, Parameter("can", "velocity"), None)
    found = estimate_momentum(trace, Parameter("can", "momentum"), None)
    assert found.values[2] == pytest.approx(0.3 * velocity.values[2], rel=0.1)
    assert found.intervals[2][0] <= 0.3 * velocity.values[2] <= found.intervals[2][1]
    mass, way = found.views
    assert mass.predicted == pytest.approx(found.parts["mass"].value)
    assert way.predicted == pytest.approx(velocity.views[0].predicted)


def placed(bench, noise, body):
    b = bench(noise)
    b.go("g", (0.5, 0.1, 0.2))
    b.close("can", 0.2)
    recording = b.measure(0.3, "contact", buffer=POSE)
    b.convert("Pose2Plan", "can", "position", recording)
    return estimate_position(b.trace(), Parameter("can", "position"), body)


def can(position, yaw=0.0, centre=(0.0, 0.0, 0.0), accuracy=None):
    pose = Pose.of(position, (np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)))
    words, size = frozenset({"can"}), np.array([0.06, 0.06, 0.1])
    return Body(
        "can", "object", words, pose, np.array(centre), size, {}, frozenset(), accuracy=accuracy
    )


def test_position_is_where_the_fingers_hold(bench, noises):
    found = placed(bench, noises["none"], None)
    assert found.values == pytest.approx((0.5, 0.1), abs=1e-4)
    assert min(found.stds) >= 1e-4


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_position_is_that_of_the_frame_not_of_the_shapes_middle(bench, noises, yaw):
    """The fingers hold the middle of the shapes, 20 mm and 10 mm from the frame's origin."""
    centre = np.array([0.02, -0.01, 0.05])
    frame = np.array([0.5, 0.1, 0.2]) - can((0.0, 0.0, 0.0), yaw).pose_world.apply(centre)
    found = placed(bench, noises["none"], can(frame, yaw, centre))
    assert found.values == pytest.approx(frame[:2], abs=2e-4)


def test_across_the_closing_direction_a_position_is_only_believed(bench, noises):
    """Believed off in x and y: the fingers tell of the direction along which they close alone."""
    believed = np.array([0.504, 0.101])
    found = placed(bench, noises["none"], can((*believed, 0.2)))
    truly_off, still_off = believed - (0.5, 0.1), found.values - (0.5, 0.1)
    closing = (truly_off - still_off) / np.linalg.norm(truly_off - still_off)
    assert closing @ still_off == pytest.approx(0.0, abs=2e-4)
    assert found.stds.max() > 0.005  # m, what is believed of a place that poses give
    assert found.unseen


def test_velocity_of_nothing_is_an_error(bench, noises):
    b = bench(noises["none"])
    b.dwell(0.1)
    empty = Recording(FORCES, 5.0, 6.0, Where("moving"))
    b.convert("Force2Velocity", "gripper", "velocity", empty)
    with pytest.raises(ValueError, match="velocity needs two"):
        estimate_velocity(b.trace(), Parameter("gripper", "velocity"), None)
