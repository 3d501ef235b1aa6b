from __future__ import annotations

from contextlib import suppress
from xml.etree import ElementTree

import behaviortreepy as bt
import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.planning.btcpp import tree_nodes_model, tree_xml
from palpate.planning.check.check import check
from palpate.planning.plan import Node, Plan, UnmeasuredParameters, dump_plan
from palpate.planning.registry import load_proposal, read_proposal
from palpate.primitives.registry import vocabulary
from palpate.studies.scenarios.catalogue import scenarios


def leaf(kind, **args):
    return Node(kind, tuple(args.items()))


PLAN = Plan(
    (),
    Node(
        "Sequence",
        (),
        (
            leaf("MoveJoints", joints="home_config"),
            leaf("MoveJoints", joints=(0.0, -0.5, 0, 1e-3, 0, 1.5, 0.25)),
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


# Reading.


def read(xml):
    return read_proposal(xml.encode()).plan


RECORDED = [
    path
    for one in scenarios().values()
    for path in sorted(one.folder.glob("plans/*"))
    if load_proposal(path).plan.tree is not None
]


@pytest.mark.parametrize("path", RECORDED, ids=lambda path: f"{path.parts[-3]}/{path.name}")
def test_a_recorded_plan_survives_the_xml(path):
    plan = load_proposal(path).plan
    assert dump_plan(read(tree_xml(plan, vocabulary()))) == dump_plan(plan)


def test_every_field_of_a_plan_survives_the_xml():
    mass, com = Parameter('a "b" <c>; é', "mass"), Parameter("cup", "com")
    plan = Plan(
        (mass, com),
        PLAN.tree,
        "first line\nsecond \x1b\ufffe",
        planner="symbolic",
        notes=("{a}", "b"),
        again=(com,),
        unmeasured=(UnmeasuredParameters("no thermometer", (mass,)),),
    )
    assert read(tree_xml(plan, vocabulary())) == plan
    assert read(tree_xml(PLAN, vocabulary())).tree == PLAN.tree


LEAVES = """
  <MoveJoints joints="home_config"/>
  <MoveJoints joints="0;-0.5;0;-1.5;0;1.5;0.25"/>
  <MovePose pose="cup_pose + z_offset" speed="0.1"/>
  <MeasureForces gripper_forces="{gripper_forces}"/>"""
EXPLICIT = (
    LEAVES.replace("<", '<Action ID="')
    .replace(" joints", '" joints')
    .replace(" pose", '" pose')
    .replace(" gripper_forces=", '" gripper_forces=')
)
TREE = Node(
    "Sequence",
    (),
    (
        leaf("MoveJoints", joints="home_config"),
        leaf("MoveJoints", joints=(0.0, -0.5, 0.0, -1.5, 0.0, 1.5, 0.25)),
        leaf("MovePose", pose="cup_pose + z_offset", speed=0.1),
        leaf("MeasureForces"),
    ),
)


def by_hand(inside, root='root BTCPP_format="4"', name="Sequence"):
    tag = root.split()[0]
    return (
        f"<{root}><BehaviorTree ID='T'><{name}>{inside}</{name.split()[0]}></BehaviorTree></{tag}>"
    )


@pytest.mark.parametrize(
    "xml",
    [
        by_hand(LEAVES),
        by_hand(EXPLICIT),
        by_hand(EXPLICIT, name='Control ID="Sequence"'),
        by_hand(LEAVES, root="root"),  # BT.CPP 3
        f"<BehaviorTree><Sequence>{LEAVES}</Sequence></BehaviorTree>",
        "\ufeff \n<!-- mine --> " + by_hand(LEAVES),
        '<?xml version="1.0" encoding="UTF-8"?>' + by_hand(f"<!-- first -->{LEAVES}<?edit on?>"),
        by_hand(LEAVES.replace("<MeasureForces", '<MeasureForces _uid="4" _description="feel"')),
        by_hand(LEAVES, 'root main_tree_to_execute="T"').replace(
            "</root>", '<BehaviorTree ID="U"><OpenGripper/></BehaviorTree></root>'
        ),
    ],
)
def test_a_tree_written_by_hand_is_read(xml):
    proposal = read_proposal(xml.encode())
    assert (proposal.plan.tree, proposal.plan.parameters, proposal.bare) == (TREE, (), True)


def test_a_parallel_with_its_counts_and_labels_is_read():
    xml = by_hand(
        '<MovePose name="{up}" pose="cup_pose"/><MeasureForces/>',
        name='Parallel name="up" failure_count="1" success_count="-1"',
    )
    assert read(xml).tree == Node(
        "Parallel",
        (),
        (Node("MovePose", (("pose", "cup_pose"),), name="{up}"), leaf("MeasureForces")),
        "up",
    )


def with_metadata(inside, fields):
    model = (
        f"<SubTree ID='T'><MetadataFields><Metadata plan='{fields}'/></MetadataFields></SubTree>"
    )
    xml = by_hand(inside)
    return xml.replace("</root>", f"<TreeNodesModel>{model}</TreeNodesModel></root>")


def test_parameters_may_be_written_by_hand():
    fields = (
        '{"parameters": ["cup.mass"], "tree": null, "Nodes": [{"id": 1, "type": "OpenGripper"}]}'
    )
    proposal = read_proposal(with_metadata(LEAVES, fields).encode())
    assert proposal.plan == Plan((Parameter("cup", "mass"),), TREE, "")
    assert not proposal.bare


OPENING = "<!DOCTYPE root [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]>"


@pytest.mark.parametrize(
    ("xml", "names"),
    [
        ("<mujoco><worldbody/></mujoco>", ["root <mujoco>", "none", "give one <BehaviorTree>"]),
        ("<root BTCPP_format='4'/>", ["behavior trees: none"]),
        ("<root><BehaviorTree ID='T'/></root>", ["behavior trees: T", "one root node"]),
        (by_hand("<a/>").replace("<Seq", "<b/><Seq"), ["behavior trees: T", "one root node"]),
        (by_hand(LEAVES, 'root main_tree_to_execute="U"'), ["behavior trees: T", "main_tree"]),
        ("<root><BehaviorTree ID='T'/><BehaviorTree ID='T'/></root>", ["trees: T, T"]),
        (by_hand("<SubTree ID='U'/>"), ["<SubTree> (line 1)", "put the nodes of that tree here"]),
        (by_hand(LEAVES.replace("0.1", "{v}")), ["line 4", "speed", "{v}", "give its value"]),
        (by_hand(LEAVES.replace("{gr", "{f")), ["{fipper_forces}", 'gripper_forces="{gripper_']),
        (by_hand("", name='Parallel success_count="1"'), ['write success_count="-1"']),
        (by_hand("<OpenGripper _skipIf='a'/>"), ["_skipIf", "remove it"]),
        (by_hand("<OpenGripper type='a'/>"), ["type", "remove it"]),
        (by_hand("<OpenGripper>"), ["malformed XML", "line 1"]),
        (OPENING + by_hand("<OpenGripper name='&b;'/>"), ["DOCTYPE", "remove it"]),
        (by_hand("<Sequence>" * 150 + "</Sequence>" * 150), ["nested deeper", "flatten"]),
        (by_hand("<Sequence>" * 5000 + "</Sequence>" * 5000), ["nested deeper than 200"]),
        (by_hand("<OpenGripper/>" * 6000), ["5000 nodes"]),
        (by_hand(LEAVES.replace("0.1", "nan")), ["NaN", "finite"]),
        (with_metadata(LEAVES, "{"), ["<Metadata>", "'plan' is not a JSON object"]),
        (with_metadata(LEAVES, "[1]"), ["<Metadata>", "'plan' is not a JSON object"]),
        (with_metadata(LEAVES, '{"parameters": "mass"}'), ["parameters must be a list"]),
    ],
)
def test_what_a_plan_cannot_express_is_refused_in_one_message(xml, names):
    with pytest.raises(InputError) as refusal:
        read(xml)
    for name in names:
        assert name in str(refusal.value)
    assert len(str(refusal.value)) < 400


def test_unknown_nodes_and_arguments_are_findings_of_the_check():
    plan = read(
        by_hand("<Fallback/><MovePose pose='cup_pose' speed='fast' way='1'/><open_gripper/>")
    )
    assert [(f.path, f.rule) for f in check(plan, None)] == [
        ("tree.children[0]", "unknown-primitive"),
        ("tree.children[1]", "bad-argument"),
        ("tree.children[1]", "bad-argument"),
    ]


def test_a_damaged_document_is_a_plan_or_an_input_error():
    xml = tree_xml(PLAN, vocabulary())
    tree = xml[: xml.index("<TreeNodesModel>")] + "</root>"
    for start in range(0, len(tree), 7):
        for end in (start + 3, start + 60):
            with suppress(InputError):
                read(tree[:start] + tree[end:])
