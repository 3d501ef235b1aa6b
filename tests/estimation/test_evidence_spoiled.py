"""Evidence in a run that was broken off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.estimation.evidence import remove_spoiled, spoiled_spans
from palpate.trace.recording import Context, Conversion, LeafRun, Recording
from palpate.trace.samples import Samples, Trace

STILL = Context("still")


def leaf(place: str, start: float, end: float, status: str = "SUCCESS") -> LeafRun:
    return LeafRun(place, "Any", place, start, end, status)  # pyright: ignore[reportArgumentType]


def recording(start: float, end: float) -> Recording:
    return Recording("gripper_forces", start, end, STILL)


@pytest.fixture
def ten_seconds(trace: Trace) -> Trace:
    """Samples from 0 to 10 s and nothing else."""
    samples = trace.samples.between(0.0, 10.0)
    return replace(trace, samples=samples, leaves=(), recordings=(), conversions=())


def test_a_trace_without_failed_leaves_is_all_evidence(trace: Trace) -> None:
    assert remove_spoiled(trace) is trace


def test_recordings_complete_before_a_failure_stay(ten_seconds: Trace) -> None:
    before, within, after = recording(1.0, 2.0), recording(4.0, 4.5), recording(6.0, 7.0)
    weighed = Conversion("Force2Mass", "cup", "mass", before, 2.0)
    late = replace(weighed, recording=after, time=7.0)
    trace = replace(
        ten_seconds,
        leaves=(
            leaf("tree.children[0]", 0.0, 3.0),
            leaf("tree.children[1]", 3.0, 5.0, "FAILURE"),
            leaf("stop", 5.0, 8.0),
        ),
        recordings=(before, within, after),
        conversions=(weighed, late),
    )
    kept = remove_spoiled(trace)
    assert kept.recordings == (before,)
    assert kept.conversions == (weighed,)
    assert [run.node for run in kept.leaves] == ["tree.children[0]"]
    assert kept.samples.t.max() <= 3.0
    assert spoiled_spans(trace)[0].spoiled_by.node == "tree.children[1]"


def test_a_recording_in_parallel_with_a_failed_leaf_is_no_evidence(ten_seconds: Trace) -> None:
    """The measurement ends well when the slide beside it runs into something."""
    slide = recording(3.0, 5.0)
    trace = replace(
        ten_seconds,
        leaves=(
            leaf("tree.children[0]", 0.0, 3.0),
            leaf("tree.children[1].children[1]", 3.0, 5.0),
            leaf("tree.children[1].children[0]", 4.0, 5.0, "FAILURE"),
        ),
        recordings=(slide,),
    )
    assert remove_spoiled(trace).recordings == ()
    assert len(remove_spoiled(trace).leaves) == 1


def test_recordings_of_a_later_attempt_are_evidence(ten_seconds: Trace) -> None:
    lost, again = recording(1.0, 2.0), recording(6.0, 7.0)
    trace = replace(
        ten_seconds,
        leaves=(
            leaf("tree", 1.0, 2.0, "FAILURE"),
            leaf("stop", 2.0, 4.0),
            leaf("replan[1].tree", 5.0, 8.0),
        ),
        recordings=(lost, again),
    )
    assert remove_spoiled(trace).recordings == (again,)
    assert not np.any(
        (remove_spoiled(trace).samples.t > 1.0) & (remove_spoiled(trace).samples.t < 5.0)
    )


def test_a_later_round_that_fails_takes_nothing_from_the_first(ten_seconds: Trace) -> None:
    first, again, third = recording(1.0, 2.0), recording(6.0, 7.0), recording(9.0, 9.5)
    trace = replace(
        ten_seconds,
        leaves=(
            leaf("tree.children[0]", 0.0, 3.0),
            leaf("repeat[1].tree.children[0]", 5.0, 6.0),
            leaf("repeat[1].stop", 6.0, 7.5, "FAILURE"),
            leaf("repeat[2].tree.children[0]", 8.0, 9.9),
        ),
        recordings=(first, again, third),
    )
    assert remove_spoiled(trace).recordings == (first, third)


def test_a_trace_without_samples_has_a_sound_part(ten_seconds: Trace) -> None:
    trace = replace(
        ten_seconds, samples=Samples.empty(), leaves=(leaf("tree", 0.0, 0.0, "INVALID"),)
    )
    assert len(remove_spoiled(trace).samples) == 0
