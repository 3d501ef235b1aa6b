"""Fifteen manipulations at once: refused by the check; forced past it, one motion has the arm and
nothing happens."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.execution.runner import run
from palpate.execution.simulated_cell import simulated_cell
from palpate.planning.registry import load_proposal
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario

FIFTEEN = scenario("fifteen_objects")


def test_fifteen_manipulations_in_one_parallel_are_refused() -> None:
    settings = FIFTEEN.settings(planner="replay:parallel").check_values()
    run = pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))
    assert run.status == "rejected"
    assert run.execution is None
    owners = [f.message for f in run.findings if f.rule == "one-owner"]
    assert any(
        "leaves would move the arm at once" in message and "Sequence" in message
        for message in owners
    )
    assert any("leaves would move the gripper at once" in message for message in owners)


def test_forced_past_the_check_the_second_motion_fails_and_ends_the_first() -> None:
    settings = FIFTEEN.settings().check_values()
    scene, plan = pipeline.load(settings), load_proposal(FIFTEEN.plans["parallel"]).plan
    assert scene is not None
    robot = simulated_cell(scene, settings.world).robot()
    before = {name: robot.world.true_poses([name])[name] for name in scene.objects}
    done = run(plan, scene, robot)

    assert done.status == "stopped"
    claims = [leaf for leaf in done.trace.leaves if leaf.node.startswith("tree.children[2].")]
    assert len(claims) == len(scene.objects) == 15
    first = next(c for c in claims if c.node == "tree.children[2].children[0].children[0]")
    reason = f"the arm is in use by {first.label}: one motion at a time"
    assert [leaf.message for leaf in claims if leaf.status == "FAILURE"] == [reason]
    interrupted = [leaf.message for leaf in claims if leaf.status == "INVALID"]
    assert interrupted == ["interrupted"] * (len(scene.objects) - 1)
    assert reason in (done.stopped_by or "")

    state = robot.state
    assert not state.moving
    assert np.linalg.norm(state.twist[:3]) < 0.003
    assert not state.gripping
    assert done.final_state.holding is None
    assert np.linalg.norm(done.trace.samples.wrench[:, :3], axis=1).max() < robot.limits.force_max
    assert done.trace.conversions == ()
    for name, pose in before.items():
        assert robot.world.true_poses([name])[name].position == pytest.approx(
            pose.position, abs=0.005
        )
