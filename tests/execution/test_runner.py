from __future__ import annotations

import os
import signal
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from py_trees.common import Status

from palpate.common.errors import InputError
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.recovery import resumable
from palpate.execution.runner import run
from palpate.planning.plan import Plan
from palpate.primitives.sensing import FORCE_WINDOW

TABLE = 0.1
"""m: TCP height at which the cup stands on its support; it is also its grasp height."""


@pytest.fixture
def carrying(robot, node):
    """The cup is grasped at its place and being lifted when the last node is reached."""
    robot.support_z, robot.weight = TABLE, 2.5
    return [node("Go", z=TABLE, speed=0.5), node("Grasp")]


def commands(robot):
    return [call for call, _ in robot.calls]


def opened_at(robot):
    return next(z for call, z in robot.calls if call == "open_gripper")


def test_a_complete_run(plan, node, scene, robot, words):
    done = run(
        plan(node("Go", z=0.28), node("MeasureForces"), node("Go", z=0.3)),
        scene,
        robot,
        words=words,
    )
    assert (done.status, done.stopped_by, done.actions) == ("complete", None, 3)
    assert done.final_state.at == "z = 0.3"
    assert done.robot_seconds == pytest.approx(0.2 + FORCE_WINDOW + 0.2, abs=0.2)
    (recording,) = done.trace.recordings
    assert len(done.trace.of(recording)) == pytest.approx(FORCE_WINDOW / 0.02, abs=2)
    assert len(done.trace.samples) == pytest.approx(done.robot_seconds / 0.02, abs=1)
    assert done.trace.hand is robot.hand
    assert "close" not in commands(robot)


def test_the_arm_holds_when_all_is_done(plan, node, scene, robot, words):
    run(plan(node("Go", z=0.28)), scene, robot, words=words)
    assert commands(robot)[-1] == "hold"


def test_a_plan_without_a_tree_does_not_move(scene, robot):
    with pytest.raises(InputError, match="temperature is no quantity"):
        run(Plan((), None, "temperature is no quantity"), scene, robot)
    assert robot.calls == []


def test_a_failed_leaf_stops_the_run_and_says_why(plan, node, scene, robot, words):
    done = run(
        plan(node("Go", z=0.28), node("Refuse"), node("Go", z=0.1)), scene, robot, words=words
    )
    assert (done.status, done.stopped_by, done.actions) == ("stopped", "Refuse(): it refuses", 2)
    assert commands(robot).count("move_pose") == 1


@pytest.mark.parametrize("last", [{"kind": "Refuse"}, {"kind": "Crash"}, {"kind": "Never"}])
def test_a_held_object_is_put_down_where_it_came_from(
    plan, node, scene, robot, words, carrying, last
):
    done = run(plan(*carrying, node("Go", z=0.2), node(last["kind"])), scene, robot, words=words)
    assert done.status == "stopped"
    assert opened_at(robot) == pytest.approx(TABLE, abs=0.005)
    assert robot.calls[-2:] == [("move_axis", (0, 0, 1)), ("hold", None)]
    assert robot.state.pose_world_tcp.position[2] == pytest.approx(TABLE + 0.1, abs=0.006)
    assert (done.final_state.holding, done.final_state.gripper) == (None, "open")
    assert done.final_state.moved["cup"].position[2] == pytest.approx(0.085, abs=0.006)
    down = done.trace.leaves[-1]
    assert (down.node, down.primitive, down.status, down.message) == (
        "stop",
        "PutDown",
        "SUCCESS",
        "put cup down",
    )
    assert done.actions == 4


def test_an_object_that_was_not_lifted_yet_is_simply_let_go(
    plan, node, scene, robot, words, carrying
):
    done = run(plan(*carrying, node("Refuse")), scene, robot, words=words)
    assert done.final_state.holding is None
    assert opened_at(robot) == pytest.approx(TABLE)
    assert ("move_axis", (0, 0, -1)) not in robot.calls


def test_a_motion_that_is_broken_off_half_way_up_puts_down_as_well(
    plan, node, scene, robot, words, carrying
):
    def stale_once(r):
        if (
            r.state.gripping
            and r.state.pose_world_tcp.position[2] > 0.15
            and "hold" not in commands(r)
        ):
            r.put(stamp=r.state.t - 0.2)

    robot.on_advance = stale_once
    done = run(plan(*carrying, node("Go", z=0.3, speed=0.2)), scene, robot, words=words)
    assert "sensor data is 200 ms old" in done.stopped_by
    assert opened_at(robot) == pytest.approx(TABLE, abs=0.005)


@pytest.mark.parametrize("times", [1, 9])
def test_object_that_yields_as_it_is_put_down_is_pressed_again(
    plan, node, scene, robot, words, carrying, times
):
    """An object that hung askew lies flat once pressed; a support that keeps yielding is none."""
    given: list[float] = []

    def give_way(r):
        z = r.state.pose_world_tcp.position[2]
        pressed = r.state.gripping and not r.state.moving and r.support_z - z > 0.001
        if pressed and len(given) < times:
            given.append(r.state.t)
            r.support_z = z + 0.0005

    def once_lifted(r):
        if r.state.gripping and r.state.pose_world_tcp.position[2] > 0.15:
            r.on_advance = give_way

    robot.on_advance = once_lifted
    done = run(plan(*carrying, node("Go", z=0.2), node("Refuse")), scene, robot, words=words)
    assert len(given) == min(times, 3)
    assert (done.final_state.holding is None) == (times == 1)
    assert ("open_gripper" in commands(robot)) == (times == 1)


def once_lifted(support_z):
    """The support stands elsewhere by the time that the cup is lifted."""

    def moved(r):
        if r.state.gripping and r.state.pose_world_tcp.position[2] > 0.18:
            r.support_z = support_z

    return moved


@pytest.mark.parametrize("height", [0.2, TABLE + 0.002])
def test_an_object_without_support_below_stays_in_the_fingers(
    plan, node, scene, robot, words, carrying, height
):
    """Also where it was lifted, and is nearly at its place again."""
    robot.on_advance = once_lifted(-1.0)
    steps = [*carrying, node("Go", z=0.2), node("Go", z=height), node("Refuse")]
    done = run(plan(*steps), scene, robot, words=words)
    assert "open_gripper" not in commands(robot)
    assert commands(robot)[-1] == "hold"
    assert done.final_state.holding == "cup"
    assert done.stopped_by == "Refuse(): it refuses; the fingers still hold 'cup'"
    assert "no support within" in done.trace.leaves[-1].message
    assert robot.state.pose_world_tcp.position[2] > TABLE - 0.02, "it is not sought any further"


@pytest.mark.parametrize(("higher", "put_down"), [(-0.01, True), (0.015, True), (0.03, False)])
def test_a_contact_counts_as_support_only_at_the_believed_height(
    plan, node, scene, robot, words, carrying, higher, put_down
):
    """A believed pose is 20 mm off at most: what is met higher up is something else."""
    robot.on_advance = once_lifted(TABLE + higher)
    done = run(plan(*carrying, node("Go", z=0.2), node("Refuse")), scene, robot, words=words)
    assert ("open_gripper" in commands(robot)) == put_down
    assert ("mm above its support" in done.trace.leaves[-1].message) == (not put_down)


def test_a_support_carries_more_than_the_weight_before_the_fingers_open(
    plan, node, scene, robot, words, carrying
):
    """Some newtons, which tell a support from a touch, and no more than that, met at less than 2 cm/s."""
    pressed, speeds, thresholds = [], [], []

    def press(r):
        if r.state.gripping:
            pressed.append(-float(r.state.wrench[2]))
        if r.state.gripping and commands(r)[-1] == "move_axis":
            speeds.append(r.speed)
            thresholds.append(r.thresholds.force)

    robot.on_advance = press
    robot.set_reflex(robot.limits.reflexes.free)
    run(plan(*carrying, node("Go", z=0.2), node("Refuse")), scene, robot, words=words)
    assert 4.5 < pressed[-1] < 10.0
    assert max(speeds) < 0.02
    assert set(thresholds) == {robot.limits.reflexes.contact.force}, "pressing is part of it"
    assert robot.thresholds.force == robot.limits.reflexes.free.force, "the retreat is in free air"


def test_an_arm_that_presses_on_something_is_relieved_step_by_step(plan, node, scene, robot, words):
    """`hold` alone keeps the force of the set-point that is ahead of the arm."""

    def obstacle(r):
        if r.state.t > 0.5:
            left = 100.0 * 0.5 ** commands(r).count("move_joints")
            r.put(wrench=np.array([left, 0.0, 0.0, 0.0, 0.0, 0.0]))

    robot.on_advance = obstacle
    done = run(plan(node("Go", z=0.1)), scene, robot, words=words)
    assert "exceeds the limit of 40 N" in done.stopped_by
    eased = [(call, what) for call, what in robot.calls if call == "move_joints"]
    assert len(eased) == 2, "until no more than 25 N are left"
    assert eased[-1][1] == pytest.approx(robot.state.q), "to where it stands"


def test_a_lost_object_is_not_searched_for(plan, node, scene, robot, words, carrying):
    robot.on_advance = lambda r: r.put(
        gripping=r.state.gripping and r.state.pose_world_tcp.position[2] < 0.15
    )
    done = run(plan(*carrying, node("Go", z=0.2)), scene, robot, words=words)
    assert "slip" in done.stopped_by
    assert commands(robot)[-1] == "hold"
    assert "open_gripper" not in commands(robot)


def test_too_much_force_while_putting_down_holds_still(plan, node, scene, robot, words, carrying):
    def obstacle(r):
        if r.calls[-1:] == [("move_axis", (0, 0, -1))]:
            r.force[0] = 60.0

    robot.on_advance = obstacle
    done = run(plan(*carrying, node("Go", z=0.2), node("Refuse")), scene, robot, words=words)
    assert "open_gripper" not in commands(robot)
    assert "exceeds the limit of 40 N" in done.trace.leaves[-1].message
    assert done.final_state.holding == "cup"


def test_a_stop_request_ends_the_run(plan, node, scene, robot, words):
    done = run(
        plan(node("Go", z=0.1)),
        scene,
        robot,
        words=words,
        stop_requested=lambda: robot.state.t > 0.5,
    )
    assert (done.status, done.stopped_by) == ("stopped", "stop requested")
    assert done.robot_seconds == pytest.approx(0.5, abs=0.1)
    assert [(leaf.status, leaf.message) for leaf in done.trace.leaves] == [
        ("INVALID", "interrupted")
    ]


def test_the_budget_of_robot_time_ends_the_run(plan, node, scene, robot, words):
    done = run(plan(node("Wait", seconds=20.0)), scene, robot, words=words, max_robot_seconds=1.0)
    assert done.stopped_by == "not done after 1 s of robot time, the budget of a run"
    assert done.robot_seconds == pytest.approx(1.0, abs=0.1)


def test_a_robot_that_fails_in_the_loop_gives_what_was_recorded(
    plan, node, scene, robot, words, caplog
):
    def lost(r):
        if r.state.t > 0.5:
            raise ConnectionError("no answer")

    robot.on_advance = lost
    done = run(plan(node("Go", z=0.1)), scene, robot, words=words)
    assert done.stopped_by == "ConnectionError: no answer"
    assert len(done.trace.samples) >= 24
    assert commands(robot)[-1] == "hold"


def interrupt_at(robot, *times):
    pending = list(times)

    def press(r):
        if pending and r.state.t >= pending[0]:
            pending.pop(0)
            os.kill(os.getpid(), signal.SIGINT)

    robot.on_advance = press


def test_the_first_interrupt_puts_the_object_down(plan, node, scene, robot, words, carrying):
    before = signal.getsignal(signal.SIGINT)
    interrupt_at(robot, 1.5)
    done = run(
        plan(*carrying, node("Go", z=0.2), node("Wait", seconds=10.0)), scene, robot, words=words
    )
    assert (done.status, done.stopped_by) == ("stopped", "interrupted")
    assert opened_at(robot) == pytest.approx(TABLE, abs=0.005)
    assert done.final_state.holding is None
    assert len(done.trace.samples) > 75
    assert signal.getsignal(signal.SIGINT) is before


def test_the_second_interrupt_holds_at_once(plan, node, scene, robot, words, carrying):
    interrupt_at(robot, 2.5, 3.0)
    done = run(
        plan(*carrying, node("Go", z=0.3), node("Wait", seconds=10.0)), scene, robot, words=words
    )
    assert done.stopped_by == "interrupted; the fingers still hold 'cup'"
    assert "open_gripper" not in commands(robot)
    assert commands(robot)[-1] == "hold"
    assert done.robot_seconds == pytest.approx(3.0, abs=0.05)
    assert done.trace.leaves[-1].status == "INVALID"


def test_an_interrupt_raised_inside_a_primitive_is_a_controlled_stop(
    plan, node, scene, robot, words, carrying
):
    done = run(
        plan(*carrying, node("Go", z=0.2), node("Crash", error="KeyboardInterrupt")),
        scene,
        robot,
        words=words,
    )
    assert done.stopped_by == "interrupted"
    assert opened_at(robot) == pytest.approx(TABLE, abs=0.005)
    assert [leaf.status for leaf in done.trace.leaves[-2:]] == ["INVALID", "SUCCESS"]


def test_runs_off_the_main_thread(plan, node, scene, robot, words):
    results = []
    thread = threading.Thread(
        target=lambda: results.append(run(plan(node("Go", z=0.28)), scene, robot, words=words))
    )
    thread.start()
    thread.join(10)
    assert [r.status for r in results] == ["complete"]


def test_an_observer_sees_every_tick_and_keeps_final_statuses(plan, node, scene, robot, words):
    views = []

    class Watcher:
        def on_tick(self, snapshot):
            views.append(
                (
                    snapshot.elapsed,
                    [n.status for n in snapshot.root.iterate() if isinstance(n, PrimitiveLeaf)],
                    snapshot.stopping,
                )
            )

    run(
        plan(node("Go", z=0.28), node("Refuse"), node("Wait", seconds=1.0)),
        scene,
        robot,
        words=words,
        observer=Watcher(),
    )
    assert [round(v[0] / 0.02) for v in views] == list(range(1, len(views) + 1))
    assert views[0][1][0] is Status.RUNNING
    assert views[-1][1] == [Status.SUCCESS, Status.FAILURE, Status.INVALID]
    assert views[-1][2] == "Refuse(): it refuses"


@pytest.mark.parametrize("error", [OSError("the disk is full"), SystemExit("no terminal")])
def test_a_failing_observer_or_writer_is_dropped_and_the_arm_goes_on(
    plan, node, scene, robot, words, error
):
    calls = []

    def fail(*what):
        calls.append(len(what))
        raise error if len(what) == 1 else OSError("the disk is full")

    watcher = SimpleNamespace(on_tick=fail)
    done = run(plan(node("Go", z=0.28)), scene, robot, words=words, observer=watcher, keep=fail)
    assert done.status == "complete"
    assert sorted(calls) == [1, 2]


def test_only_an_unrequested_stop_with_empty_fingers_may_be_continued(
    plan, node, scene, robot, words
):
    done = run(plan(node("Refuse")), scene, robot, words=words)
    assert resumable(done, robot)
    holding = replace(done.final_state, holding="cup")
    changes = (
        {"asked": True},
        {"fault": "nan"},
        {"status": "complete"},
        {"final_state": holding},
    )
    for change in changes:
        assert not resumable(replace(done, **change), robot), change


def test_the_same_run_twice_is_the_same(plan, node, scene, robot, words):
    first, second = (
        run(plan(node("Go", z=0.28), node("MeasureForces")), scene, type(robot)(), words=words)
        for _ in range(2)
    )
    assert first.trace.leaves == second.trace.leaves
    assert first.trace.recordings == second.trace.recordings
    assert (first.trace.samples.pose_world_tcp == second.trace.samples.pose_world_tcp).all()
