from __future__ import annotations

from xml.etree import ElementTree

import behaviortreepy as bt
import pytest

from palpate.common.errors import InputError
from palpate.execution.btcpp import tree_nodes_model, tree_xml
from palpate.planning.plan import Node, Plan
from palpate.primitives.registry import vocabulary


def leaf(kind, **args):
    return Node(kind, tuple(args.items()))


PLAN = Plan(
    (),
    Node(
        "Sequence",
        (),
        (
            leaf("MoveJoints", joints="home_config"),
            leaf("MoveJoints", joints=[0.0, -0.5, 0, 1e-3, 0, 1.5, 0.25]),
            Node(
                "Parallel",
                (),
                (leaf("MovePose", pose="bottle_pose + z_offset"), leaf("MeasureForces")),
            ),
            leaf("MoveUntilContact", axis="-z"),
            Node("Force2Mass", (), (), name='the "bottle" <&> more'),
        ),
        name="weigh",
    ),
    "a test",
)


def document(plan=PLAN):
    return ElementTree.fromstring(tree_xml(plan, vocabulary()).encode())


def test_the_document_names_its_main_tree():
    root = document()
    assert root.attrib == {"BTCPP_format": "4", "main_tree_to_execute": "Plan"}
    (tree,) = root.findall("BehaviorTree")
    assert tree.get("ID") == "Plan"
    assert len(tree) == 1


def test_the_xml_has_structure_arguments_and_buffers():
    sequence = document().find("BehaviorTree/Sequence")
    assert sequence is not None
    assert sequence.get("name") == "weigh"
    home, angles, parallel, probe, mass = sequence
    assert (home.tag, home.attrib) == ("Action", {"ID": "MoveJoints", "joints": "home_config"})
    assert angles.get("joints") == "0.0;-0.5;0;0.001;0;1.5;0.25"
    assert parallel.attrib == {"success_count": "-1", "failure_count": "1"}
    assert [c.get("ID") for c in parallel] == ["MovePose", "MeasureForces"]
    assert parallel[0].get("pose") == "bottle_pose + z_offset"
    assert parallel[1].get("gripper_forces") == "{gripper_forces}"
    assert probe.attrib == {"ID": "MoveUntilContact", "axis": "-z"}
    assert mass.attrib == {
        "ID": "Force2Mass",
        "name": 'the "bottle" <&> more',
        "gripper_forces": "{gripper_forces}",
    }


def test_every_port_that_a_tree_uses_is_in_the_model():
    root = document()
    ports = {
        a.get("ID"): {p.get("name") for p in a if p.tag.endswith("_port")}
        for a in root.iter("Action")
        if a in list(root.find("TreeNodesModel"))
    }
    for action in root.find("BehaviorTree").iter("Action"):
        assert set(action.attrib) - {"ID", "name"} <= ports[action.get("ID")]


def test_the_model_has_every_primitive_with_types_and_descriptions():
    model = ElementTree.fromstring(tree_nodes_model(vocabulary()).encode()).find("TreeNodesModel")
    actions = {a.get("ID"): a for a in model}
    assert list(actions) == list(vocabulary().primitives)
    pose, speed = actions["MovePose"].findall("input_port")
    assert (pose.get("name"), pose.get("type")) == ("pose", "std::string")
    assert (speed.get("name"), speed.get("type")) == ("speed", "double")
    assert "pose expression" in pose.text
    (written,) = actions["MeasureForces"].findall("output_port")
    assert (written.get("name"), written.get("default")) == ("gripper_forces", "{gripper_forces}")
    (read,) = actions["Pose2Height"].findall("input_port")
    assert read.get("name") == "gripper_pose"
    for name, action in actions.items():
        assert (
            action.find("MetadataFields/Metadata").get("description")
            == vocabulary().primitive(name).summary()
        )


@pytest.mark.parametrize("name", ["\x00\x1b[31m", "a\nb", "\ufffe"])
def test_a_name_that_xml_cannot_carry_does_not_break_the_document(name):
    root = document(Plan((), Node("OpenGripper", (), (), name=name), ""))
    assert "\ufffd" in root.find("BehaviorTree/Action").get("name")


def test_a_plan_without_a_tree_is_one_clear_message():
    with pytest.raises(InputError, match="no tree to write: cannot be weighed"):
        tree_xml(Plan((), None, "cannot be weighed"), vocabulary())


def without_ports(xml):
    """behaviortreepy cannot declare ports, and BT.CPP refuses attributes that are not declared."""
    root = ElementTree.fromstring(xml.encode())
    for action in root.find("BehaviorTree").iter("Action"):
        for port in set(action.attrib) - {"ID", "name"}:
            del action.attrib[port]
    return ElementTree.tostring(root, encoding="unicode")


def run_in_btcpp(plan, fails=()):
    """The leaves that BT.CPP itself ticks, in order, and how the tree ends."""
    factory, ticked = bt.BehaviorTreeFactory(), []

    def leaf_of(kind):
        def tick(*_):
            ticked.append(kind)
            return bt.NodeStatus.FAILURE if kind in fails else bt.NodeStatus.SUCCESS

        return tick

    for kind in vocabulary().primitives:
        factory.register_simple_action(kind, leaf_of(kind))
    tree = factory.create_tree_from_text(without_ports(tree_xml(plan, vocabulary())))
    return tree.tick_while_running(), ticked


def test_btcpp_accepts_the_document_and_runs_it():
    status, ticked = run_in_btcpp(PLAN)
    assert status == bt.NodeStatus.SUCCESS
    assert ticked == [
        "MoveJoints",
        "MoveJoints",
        "MovePose",
        "MeasureForces",
        "MoveUntilContact",
        "Force2Mass",
    ]


def test_first_failure_of_a_parallel_fails_the_tree_in_btcpp_too():
    status, ticked = run_in_btcpp(PLAN, fails={"MovePose"})
    assert status == bt.NodeStatus.FAILURE
    assert "MoveUntilContact" not in ticked
