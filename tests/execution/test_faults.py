"""A robot that fails, in whatever it is asked and whenever: what was recorded is returned, and the arm
is told to hold."""

from __future__ import annotations

import numpy as np
import pytest
from failing import Failing

from palpate.execution.runner import run

MOMENTS = (0.0, 0.3, 1.0, 1.9)
"""s: at the start, under way, while closing the fingers, while lifting."""


@pytest.fixture
def lifting(robot, node, plan):
    robot.support_z, robot.weight = 0.1, 2.5
    steps = [node("Go", z=0.1, speed=0.5), node("Grasp"), node("Go", z=0.2), node("MeasureForces")]
    return plan(*steps)


@pytest.mark.parametrize("lasting", [True, False], ids=["for good", "once"])
@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize(
    "member", ["state", "advance", "drain", "hold", "move_pose", "close_gripper"]
)
def test_fault_of_the_robot_loses_no_recording(
    lifting, scene, robot, words, member, moment, lasting
):
    failing = Failing(robot, member, moment, 10**9 if lasting else 1)
    done = run(lifting, scene, failing, words=words)
    if done.status == "complete":
        assert member in ("hold", "move_pose", "close_gripper")
    else:
        assert "ConnectionError: no answer" in done.stopped_by
    drained = robot.state.t if member != "drain" else moment
    assert len(done.trace.samples) >= min(moment, drained) / 0.02 - 2
    assert "hold" in [call for call, _ in robot.calls] or (member == "hold" and lasting)
    opened = [z for call, z in robot.calls if call == "open_gripper"]
    assert all(z < 0.11 for z in opened), "it was let go in the air"


def test_a_robot_that_hands_out_no_more_samples_still_puts_down(lifting, scene, robot, words):
    done = run(lifting, scene, Failing(robot, "drain", 1.9), words=words)
    assert done.stopped_by == "ConnectionError: no answer"
    assert done.final_state.holding is None
    assert [call for call, _ in robot.calls].count("open_gripper") == 1


def test_a_run_goes_on_without_a_working_observer(plan, node, scene, robot, words, caplog):
    seen = []

    class Broken:
        def on_tick(self, snapshot):
            seen.append(snapshot.elapsed)
            raise SystemExit(1)

    done = run(plan(node("Go", z=0.28)), scene, robot, words=words, observer=Broken())
    assert done.status == "complete"
    assert len(seen) == 1
    assert "unwatched" in caplog.text


def test_growing_trace_has_all_samples(plan, node, scene, robot, words):
    kept = []
    ended = []

    def keep(samples, recorder):
        kept.append(samples.t)
        ended.append(len(recorder.leaves))

    done = run(
        plan(node("Go", z=0.28), node("Wait", seconds=0.2)), scene, robot, words=words, keep=keep
    )
    assert np.concatenate(kept).tolist() == done.trace.samples.t.tolist()
    assert ended[-1] == 2


def test_a_disk_that_is_full_ends_only_the_writing(plan, node, scene, robot, words, caplog):
    def keep(samples, recorder):
        raise OSError(28, "No space left on device")

    done = run(plan(node("Go", z=0.28)), scene, robot, words=words, keep=keep)
    assert done.status == "complete"
    assert caplog.text.count("No space left") == 1


def test_a_clock_that_fails_leaves_the_time_that_was(plan, node, scene, robot, words):
    def no_number(r):
        if r.state.t > 0.5:
            r.put(t=float("nan"))

    robot.on_advance = no_number
    done = run(plan(node("Wait", seconds=2.0)), scene, robot, words=words, max_robot_seconds=1.0)
    assert done.status == "stopped"
    assert done.robot_seconds == pytest.approx(0.5, abs=0.05)


def test_a_clock_that_stands_still_ends_the_run(plan, node, scene, robot, words):
    def frozen(r):
        if r.state.t > 0.5:
            r.put(t=0.5, stamp=0.5)

    robot.on_advance = frozen
    done = run(plan(node("Wait", seconds=2.0)), scene, robot, words=words)
    assert "time goes back" in done.stopped_by
    assert [call for call, _ in robot.calls][-1] == "hold"
