"""Rests, passes and what the hand held."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.estimation.load_noise import load_rows
from palpate.estimation.segments import lift_path
from palpate.estimation.segments import weighing as weigh


def test_hand_is_neither_empty_nor_loaded_while_it_closes(weighing, noises):
    trace = weighing(0.254, noises["none"])
    load = load_rows(trace, "bottle")
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


def test_path_of_the_lift(weighing, noises):
    trace = weighing(0.254, noises["none"])
    path = lift_path(trace, trace.recordings[0], load_rows(trace, "bottle"))
    assert path is not None
    assert path.axis == pytest.approx([0, 0, 1], abs=1e-6)
    assert path.length == pytest.approx(0.12, abs=0.003)
    assert lift_path(trace, trace.recordings[0], load_rows(trace, "can")) is None


def test_a_few_rows_far_apart_are_no_pass(weighing, noises):
    """They would leave the other passes a common stretch in which some of them have no rows."""
    trace = weighing(0.254, noises["none"])
    recording = trace.recordings[0]

    def loaded_kinds(trace):
        return {one.kind for one in weigh(trace, recording).segments if one.loaded}

    assert "down" in loaded_kinds(trace)
    samples = trace.samples
    after = (samples.t > recording.end) & load_rows(trace, recording.context.holding).loaded
    poses = samples.pose_world_tcp.copy()
    beside = after & (np.arange(len(poses)) % 40 > 0)
    poses[beside, 0] += 0.03  # outside of the corridor of the lift, but for every 40th row
    sparse = replace(trace, samples=replace(samples, pose_world_tcp=poses))
    assert "down" not in loaded_kinds(sparse)
