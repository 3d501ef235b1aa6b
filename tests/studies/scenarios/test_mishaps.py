"""Hallucinated or unlucky: every mishap ends in a rejection or a controlled stop that says why;
nothing is dropped."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.cli.console import EXIT
from palpate.execution.runner import STOP_NODE
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario

from .judge import between, executed, joint_of

STOPPED = {
    "slip": "slip: the fingers closed",
    "too_heavy": "more than the payload of 3 kg",
    "obstacle": "unexpected contact",
}
REJECTED = {
    "unreachable": "out of the arm's reach",
    "two_bottles": "may be 'blue_bottle' or 'green_bottle'",
}


@pytest.mark.parametrize("name", STOPPED)
def test_a_mishap_while_moving_ends_in_a_controlled_stop(name: str) -> None:
    run = executed(scenario(f"mishaps/{name}"))
    execution, footage, trace = run.execution, run.footage, run.trace
    assert execution is not None
    assert footage is not None
    assert trace is not None
    assert run.final_state is not None
    assert EXIT[run.status] == 4
    assert STOPPED[name] in (execution.stopped_by or "")
    failed = [leaf for leaf in trace.leaves if leaf.status == "FAILURE" and leaf.node != STOP_NODE]
    assert [leaf.primitive for leaf in failed] == ["MovePose"]
    assert trace.conversions == ()
    assert all(estimate.verdict == "not identified" for estimate in run.estimates)
    assert run.final_state.holding is None
    assert np.linalg.norm(trace.samples.twist[-1, :3]) < 0.01

    joint = joint_of(run, "bottle")
    stood = footage.frames[3][1]
    for _, now in footage.frames:
        distance, tilt = between(stood, now, joint)
        assert distance < 0.010
        assert tilt < np.radians(5.0)
    heights = np.array([now[joint][2] for _, now in footage.frames])
    times = np.array([t for t, _ in footage.frames])
    assert np.gradient(heights, times).min() > -0.05, "it fell"


@pytest.mark.parametrize("name", REJECTED)
def test_a_mishap_in_the_plan_or_the_request_is_a_rejection_and_nothing_moves(name: str) -> None:
    run = executed(scenario(f"mishaps/{name}"))
    assert EXIT[run.status] == 3
    assert run.execution is run.footage is None
    text = " ".join([run.plan.explanation, *(finding.message for finding in run.findings)])
    assert REJECTED[name] in text


@pytest.mark.parametrize(
    ("name", "reason"), [("slip", STOPPED["slip"]), ("unreachable", REJECTED["unreachable"])]
)
def test_the_reason_is_in_the_result(name: str, reason: str, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    pipeline.run(scenario(f"mishaps/{name}").settings(out=folder, fast=True))
    assert reason in json.dumps(
        json.loads((folder / "result.json").read_text("utf-8")), ensure_ascii=False
    )
