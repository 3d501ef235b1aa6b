from __future__ import annotations

import time

import pytest
from py_trees.common import Status

from palpate.errors import InputError
from palpate.planning.plan import Node
from palpate.tree.build import build, leaves

from .conftest import TICK, tick


def run(root, robot):
    return tick(root, robot, 200)


def test_a_sequence_remembers_where_it_is(node, words, cell, robot):
    root = build(node("Sequence", node("Go", z=0.29), node("Wait", seconds=0.1), node("Go", z=0.28)), words, cell)
    assert run(root, robot) is Status.SUCCESS
    assert [run.label for run in cell.recorder.leaves] == ["Go(0.29, 0.1)", "Wait(0.1)", "Go(0.28, 0.1)"]


def test_the_first_failure_stops_a_sequence(node, words, cell, robot):
    root = build(node("Sequence", node("Refuse"), node("Go", z=0.2)), words, cell)
    assert run(root, robot) is Status.FAILURE
    assert robot.calls == []


def test_a_parallel_succeeds_when_all_have(node, words, cell, robot):
    root = build(node("Parallel", node("Wait", seconds=0.1), node("Wait", seconds=0.3)), words, cell)
    assert run(root, robot) is Status.SUCCESS
    assert [run.label for run in cell.recorder.leaves] == ["Wait(0.1)", "Wait(0.3)"]
    assert robot.state.t == pytest.approx(0.3, abs=2 * TICK)


def test_the_first_failure_stops_all_of_a_parallel(node, words, cell, robot):
    root = build(node("Parallel", node("Go", z=0.1), node("Refuse")), words, cell)
    assert run(root, robot) is Status.FAILURE
    assert {run.primitive: run.status for run in cell.recorder.leaves} == {"Refuse": "FAILURE", "Go": "INVALID"}
    assert robot.calls[-1] == ("hold", None)


def test_two_motions_in_a_parallel_the_first_claims_the_second_fails(node, words, cell, robot):
    root = build(node("Parallel", node("Go", z=0.1), node("Go", z=0.2)), words, cell)
    assert run(root, robot) is Status.FAILURE
    second = next(run for run in cell.recorder.leaves if run.status == "FAILURE")
    assert second.node == "tree.children[1]"
    assert second.message == "the arm is in use by Go(0.1, 0.1): one motion at a time"
    assert [call for call, _ in robot.calls] == ["move_pose", "hold"]


@pytest.mark.parametrize("sensor_first", [True, False])
def test_a_sensing_leaf_beside_a_motion_records_until_the_motion_ends(node, words, cell, robot, sensor_first):
    children = [node("MeasureForces"), node("Go", z=0.28)]
    root = build(node("Parallel", *(children if sensor_first else children[::-1])), words, cell)
    assert run(root, robot) is Status.SUCCESS
    motion = next(run for run in cell.recorder.leaves if run.primitive == "Go")
    (recording,) = cell.recorder.recordings
    assert recording.context.activity == "moving"
    assert (recording.start, recording.end) == pytest.approx((motion.start, motion.end))
    assert recording.node == f"tree.children[{0 if sensor_first else 1}]"
    assert cell.state.buffers["gripper_forces"] == recording.context
    assert (cell.state.activity, cell.state.at) == ("still", "z = 0.28")


def test_a_sensing_leaf_beside_a_sequence_of_motions_records_them_all(node, words, cell, robot):
    motions = node("Sequence", node("Go", z=0.28), node("Go", z=0.25))
    root = build(node("Parallel", node("MeasureForces"), motions), words, cell)
    assert run(root, robot) is Status.SUCCESS
    assert cell.recorder.recordings[0].end == pytest.approx(cell.recorder.leaves[1].end)


def test_leaves_know_their_path_in_the_plan(node, words, cell):
    tree = node("Sequence", node("Go", z=0.1), node("Parallel", node("Wait", seconds=1), node("Go", z=0.2)))
    paths = {leaf.node for leaf in leaves(build(tree, words, cell))}
    assert paths == {path for path, n in tree.walk() if not n.children}


@pytest.mark.parametrize(("tree", "message"), [
    (Node("Fly"), "unknown primitive 'Fly'; valid: .*Go.*Parallel"),
    (Node("Sequence"), "tree: an empty Sequence does nothing"),
    (Node("Sequence", (), (Node("Parallel"),)), r"tree\.children\[0\]: an empty Parallel"),
    (Node("Go"), "tree: Go: z: Field required"),
    (Node("Go", (("z", 1.0), ("w", 2))), "tree: Go: w: Extra inputs"),
    (Node("Go", (("z", float("nan")),)), "tree: Go: z: .*finite"),
])
def test_what_cannot_be_built_is_one_clear_message(words, cell, tree, message):
    with pytest.raises(InputError, match=message):
        build(tree, words, cell)


def test_a_deep_tree_builds_and_ticks(node, words, cell, robot):
    tree = node("Wait", seconds=0.1)
    for _ in range(32):
        tree = node("Sequence", tree)
    assert run(build(tree, words, cell), robot) is Status.SUCCESS


def test_a_tick_on_25_nodes_is_quick(node, words, cell, robot):
    root = build(node("Sequence", *[node("Wait", seconds=0.0) for _ in range(12)], node("Wait", seconds=29.0),
                      *[node("Wait", seconds=0.0) for _ in range(11)]), words, cell)
    robot.advance(TICK)
    root.tick_once()
    best = float("inf")
    for _ in range(200):
        robot.advance(TICK)
        began = time.perf_counter()
        root.tick_once()
        best = min(best, time.perf_counter() - began)
    assert root.status is Status.RUNNING
    assert best < 150e-6
