"""To and fro about a state of rest."""

import numpy as np
import pytest

from palpate.robots.trajectory.path import Motion
from palpate.robots.trajectory.swing import SWING_PEAK, swing

REST = Motion(np.array([0.4, 0.0]), np.zeros(2), np.zeros(2))
AMPLITUDE = np.array([0.0, 0.05])


@pytest.fixture(scope="module")
def path():
    return swing(1.0, REST, AMPLITUDE, 2.0, 3)


def test_it_begins_and_ends_at_rest_where_it_was(path):
    assert path.end == pytest.approx(1.0 + 5 / 2.0)
    for time in (1.0, path.end - 1e-9, path.end + 1.0):
        state = path.at(time)
        assert state.p == pytest.approx(REST.p, abs=1e-7)
        assert state.v == pytest.approx(np.zeros(2), abs=1e-5)


def test_it_is_a_sine_between(path):
    times = np.linspace(1.0 + 0.5, path.end - 0.5, 301)
    wanted = REST.p + np.outer(np.sin(2 * np.pi * 2.0 * (times - 1.0)), AMPLITUDE)
    assert path.sample(times) == pytest.approx(wanted, abs=1e-6)


def test_as_it_grows_it_accelerates_a_little_more_and_is_never_faster(path):
    times = np.linspace(1.0, path.end, 2001)
    states = [path.at(time) for time in times]
    rate = 2 * np.pi * 2.0
    assert max(abs(s.v[1]) for s in states) < 1.01 * 0.05 * rate
    assert max(abs(s.a[1]) for s in states) < SWING_PEAK * 0.05 * rate**2
