"""Motion of the hand in samples."""

import numpy as np
import pytest

from palpate.estimation.motion import at_rest, mean_pose, runs, smoothed_with_rate
from palpate.trace.samples import Samples


def test_runs_are_maximal():
    mask = np.array([True, True, False, True, False, False, True])
    assert list(runs(mask)) == [slice(0, 2), slice(3, 4), slice(6, 7)]
    assert list(runs(np.zeros(3, dtype=bool))) == []


def test_a_rest_leaves_out_how_it_began_and_ended(weighing, noises):
    trace = weighing(0.254, noises["none"])
    rest = at_rest(trace.samples)
    assert rest.any()
    assert np.abs(trace.samples.twist[rest]).max() == 0.0


def test_mean_pose_needs_samples():
    with pytest.raises(ValueError, match="no samples"):
        mean_pose(Samples.empty())


def test_mean_pose_ignores_the_sign_of_quaternions(weighing, noises):
    trace = weighing(0.254, noises["none"])
    trace.samples.pose_world_tcp[::2, 3:] *= -1.0
    mean = mean_pose(trace.samples.between(0.0, 0.3))
    assert abs(mean.quaternion @ trace.samples.pose_world_tcp[0, 3:]) == pytest.approx(1.0)


def test_means_at_an_end_or_a_gap_in_motion_are_those_of_the_rows_there_are():
    t = np.concatenate([np.arange(0.0, 0.5, 0.005), np.arange(3.0, 3.5, 0.005)])
    speeds = np.where(t < 1.0, 2.0 * t, 1.0 - 4.0 * (t - 3.0))[:, None]
    smooth, rates = smoothed_with_rate(speeds, t, 0.1)
    assert rates[:, 0] == pytest.approx(np.where(t < 1.0, 2.0, -4.0))
    # A one-sided mean is that of a time at most a quarter of the window away.
    assert np.abs(smooth - speeds).max() < 4.0 * 0.1 / 4.0
