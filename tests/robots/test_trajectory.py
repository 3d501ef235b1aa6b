"""Bounded-jerk motions: straight ones, stops and swings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from palpate.common.pose import Pose
from palpate.robots.trajectory import (
    SWING_PEAK,
    MotionState,
    PosePath,
    PositionPath,
    Stretch,
    quintic,
    rotate_quaternion,
    rotation_vector,
    still,
    stop,
    straight,
    swing,
)

ZERO = np.zeros(3)


def rest(*p: float) -> MotionState:
    return MotionState(np.array(p), np.zeros(len(p)), np.zeros(len(p)))


def steadily(speed: float) -> list[Stretch]:
    return [Stretch(1.0, speed)]


def finely(path: PositionPath, step: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(path.knots[0], path.end + step, step)
    return t, path.sample(t)


@given(st.floats(0.01, 1.0), st.floats(0.05, 2.0))
def test_a_straight_motion_arrives_at_rest_below_its_speed(distance: float, speed: float) -> None:
    path = straight(
        2.0,
        rest(0.0, 0.0, 0.0),
        np.array([distance, 0.0, 0.0]),
        steadily(speed / distance),
        1.0 / distance,
    )
    _, p = finely(path)
    assert p[0] == pytest.approx(ZERO)
    assert path.at(path.end).p == pytest.approx([distance, 0.0, 0.0])
    assert np.abs(np.gradient(p[:, 0], 1e-3)).max() <= speed * 1.001
    assert (np.diff(p[:, 0]) >= -1e-12).all(), "never backwards"


def test_a_long_motion_cruises_at_its_speed() -> None:
    path = straight(0.0, rest(0.0), np.array([0.5]), steadily(0.1 / 0.5), 1.0 / 0.5)
    _, p = finely(path)
    speed = np.gradient(p[:, 0], 1e-3)
    assert np.isclose(speed, 0.1, rtol=1e-6).mean() > 0.9


@given(
    st.lists(st.tuples(st.floats(0.003, 0.4), st.floats(0.01, 0.25)), min_size=1, max_size=6),
    st.floats(0.5, 3.0),
)
@example([(0.003, 0.03125)], 1.0)
def test_every_stretch_keeps_its_speed_limit(
    parts: list[tuple[float, float]], acceleration: float
) -> None:
    lengths, speeds = np.array(parts).T
    whole = float(lengths.sum())
    stretches = [
        Stretch(end / whole, speed / whole)
        for end, speed in zip(np.cumsum(lengths), speeds, strict=True)
    ]
    path = straight(0.0, rest(0.0), np.array([whole]), stretches, acceleration / whole)
    t = np.arange(0.0, path.end + 0.002, 0.002)
    at = path.sample(t)[:, 0]
    speed = np.gradient(at, t)
    allowed = speeds[np.minimum(np.searchsorted(np.cumsum(lengths), at), len(lengths) - 1)]
    beside = np.abs(at[:, None] - np.cumsum(lengths)).min(axis=1) < 1e-3
    assert at[0] == 0.0
    assert at[-1] == pytest.approx(whole)
    assert (speed <= allowed * 1.001 + 1e-9)[~beside].all()
    assert (speed >= -1e-9).all()


def test_a_motion_slows_down_before_a_slow_stretch_and_does_not_stop_there() -> None:
    path = straight(
        0.0, rest(0.0), np.array([0.3]), [Stretch(2 / 3, 0.2 / 0.3), Stretch(1.0, 0.1)], 1.0 / 0.3
    )
    t, p = finely(path)
    speed = np.gradient(p[:, 0], t)
    slow = p[:, 0] > 0.2
    assert speed[slow].max() == pytest.approx(0.03, rel=1e-3)
    assert speed[~slow].max() == pytest.approx(0.2, rel=1e-3)
    assert speed[(p[:, 0] > 0.15) & (p[:, 0] < 0.25)].min() > 0.029


def test_jerk_is_bounded() -> None:
    path = straight(0.0, rest(0.0), np.array([0.3]), steadily(0.25 / 0.3), 1.0 / 0.3)
    _, p = finely(path)
    jerk = np.diff(p[:, 0], 3) / 1e-9
    assert np.abs(jerk).max() < 12.0  # 6 v / T^2 of the ramps, m/s^3


def test_a_path_stands_still_before_and_after() -> None:
    path = straight(1.0, rest(0.2), np.array([0.4]), steadily(1.0), 1.0)
    assert path.sample(np.array([0.0, 99.0]))[:, 0] == pytest.approx([0.2, 0.4])
    assert path.at(99.0).v == pytest.approx([0.0])


def test_a_stop_goes_on_smoothly() -> None:
    path = straight(0.0, rest(0.0), np.array([0.5]), steadily(0.4), 2.0)
    now = path.at(0.7)
    halt = stop(0.7, now, 1.0)
    begun = halt.at(0.7)
    assert begun.p == pytest.approx(now.p)
    assert begun.v == pytest.approx(now.v)
    assert begun.a == pytest.approx(now.a)
    assert halt.at(halt.end - 1e-9).v == pytest.approx([0.0], abs=1e-6)
    assert now.p[0] < halt.at(halt.end).p[0] < now.p[0] + 0.1


def test_replacing_a_motion_under_way_keeps_position_and_speed() -> None:
    first = straight(0.0, rest(0.0, 0.0), np.array([0.5, 0.0]), steadily(0.4), 2.0)
    now = first.at(0.8)
    second = straight(0.8, now, np.array([0.2, 0.3]), steadily(0.5), 2.0)
    assert second.at(0.8).v == pytest.approx(now.v)
    assert second.at(second.end).p == pytest.approx([0.2, 0.3])


def test_quintic_meets_both_ends() -> None:
    start, end = (
        MotionState(np.array([1.0]), np.array([2.0]), np.array([3.0])),
        MotionState(*np.array([[4.0], [5.0], [6.0]])),
    )
    c = quintic(start, end, 1.5)[:, 0]
    polynomial = np.polynomial.Polynomial(c)
    assert [polynomial(1.5), polynomial.deriv(1)(1.5), polynomial.deriv(2)(1.5)] == pytest.approx(
        [4, 5, 6]
    )


@given(st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_a_trajectory_turns_by_the_rotation_vector(
    angles: tuple[float, float, float],
) -> None:
    start = Pose.top_down([0, 0, 0], 0.4).quaternion
    goal = rotate_quaternion(start, np.array([angles]))[0]
    assert np.linalg.norm(goal) == pytest.approx(1.0)
    assert rotation_vector(start, goal) == pytest.approx(np.array(angles), abs=1e-9)


def test_a_pose_path_has_a_turning_rate() -> None:
    origin = Pose.top_down([0, 0, 0], 0.0).quaternion
    goal = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.8])
    path = PosePath(straight(0.0, rest(*np.zeros(6)), goal, steadily(0.5), 1.0), origin)
    middle = path.motion(path.end / 2)
    assert middle.p[3:] == pytest.approx(ZERO)
    assert middle.v[3:] == pytest.approx([0.0, 0.0, 0.4], rel=1e-3)


def test_a_trajectory_to_the_same_pose_stands_still() -> None:
    path = still(3.0, np.array([1.0, 2.0]))
    assert path.end == 3.0
    assert path.sample(np.array([0.0, 9.0])) == pytest.approx(np.array([[1, 2], [1, 2]]))


REST = MotionState(np.array([0.4, 0.0]), np.zeros(2), np.zeros(2))
AMPLITUDE = np.array([0.0, 0.05])


@pytest.fixture(scope="module")
def path():
    return swing(1.0, REST, AMPLITUDE, 2.0, 3)


def test_a_swing_begins_and_ends_at_rest_where_it_was(path):
    assert path.end == pytest.approx(1.0 + 5 / 2.0)
    for time in (1.0, path.end - 1e-9, path.end + 1.0):
        state = path.at(time)
        assert state.p == pytest.approx(REST.p, abs=1e-7)
        assert state.v == pytest.approx(np.zeros(2), abs=1e-5)


def test_a_swing_is_a_sine_between(path):
    times = np.linspace(1.0 + 0.5, path.end - 0.5, 301)
    wanted = REST.p + np.outer(np.sin(2 * np.pi * 2.0 * (times - 1.0)), AMPLITUDE)
    assert path.sample(times) == pytest.approx(wanted, abs=1e-6)


def test_a_growing_swing_accelerates_a_little_more_and_is_never_faster(path):
    times = np.linspace(1.0, path.end, 2001)
    states = [path.at(time) for time in times]
    rate = 2 * np.pi * 2.0
    assert max(abs(s.v[1]) for s in states) < 1.01 * 0.05 * rate
    assert max(abs(s.a[1]) for s in states) < SWING_PEAK * 0.05 * rate**2
