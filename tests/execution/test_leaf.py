from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from py_trees.common import Status
from standin import TICK, tick

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.execution.leaf import PrimitiveLeaf
from palpate.primitives.state import SymbolicState, merge_states
from palpate.trace.recording import Context


def make(words, blackboard, kind, **args):
    return PrimitiveLeaf(words.make(kind, args), blackboard, "tree.children[0]")


def test_success_applies_the_effects_and_records_the_life(words, blackboard, robot):
    leaf = make(words, blackboard, "Go", z=0.28)
    assert tick(leaf, robot) is Status.RUNNING
    assert blackboard.state.activity == "moving"
    assert blackboard.motions == 1
    assert blackboard.owner == {"arm": leaf}
    assert tick(leaf, robot, 100) is Status.SUCCESS
    assert leaf.feedback_message == "at 0.28"
    assert (
        blackboard.state.at,
        blackboard.state.activity,
        blackboard.motions,
        blackboard.owner,
    ) == ("z = 0.28", "still", 0, {})
    (run,) = blackboard.recorder.leaves
    assert (run.node, run.primitive, run.label, run.status) == (
        "tree.children[0]",
        "Go",
        "Go(0.28, 0.1)",
        "SUCCESS",
    )
    assert run.start == pytest.approx(TICK)
    assert run.end == pytest.approx(run.start + 0.2, abs=2 * TICK)
    assert run.context == Context("still", at="z = 0.28")


def test_a_hand_that_leaves_what_it_presses_on_is_not_stopped_by_that(words, blackboard, robot):
    free = robot.limits.free_force
    robot.force = np.array([0.0, 0.0, -free - 1.0, 0.0, 0.0, 0.0])
    for activity, ends in (("still", Status.FAILURE), ("contact", Status.RUNNING)):
        blackboard.state, blackboard.failed = replace(blackboard.state, activity=activity), False
        leaf = make(words, blackboard, "Go", z=0.28)
        assert tick(leaf, robot) is ends, leaf.feedback_message
    robot.force = np.array([0.0, 0.0, free + 1.0, 0.0, 0.0, 0.0])
    assert tick(leaf, robot) is Status.FAILURE, "what it meets besides"
    assert "unexpected contact" in leaf.feedback_message


def test_a_precondition_fails_before_anything_moves(words, blackboard, robot):
    leaf = make(words, blackboard, "Never")
    assert tick(leaf, robot) is Status.FAILURE
    assert leaf.feedback_message == "the moon is not full"
    assert robot.calls == []
    assert blackboard.owner == {}


def test_the_first_motion_claims_the_arm_and_others_fail(words, blackboard, robot):
    first, second = make(words, blackboard, "Go", z=0.1), make(words, blackboard, "Go", z=0.5)
    tick(first, robot)
    assert tick(second, robot) is Status.FAILURE
    assert second.feedback_message == "the arm is in use by Go(0.1, 0.1): one motion at a time"
    assert [call for call, _ in robot.calls] == ["move_pose"]
    assert blackboard.owner == {"arm": first}
    assert blackboard.motions == 1


def test_the_arm_is_free_again_after_a_failure(words, blackboard, robot):
    tick(make(words, blackboard, "Crash"), robot, 3)
    assert tick(make(words, blackboard, "Go", z=0.28), robot) is Status.RUNNING


def test_an_exception_is_failure_and_the_arm_holds(words, blackboard, robot, caplog):
    caplog.set_level("DEBUG")
    leaf = make(words, blackboard, "Crash")
    assert tick(leaf, robot, 3) is Status.FAILURE
    assert leaf.feedback_message == "ZeroDivisionError: boom"
    assert [call for call, _ in robot.calls] == ["move_axis", "hold"]
    assert "Traceback" in caplog.text
    assert blackboard.recorder.leaves[-1].status == "FAILURE"


def test_an_interrupt_passes_through_but_the_arm_holds_and_the_life_is_recorded(
    words, blackboard, robot
):
    leaf = make(words, blackboard, "Crash", error="KeyboardInterrupt")
    tick(leaf, robot)
    with pytest.raises(KeyboardInterrupt):
        tick(leaf, robot)
    assert robot.calls[-1] == ("hold", None)
    assert [run.status for run in blackboard.recorder.leaves] == ["INVALID"]


def test_timeout_is_on_robot_time(words, blackboard, robot):
    leaf = make(words, blackboard, "Go", z=-0.3, speed=0.01)
    assert tick(leaf, robot, 1000) is Status.FAILURE
    assert leaf.feedback_message == "not done after 5 s of robot time"
    assert (
        5.0
        < blackboard.recorder.leaves[-1].end - blackboard.recorder.leaves[-1].start
        < 5.0 + 2 * TICK
    )
    assert robot.calls[-1] == ("hold", None)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"force": (30.0, 0, 0, 0, 0, 0)}, "unexpected contact: 30.0 N"),
        ({"force": (0.0, 0, 50, 0, 0, 0)}, "exceeds the limit of 40 N"),
    ],
)
def test_the_safety_predicate_is_checked_every_tick(words, blackboard, robot, change, reason):
    leaf = make(words, blackboard, "Go", z=0.1)
    assert tick(leaf, robot, 10) is Status.RUNNING
    robot.force = robot.force + change["force"]
    assert tick(leaf, robot) is Status.FAILURE
    assert reason in leaf.feedback_message
    assert robot.calls[-1] == ("hold", None)


def test_a_slip_fails_the_motion(words, blackboard, robot):
    tick(make(words, blackboard, "Grasp"), robot, 20)
    leaf = make(words, blackboard, "Go", z=0.4)
    assert tick(leaf, robot, 10) is Status.RUNNING
    robot.put(gripping=False)
    assert tick(leaf, robot) is Status.FAILURE
    assert "slip" in leaf.feedback_message


def test_leaf_stopped_from_outside_closes_its_generator_and_holds(words, blackboard, robot):
    leaf = make(words, blackboard, "Go", z=0.1)
    tick(leaf, robot, 3)
    leaf.stop(Status.INVALID)
    leaf.stop(Status.INVALID)
    assert robot.calls[-1] == ("hold", None)
    assert blackboard.owner == {}
    assert blackboard.motions == 0
    assert [(run.status, run.message) for run in blackboard.recorder.leaves] == [
        ("INVALID", "interrupted")
    ]


def test_recordings_are_signed_with_the_node_that_made_them(words, blackboard, robot):
    leaf = PrimitiveLeaf(words.make("MeasureGripperPose", {}), blackboard, "tree.children[7]")
    assert tick(leaf, robot, 100) is Status.SUCCESS
    assert [r.node for r in blackboard.recorder.recordings] == ["tree.children[7]"]
    assert blackboard.state.logged == (("gripper_pose", Context("still")),)


names = st.sampled_from(["bottle", "cup", "box"])
contexts = st.builds(Context, st.sampled_from(["still", "moving"]), st.none() | names)
states = st.builds(
    lambda at, holding, buffers, logged, converted: SymbolicState(
        None,
        at=at,
        holding=holding,
        buffers=buffers,
        logged=tuple(logged),  # type: ignore[arg-type]
        converted=frozenset(Parameter(o, "mass") for o in converted),
    ),
    st.none() | names,
    st.none() | names,
    st.dictionaries(names, contexts),
    st.lists(st.tuples(names, contexts)),
    st.sets(names),
)


@given(states, states)
def test_merging_one_change_gives_that_change(base, other):
    after = replace(
        other,
        logged=(*base.logged, *other.logged),
        converted=base.converted | other.converted,
        buffers={**base.buffers, **other.buffers},
    )
    result = merge_states(base, base, after)
    assert (result.at, result.holding, result.logged) == (after.at, after.holding, after.logged)
    assert result.converted == after.converted
    assert result.buffers == after.buffers


@given(states, contexts, contexts)
def test_two_sensing_leaves_at_once_both_leave_their_mark(base, one, two):
    first = replace(base, buffers={**base.buffers, "a": one}, logged=(*base.logged, ("a", one)))
    second = replace(base, buffers={**base.buffers, "b": two}, logged=(*base.logged, ("b", two)))
    both = merge_states(first, base, second)
    assert both.buffers == {**base.buffers, "a": one, "b": two}
    assert both.logged == (*base.logged, ("a", one), ("b", two))


def test_changes_of_another_leaf_meanwhile_stay():
    base = SymbolicState(None, gripper="closed")  # type: ignore[arg-type]
    now = replace(base, gripper="open")
    after = replace(base, at="home", pose_world_tcp=Pose.of((0, 0, 0)))
    assert (merge_states(now, base, after).gripper, merge_states(now, base, after).at) == (
        "open",
        "home",
    )


def test_a_reflex_fails_the_motion_in_which_it_comes_and_no_later_one(words, blackboard, robot):
    leaf = make(words, blackboard, "Go", z=0.1)
    tick(leaf, robot, 3)
    robot.put(reflex="the arm stopped itself")
    assert tick(leaf, robot) is Status.FAILURE
    assert leaf.feedback_message == "the arm stopped itself"
    blackboard.failed = False
    assert tick(make(words, blackboard, "Go", z=0.28), robot, 3) is Status.RUNNING


def test_nothing_begins_to_move_after_a_failure(words, blackboard, robot):
    assert tick(make(words, blackboard, "Refuse"), robot, 3) is Status.FAILURE
    assert tick(make(words, blackboard, "Go", z=0.28), robot, 3) is Status.RUNNING
    assert robot.calls == []


@pytest.mark.parametrize(
    ("way", "lingers"),
    [((0, 0, 0.1), True), ((0.1, 0, 0), True), ((0.1, 0, -0.05), True), ((0.05, 0, -0.1), False)],
)
def test_a_contact_force_lingers_unless_the_hand_presses_on(blackboard, way, lingers) -> None:
    blackboard.pressed = (0.0, 0.0, -9.0)
    blackboard.clear_pressed_force(np.array(way))
    assert (blackboard.pressed == (0.0, 0.0, -9.0)) == lingers
