"""Rests, passes and what the hand held."""

import numpy as np
import pytest

from palpate.estimation.windows import at_rest, lift_path, load_of, mean_pose, runs
from palpate.trace.samples import Samples


def test_runs_are_maximal():
    mask = np.array([True, True, False, True, False, False, True])
    assert list(runs(mask)) == [slice(0, 2), slice(3, 4), slice(6, 7)]
    assert list(runs(np.zeros(3, dtype=bool))) == []


def test_hand_is_neither_empty_nor_loaded_while_it_closes(weighing, noises):
    trace = weighing(0.254, noises["none"])
    load = load_of(trace, "bottle")
    close = trace.leaf_runs("CloseGripper")[0]
    opened = trace.leaf_runs("OpenGripper")[0]
    t = trace.samples.t
    assert not (load.loaded & load.empty).any()
    closing = (t > close.start) & (t < close.end)
    assert not load.loaded[closing].any()
    assert not load.empty[closing].any()
    assert load.loaded[(t > close.end) & (t < opened.start)].all()
    assert load.empty[t > opened.end].all()
    assert load.grasps == (close.end, opened.start)


def test_a_rest_leaves_out_how_it_began_and_ended(weighing, noises):
    trace = weighing(0.254, noises["none"])
    rest = at_rest(trace.samples)
    assert rest.any()
    assert np.abs(trace.samples.twist[rest]).max() == 0.0


def test_path_of_the_lift(weighing, noises):
    trace = weighing(0.254, noises["none"])
    path = lift_path(trace, trace.recordings[0], load_of(trace, "bottle"))
    assert path is not None
    assert path.axis == pytest.approx([0, 0, 1], abs=1e-6)
    assert path.length == pytest.approx(0.12, abs=0.003)
    assert lift_path(trace, trace.recordings[0], load_of(trace, "can")) is None


def test_mean_pose_needs_samples():
    with pytest.raises(ValueError, match="no samples"):
        mean_pose(Samples.empty())


def test_mean_pose_ignores_the_sign_of_quaternions(weighing, noises):
    trace = weighing(0.254, noises["none"])
    trace.samples.pose_world_tcp[::2, 3:] *= -1.0
    mean = mean_pose(trace.samples.between(0.0, 0.3))
    assert abs(mean.quaternion @ trace.samples.pose_world_tcp[0, 3:]) == pytest.approx(1.0)
