"""Rests, passes and what the hand held."""

import pytest

from palpate.estimation.load_noise import load_rows
from palpate.estimation.segments import lift_path


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
