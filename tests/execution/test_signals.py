"""A run on a robot whose sensors go wrong: a controlled stop that drops nothing and believes
nothing since then."""

from __future__ import annotations

import pytest

from palpate.estimation.evidence import remove_spoiled
from palpate.execution.recovery import resumable
from palpate.execution.runner import STOP_NODE, run


def test_a_fault_of_the_sensors_stops_the_run_and_nothing_is_let_go_of(
    robot, node, plan, scene, words
):
    robot.support_z, robot.weight = 0.1, 2.5

    def breaks(arm):
        if arm.state.t > 1.9:
            arm.put(width=0.5)

    robot.on_advance = breaks
    steps = [node("Go", z=0.1, speed=0.5), node("Grasp"), node("Go", z=0.2), node("MeasureForces")]
    done = run(plan(*steps), scene, robot, words=words)
    assert done.status == "stopped"
    assert "impossible width since 1.88 s: 500.0 mm" in done.stopped_by
    assert "still hold 'cup'" in done.stopped_by
    assert [call for call, _ in robot.calls].count("open_gripper") == 0
    assert done.fault is not None
    assert not resumable(done, robot)
    last = done.trace.leaves[-1]
    assert (last.node, last.label, last.status) == (STOP_NODE, "sensors", "FAILURE")
    assert last.start == pytest.approx(1.88), "its onset"
    assert remove_spoiled(done.trace).samples.t.max() <= last.start
