"""The tree of a plan: structure, claims, recordings beside motions, and parts by leaf paths."""

from __future__ import annotations

import pytest
from py_trees.common import Status
from standin import TICK, tick

from palpate.common.errors import InputError
from palpate.execution.leaf import build, leaves
from palpate.planning.plan import Node, Plan, part_of


def run(root, robot):
    return tick(root, robot, 200)


def test_a_sequence_remembers_where_it_is(node, words, blackboard, robot):
    root = build(
        node("Sequence", node("Go", z=0.29), node("Wait", seconds=0.1), node("Go", z=0.28)),
        words,
        blackboard,
    )
    assert run(root, robot) is Status.SUCCESS
    assert [run.label for run in blackboard.recorder.leaves] == [
        "Go(0.29, 0.1)",
        "Wait(0.1)",
        "Go(0.28, 0.1)",
    ]


def test_the_first_failure_stops_a_sequence(node, words, blackboard, robot):
    root = build(node("Sequence", node("Refuse"), node("Go", z=0.2)), words, blackboard)
    assert run(root, robot) is Status.FAILURE
    assert robot.calls == []


def test_a_parallel_succeeds_when_all_have(node, words, blackboard, robot):
    root = build(
        node("Parallel", node("Wait", seconds=0.1), node("Wait", seconds=0.3)), words, blackboard
    )
    assert run(root, robot) is Status.SUCCESS
    assert [run.label for run in blackboard.recorder.leaves] == ["Wait(0.1)", "Wait(0.3)"]
    assert robot.state.t == pytest.approx(0.3, abs=2 * TICK)


def test_the_first_failure_stops_all_of_a_parallel(node, words, blackboard, robot):
    root = build(node("Parallel", node("Go", z=0.1), node("Refuse")), words, blackboard)
    assert run(root, robot) is Status.FAILURE
    assert {run.primitive: run.status for run in blackboard.recorder.leaves} == {
        "Refuse": "FAILURE",
        "Go": "INVALID",
    }
    assert robot.calls[-1] == ("hold", None)


def test_two_motions_in_a_parallel_the_first_claims_the_second_fails(
    node, words, blackboard, robot
):
    root = build(node("Parallel", node("Go", z=0.1), node("Go", z=0.2)), words, blackboard)
    assert run(root, robot) is Status.FAILURE
    second = next(run for run in blackboard.recorder.leaves if run.status == "FAILURE")
    assert second.node == "tree.children[1]"
    assert second.message == "the arm is in use by Go(0.1, 0.1): one motion at a time"
    assert [call for call, _ in robot.calls] == ["move_pose", "hold"]


@pytest.mark.parametrize("sensor_first", [True, False])
def test_a_sensing_leaf_in_parallel_with_a_motion_records_until_the_motion_ends(
    node, words, blackboard, robot, sensor_first
):
    children = [node("MeasureForces"), node("Go", z=0.28)]
    root = build(
        node("Parallel", *(children if sensor_first else children[::-1])), words, blackboard
    )
    assert run(root, robot) is Status.SUCCESS
    motion = next(run for run in blackboard.recorder.leaves if run.primitive == "Go")
    (recording,) = blackboard.recorder.recordings
    assert recording.context.activity == "moving"
    assert (recording.start, recording.end) == pytest.approx((motion.start, motion.end))
    assert recording.node == f"tree.children[{0 if sensor_first else 1}]"
    assert blackboard.state.buffers["gripper_forces"] == recording.context
    assert (blackboard.state.activity, blackboard.state.at) == ("still", "z = 0.28")


def test_a_sensing_leaf_in_parallel_with_a_sequence_of_motions_records_them_all(
    node, words, blackboard, robot
):
    motions = node("Sequence", node("Go", z=0.28), node("Go", z=0.25))
    root = build(node("Parallel", node("MeasureForces"), motions), words, blackboard)
    assert run(root, robot) is Status.SUCCESS
    assert blackboard.recorder.recordings[0].end == pytest.approx(blackboard.recorder.leaves[1].end)


def test_leaves_know_their_path_in_the_plan(node, words, blackboard):
    tree = node(
        "Sequence", node("Go", z=0.1), node("Parallel", node("Wait", seconds=1), node("Go", z=0.2))
    )
    paths = {leaf.node for leaf in leaves(build(tree, words, blackboard))}
    assert paths == {path for path, n in tree.walk() if not n.children}


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        (Node("Fly"), "unknown primitive 'Fly'; valid: .*Go.*Parallel"),
        (Node("Sequence"), "tree: an empty Sequence does nothing"),
        (Node("Sequence", (), (Node("Parallel"),)), r"tree\.children\[0\]: an empty Parallel"),
        (Node("Go"), "tree: Go: z: Field required"),
        (Node("Go", (("z", 1.0), ("w", 2))), "tree: Go: w: Extra inputs"),
        (Node("Go", (("z", float("nan")),)), "tree: Go: z: .*finite"),
    ],
)
def test_tree_that_cannot_be_built_is_one_clear_message(words, blackboard, tree, message):
    with pytest.raises(InputError, match=message):
        build(tree, words, blackboard)


def test_a_deep_tree_builds_and_ticks(node, words, blackboard, robot):
    tree = node("Wait", seconds=0.1)
    for _ in range(32):
        tree = node("Sequence", tree)
    assert run(build(tree, words, blackboard), robot) is Status.SUCCESS


def test_a_tick_on_25_nodes_asks_only_the_one_that_runs(node, words, blackboard, robot):
    root = build(
        node(
            "Sequence",
            *[node("Wait", seconds=0.0) for _ in range(12)],
            node("Wait", seconds=29.0),
            *[node("Wait", seconds=0.0) for _ in range(11)],
        ),
        words,
        blackboard,
    )
    robot.advance(TICK)
    root.tick_once()
    for _ in range(12):
        robot.advance(TICK)
        root.tick_once()
    robot.advance(TICK)
    asked = [asked.name for asked in root.tick()]
    assert root.status is Status.RUNNING
    assert asked == ["Wait(29.0)", "Sequence"]


def plan(*children: Node) -> Plan:
    return Plan((), Node("Sequence", children=children), "")


def leaf(name: str) -> Node:
    return Node(name)


def test_part_of_a_plan_keeps_the_order_and_parallel_branches() -> None:
    beside = Node("Parallel", children=(leaf("MovePose"), leaf("MeasureForces")))
    inner = Node("Sequence", children=(leaf("OpenGripper"), leaf("CloseGripper")))
    whole = plan(leaf("MoveJoints"), inner, beside, leaf("MovePose"))
    part = part_of(whole, {"tree.children[2].children[0]", "tree.children[1].children[0]"})
    assert part.tree is not None
    assert str(part.tree).split() == [
        *("Sequence", "Sequence", "OpenGripper"),
        *("Parallel", "MovePose", "MeasureForces"),
    ]
    assert part_of(whole, [path for path, _ in whole.tree.walk()]) == whole  # type: ignore[union-attr]


def test_plan_without_wanted_leaves_has_no_tree() -> None:
    assert part_of(plan(leaf("MovePose")), ()).tree is None
    assert part_of(Plan((), None, "why"), {"tree"}).tree is None
