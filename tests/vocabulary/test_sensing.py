"""Sensing: what a recording stands for, and how long it is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.robots.safety import Expectation
from palpate.trace.recording import Context
from palpate.trace.samples import FORCES, POSE
from palpate.vocabulary.sensing import FORCE_WINDOW, POSE_WINDOW
from palpate.vocabulary.touch import DWELL

LIFT, AT = ("MovePose", "cup_pose + z_offset"), ("MovePose", "cup_pose")


@pytest.mark.parametrize(
    ("kind", "buffer"), [("MeasureForces", FORCES), ("MeasureGripperPose", POSE)]
)
def test_a_buffer_is_written_in_the_present_context(start, make, kind: str, buffer: str) -> None:
    primitive = make(kind)
    state = primitive.effects(replace(start, at="cup_pose", activity="sliding"))
    assert state.logged == ((buffer, Context("sliding", at="cup_pose")),)
    assert primitive.claims == frozenset()
    assert primitive.requires(start) == []


def test_contact_belongs_to_the_job_only_where_something_is_touched(start, make) -> None:
    expected = make("MeasureForces").expectation
    assert expected(start) == Expectation()
    assert expected(replace(start, activity="contact")) == Expectation(contact=True)
    assert expected(replace(start, holding="cup")) == Expectation(holding=True, grasped=True)


def test_windows_alone_and_beside_a_motion(perform) -> None:
    done = perform(
        "OpenGripper",
        LIFT,
        "MeasureForces",
        "MeasureGripperPose",
        [AT, "MeasureForces"],
        ["MeasureGripperPose", LIFT],
    )
    trace = done.execution.trace
    assert done.execution.status == "complete"
    still, pose, down, up = trace.recordings
    assert still.end - still.start == pytest.approx(FORCE_WINDOW, abs=0.03)
    assert pose.end - pose.start == pytest.approx(POSE_WINDOW, abs=0.03)
    assert [r.context.activity for r in trace.recordings] == ["still", "still", "moving", "moving"]
    assert [r.node for r in trace.recordings] == [
        "tree.children[2]",
        "tree.children[3]",
        "tree.children[4].children[1]",
        "tree.children[5].children[0]",
    ]
    for recording, motion in zip((down, up), trace.leaf_runs("MovePose")[1:], strict=True):
        assert (recording.start, recording.end) == (motion.start, motion.end)
        assert recording.end - recording.start > 2 * DWELL
    assert len(trace.of(still)) == pytest.approx(FORCE_WINDOW * 200, abs=6)
