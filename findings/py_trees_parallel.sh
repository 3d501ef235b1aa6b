#!/usr/bin/env bash
# A py_trees Parallel with SuccessOnOne fails if one of two children succeeds and the other fails.
#
# Packages: py_trees==2.6.0 behaviortreepy==0.1.4.
# Expected: SuccessOnOne succeeds as soon as one child does. Without any child there is no success to have.
# Happens: A failed child fails the Parallel under every policy, also a child that SuccessOnSelected did not select.
# With no child, SuccessOnOne succeeds, and so does an empty Sequence. BehaviorTree.CPP offers both: with
# success_count 1 and failure_count 2 the same tree succeeds, and an empty Parallel or Sequence is refused when the
# tree is read.
# Why it matters: Two ways of detecting contact in parallel are a usual redundancy; in py_trees one dead sensor
# fails it. A plan generated without steps reports success.
# Source: py_trees, composites.Parallel.tick: a failed child is looked for before the policy is asked.
# BehaviorTree.CPP, ParallelNode: failure_count.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet py_trees==2.6.0 behaviortreepy==0.1.4
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import behaviortreepy
from py_trees.behaviours import Failure, Success
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel, Sequence


def tick(node: Parallel | Sequence) -> Status:
    """Return the status of a node after one tick."""
    node.tick_once()
    return node.status


def read_and_tick(xml: str) -> str:
    """Return the status of a BehaviorTree.CPP tree after one tick, or why it is refused."""
    factory = behaviortreepy.BehaviorTreeFactory()
    factory.register_simple_action("Works", lambda _: behaviortreepy.NodeStatus.SUCCESS)
    factory.register_simple_action("Fails", lambda _: behaviortreepy.NodeStatus.FAILURE)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{xml}</BehaviorTree></root>'
    try:
        return factory.create_tree_from_text(text).tick_exactly_once().name
    except RuntimeError as error:
        return f"refused: {str(error).splitlines()[0]}"


print("py_trees", version("py_trees"), "behaviortreepy", version("behaviortreepy"))
works = Success("works")
statuses = {
    "SuccessOnOne, one fails, one succeeds": tick(
        Parallel("p", ParallelPolicy.SuccessOnOne(), [Failure("fails"), Success("works")])
    ),
    "SuccessOnSelected, another one fails": tick(
        Parallel(
            "p", ParallelPolicy.SuccessOnSelected([works], synchronise=False), [works, Failure("f")]
        )
    ),
    "SuccessOnOne, no child": tick(Parallel("p", ParallelPolicy.SuccessOnOne(), [])),
    "Sequence, no child": tick(Sequence("s", memory=True)),
}
for name, status in statuses.items():
    print(f"py_trees: {name}: {status.value}")
fail, success = Status.FAILURE, Status.SUCCESS
assert list(statuses.values()) == [fail, fail, success, success]

one = read_and_tick('<Parallel success_count="1" failure_count="2"><Fails/><Works/></Parallel>')
empty = [read_and_tick(xml) for xml in ("<Parallel/>", "<Sequence/>")]
print(f"BehaviorTree.CPP: Parallel 1 of 2: {one}; without child: {empty}")
assert one == "SUCCESS"
assert all(text.startswith("refused") for text in empty)
PYTHON
