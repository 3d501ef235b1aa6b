"""Every rule of the check: a plan that breaks it is found out, and the finding says where and what
to do."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from workbench import (
    BOTTLE,
    CRATE,
    KNOWN,
    MUG,
    bench,
    leaf,
    parallel,
    parameters,
    plan,
    sequence,
    weigh,
)

from palpate.planning.check.check import RULES, check
from palpate.planning.check.walk import MAX_FINDINGS
from palpate.planning.plan import Node, Plan
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

TALL = '<body name="tower" pos="0.50 0.00 0.08"><freejoint/><geom type="box" size=".06 .06 .08"/></body>'
ANVIL = (
    '<body name="anvil" pos="0.50 0.00 0.03"><freejoint/>'
    '<geom type="box" size=".05 .03 .03" mass="12" friction="0.5"/></body>'
)
FAR = (
    '<body name="far" pos="0.94 0.55 0.03"><freejoint/><geom type="box" size=".03 .03 .03"/></body>'
)
ABOVE, AT = "MovePose bottle_pose + z_offset", "MovePose bottle_pose"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return bench(BOTTLE, MUG, CRATE, KNOWN, height="?")


def rules(plan: Plan, scene: Scene | None, **options: bool) -> dict[str, str]:
    """Rule to the path of its first finding; every rule is documented and every message a
    sentence."""
    findings = check(plan, scene, **options)
    assert {f.rule for f in findings} <= RULES.keys()
    assert all(len(f.message) > 15 for f in findings)
    return {f.rule: f.path for f in reversed(findings)}


def changed(actions: list[str], at: int, *new: str | Node) -> list[str | Node]:
    return [*actions[:at], *new, *actions[at + 1 :]]


def test_the_papers_twelve_actions_are_valid(scene: Scene):
    assert check(plan(sequence(*weigh("bottle")), "bottle.mass"), scene) == ()


def test_the_buffer_may_be_named_as_the_paper_names_it(scene: Scene):
    converting = Node("Force2Mass", (("gripper_forces", "gripper_forces"),))
    named = plan(sequence(*changed(weigh("bottle"), 7, converting)), "bottle.mass")
    assert check(named, scene) == ()
    other = Node("Force2Mass", (("forces", "gripper_pose"),))
    foreign = plan(sequence(*changed(weigh("bottle"), 7, other)), "bottle.mass")
    assert rules(foreign, scene)["bad-argument"] == "tree.children[7]"


def test_the_papers_probing_of_a_table_is_valid(scene: Scene):
    probing = sequence(
        "MoveJoints home_config",
        "OpenGripper",
        "MovePose bench_approach",
        sequence("MoveUntilContact -z", "MeasureGripperPose", "Pose2Height"),
        "MovePose bench_approach",
        "MoveJoints home_config",
    )
    assert check(plan(probing, "bench.height"), scene) == ()


def friction(slide: str, *hanging: str) -> Node:
    return sequence(
        "MoveJoints home_config",
        "OpenGripper",
        ABOVE,
        AT,
        "CloseGripper",
        *hanging,
        parallel(f"MovePose {slide}", "MeasureForces"),
        AT,
        "OpenGripper",
        ABOVE,
        "MoveJoints home_config",
    )


HANGING = (ABOVE, "MeasureForces", AT)


def test_friction_needs_a_force_log_of_a_slide_and_one_in_the_air(scene: Scene):
    tree = friction("bottle_pose + 7*x_offset", *HANGING)
    assert check(plan(tree, "bottle.friction"), scene, remeasure=True) == ()
    assert rules(plan(tree, "bottle.mass"), scene)["undischarged"] == "parameters[0]"
    alone = friction("bottle_pose + 7*x_offset")
    assert rules(plan(alone, "bottle.friction"), scene, remeasure=True) == {
        "undischarged": "parameters[0]"
    }


def test_a_slide_is_long_enough_to_feel(scene: Scene):
    tree = friction("bottle_pose + x_offset", *HANGING)
    assert rules(plan(tree, "bottle.friction"), scene, remeasure=True) == {
        "short-slide": "tree.children[8]"
    }


def test_a_slide_stays_on_one_surface():
    """Of two that need not be equally slippery, it would measure neither."""
    half = (
        '<body name="{}" pos="0.5 {} 0.18"><geom type="box" size=".3 .2 .02" friction="{}"/></body>'
    )
    bottle = '<body name="bottle" pos="0.5 0 0.28"><freejoint/><geom type="cylinder" size=".03 .08"/></body>'
    text = "".join([half.format("oak", 0.2, 0.3), half.format("steel", -0.2, 0.6), bottle])
    around = parse_scene(f'<mujoco><worldbody><site name="robot_base"/>{text}</worldbody></mujoco>')
    (finding,) = check(
        plan(friction("bottle_pose + 5*y_offset", *HANGING), "bottle.friction"), around
    )
    assert finding.rule == "short-slide"
    assert "crosses parts of 'oak' and 'steel' that may differ in friction" in finding.message


@pytest.mark.parametrize("slide", ["bottle_pose + x_offset", "bottle_pose + 5.9*x_offset", "low"])
def test_the_finding_on_a_slide_proposes_a_valid_one(slide: str):
    low = "places: {low: {pos: [0.46, 0, 0.075], yaw: 0}}"
    around = bench(BOTTLE, poses=low)
    tree = friction(slide, *HANGING)
    (finding,) = [
        f for f in check(plan(tree, "bottle.friction"), around) if f.rule == "short-slide"
    ]
    proposed = re.findall(r"write MovePose '(.+?)'", finding.message)
    assert (
        check(plan(friction(proposed[0], *HANGING), "bottle.friction"), around, remeasure=True)
        == ()
    )


@pytest.mark.parametrize(
    ("rule", "path", "tree"),
    [
        (
            "unknown-primitive",
            "tree.children[3]",
            changed(weigh("bottle"), 3, "MovPose bottle_pose"),
        ),
        (
            "bad-argument",
            "tree.children[2]",
            changed(weigh("bottle"), 2, Node("MovePose", (("goal", "bottle_pose"),))),
        ),
        (
            "bad-argument",
            "tree",
            Node("Sequence", (("memory", True),), sequence(*weigh("bottle")).children),
        ),
        (
            "leaf-children",
            "tree.children[1]",
            changed(weigh("bottle"), 1, Node("OpenGripper", (), (leaf("X"),))),
        ),
        (
            "empty-composite",
            "tree.children[1]",
            changed(weigh("bottle"), 1, Node("Sequence"), "OpenGripper"),
        ),
        (
            "unknown-symbol",
            "tree.children[2]",
            changed(weigh("bottle"), 2, "MovePose flask_pose + z_offset", ABOVE),
        ),
        ("unknown-symbol", "tree.children[0]", changed(weigh("bottle"), 0, "MoveJoints nowhere")),
        (
            "unreachable",
            "tree.children[2]",
            changed(weigh("bottle"), 2, "MovePose bottle_pose + 40*z_offset", ABOVE),
        ),
        ("gripper-state", "tree.children[3]", changed(weigh("bottle"), 1)),
        ("gripper-state", "tree.children[8]", changed(weigh("bottle"), 8)),
        ("gripper-at-end", "tree", weigh("bottle")[:8]),
        ("not-restored", "tree", changed(weigh("bottle"), 8, "MovePose bottle_temporary")),
        ("buffer-unwritten", "tree.children[6]", changed(weigh("bottle"), 6)),
        ("precondition", "tree.children[6]", changed(weigh("bottle"), 5)),
        (
            "redundant",
            "tree.children[9]",
            changed(weigh("bottle"), 7, "Force2Mass", "MeasureForces", "Force2Mass"),
        ),
        ("redundant", "tree.children[2]", changed(weigh("bottle"), 2, "MeasureForces", ABOVE)),
    ],
)
def test_a_broken_rule_is_found_at_its_place(
    scene: Scene, rule: str, path: str, tree: list[str | Node] | Node
):
    root = tree if isinstance(tree, Node) else sequence(*tree)
    broken_rules = rules(plan(root, "bottle.mass"), scene)
    assert broken_rules.get(rule) == path, broken_rules


@pytest.mark.parametrize("then", ["MoveJoints home_config", AT])
def test_no_way_is_judged_from_angles_beyond_all_measure(scene: Scene, then: str):
    far = Node("MoveJoints", (("joints", (1e300,) * 7),))
    tree = sequence("MoveJoints home_config", "OpenGripper", ABOVE, AT, far, then)
    assert "unreachable" in rules(plan(tree), scene)


def test_two_motions_of_the_arm_in_parallel_are_found_at_any_depth(scene: Scene):
    branches = [sequence(*weigh(name)[2:11]) for name in ("bottle", "crate")]
    tree = sequence(
        "MoveJoints home_config", "OpenGripper", parallel(*branches), "MoveJoints home_config"
    )
    findings = check(plan(tree, "bottle.mass", "crate.mass"), scene)
    assert {(f.path, f.rule) for f in findings} == {("tree.children[2]", "one-owner")}
    assert "arm" in findings[0].message
    assert "gripper" in findings[1].message


def test_a_conversion_in_parallel_with_its_sensing_comes_too_early(scene: Scene):
    together = parallel("MeasureForces", "Force2Mass")
    tree = sequence(*changed(weigh("bottle")[:7] + weigh("bottle")[8:], 6, together))
    broken_rules = rules(plan(tree, "bottle.mass"), scene)
    assert broken_rules["buffer-unwritten"] == "tree.children[6].children[1]"


def test_a_parameter_that_nothing_converts_is_found_after_a_failed_action(scene: Scene):
    steps = ["MovePose bottle_pose + z_offset"]  # a closed hand, and nothing is measured
    broken_rules = rules(
        plan(sequence("MoveJoints home_config", "CloseGripper", *steps), "bottle.mass"), scene
    )
    assert (broken_rules["gripper-state"], broken_rules["undischarged"]) == (
        "tree.children[1]",
        "parameters[0]",
    )


def test_known_quantities_are_not_measured_unless_remeasured(scene: Scene):
    again = plan(sequence(*weigh("can")), "can.mass")
    assert rules(again, scene)["known"] == "parameters[0]"
    assert check(again, scene, remeasure=True) == ()
    stray = plan(sequence(*weigh("bottle")[:11], *weigh("can")[2:]), "bottle.mass")
    assert rules(stray, scene) == {"known": "tree.children[16]", "untouched": "tree.children[13]"}


def test_unrelated_objects_are_not_touched(scene: Scene):
    detour = [
        "MovePose mug_pose + z_offset",
        "MovePose mug_pose",
        "CloseGripper",
        "OpenGripper",
        "MovePose mug_pose + z_offset",
    ]
    broken_rules = rules(
        plan(sequence(*weigh("bottle")[:2], *detour, *weigh("bottle")[2:]), "bottle.mass"), scene
    )
    assert broken_rules == {"untouched": "tree.children[4]"}


def test_a_tree_without_parameters_touches_nothing(scene: Scene):
    moves = [a for a in weigh("mug") if a not in ("MeasureForces", "Force2Mass")]
    assert rules(plan(sequence(*moves)), scene) == {"untouched": "tree.children[4]"}
    there_and_back = ["MoveJoints home_config", "OpenGripper", "MovePose mug_pose + z_offset"]
    assert check(plan(sequence(*there_and_back, "MoveJoints home_config")), scene) == ()


def test_an_object_in_the_way_is_a_finding_and_may_be_moved():
    near = '<body name="wall" pos="0.50 0.052 0.08"><freejoint/><geom type="box" size=".1 .02 .08" mass=".3"/></body>'
    crowded = bench(BOTTLE, near, poses="grasps: {bottle: {pos: [0, 0, 0.045], yaw: 0}}")
    broken_rules = rules(plan(sequence(*weigh("bottle")), "bottle.mass"), crowded)
    # The open fingers are in the wall from then on, and would go on into it as they open again.
    assert broken_rules == {"blocked": "tree.children[3]", "collision": "tree.children[9]"}


@pytest.mark.parametrize(
    ("body", "name", "rule"),
    [(TALL, "tower", "too-wide"), (ANVIL, "anvil", "payload"), (FAR, "far", "unreachable")],
)
def test_an_object_that_the_hand_cannot_grasp_is_found(body: str, name: str, rule: str):
    assert rule in rules(plan(sequence(*weigh(name)), f"{name}.mass"), bench(body), remeasure=True)


@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        (["spoon.mass"], "unknown-parameter"),
        (["bottle.colour"], "unknown-parameter"),
        (["bottle.height"], "unmeasurable"),
        (["bottle.inertia"], "undischarged"),
        (["bottle.mass", "bottle.mass"], "duplicate-parameter"),
        (["bottle.mass", "crate.mass"], "undischarged"),
    ],
)
def test_parameters_are_gaps_that_the_tree_yields(scene: Scene, parameters: list[str], rule: str):
    assert rule in rules(plan(sequence(*weigh("bottle")), *parameters), scene)


def test_parameters_are_those_requested(scene: Scene):
    weighed = plan(sequence(*weigh("bottle")), "bottle.mass")
    assert check(weighed, scene, requested=parameters("bottle.mass")) == ()
    findings = check(weighed, scene, requested=parameters("bench.height"))
    assert [(f.path, f.rule) for f in findings] == [
        ("parameters", "requested"),
        ("parameters[0]", "requested"),
    ]


def test_a_plan_without_a_tree_explains_and_promises_nothing(scene: Scene):
    assert check(plan(None), scene) == ()
    assert rules(Plan((), None, " "), scene) == {"no-explanation": "explanation"}
    assert rules(plan(None, "bottle.mass"), scene) == {"undischarged": "parameters"}


def test_a_plan_without_a_scene_is_checked_for_grammar():
    assert check(plan(sequence(*weigh("anything")), "anything.mass"), None) == ()
    broken_rules = rules(
        plan(sequence("Force2Mass", "Jump", parallel("OpenGripper", "CloseGripper")), "x.mass"),
        None,
    )
    assert broken_rules == {
        "buffer-unwritten": "tree.children[0]",
        "unknown-primitive": "tree.children[1]",
        "one-owner": "tree.children[2]",
    }


def test_a_misspelt_primitive_is_recognised(scene: Scene):
    findings = check(plan(sequence("movepose bottle_pose")), scene)
    assert "'MovePose'?" in findings[0].message


def test_reachability_can_be_injected(scene: Scene):
    weighed = plan(sequence(*weigh("bottle")), "bottle.mass")
    findings = check(weighed, scene, reachable=lambda pose: pose.position[2] > 0.15)
    assert {(f.path, f.rule) for f in findings} == {
        ("tree.children[3]", "unreachable"),
        ("tree.children[8]", "unreachable"),
    }


types = st.sampled_from(
    [
        "Sequence",
        "Parallel",
        "MovePose",
        "MoveJoints",
        "OpenGripper",
        "CloseGripper",
        "Force2Mass",
        "MeasureForces",
        "MoveUntilContact",
        "MeasureGripperPose",
        "Pose2Height",
        "Pose2Plan",
        "Force2Velocity",
        "Nonsense",
        "",
    ]
)
expressions = st.sampled_from(
    [
        "bottle_pose",
        "bottle_pose + z_offset",
        "bench_approach",
        "home_config",
        "-z",
        "+x",
        "crate_pose",
        "bottle_pose - 2*x_offset",
        "",
        "nowhere",
    ]
)
values = expressions | st.text(max_size=8) | st.integers() | st.tuples(*[st.floats(-3, 3)] * 7)
arguments = st.dictionaries(
    st.sampled_from(["pose", "joints", "axis", "self", "cls"]) | st.text(max_size=5),
    values,
    max_size=2,
).map(lambda d: tuple(d.items()))
trees = st.recursive(
    st.builds(Node, types, arguments),
    lambda inner: st.builds(Node, types, arguments, st.lists(inner, max_size=6).map(tuple)),
    max_leaves=25,
)


@given(
    trees,
    st.lists(
        st.sampled_from(
            parameters("bottle.mass", "crate.com", "bench.height", "nothing.mass", "mug.?")
        ),
        max_size=3,
    ),
)
@settings(max_examples=300, deadline=None)
def test_any_tree_is_judged_without_an_exception(scene: Scene, tree: Node, promised: list[object]):
    findings = check(Plan(tuple(promised), tree, ""), scene)  # type: ignore[arg-type]
    assert len(findings) <= MAX_FINDINGS
    assert all(f.path and f.rule in RULES and f.message for f in findings)
    check(Plan((), tree, ""), None)


PROBE = ["MoveUntilContact -z", "MeasureGripperPose"]


def probing(*spots: str) -> list[str]:
    """A height from one touch a spot, converted after the last."""
    actions = ["MoveJoints home_config", "OpenGripper"]
    for spot in spots:
        actions += [f"MovePose {spot}", *PROBE, f"MovePose {spot}"]
    return [*actions[:-1], "Pose2Height", actions[-1], "MoveJoints home_config"]


def test_a_height_may_be_probed_at_several_places_but_not_again_and_again_at_one(scene: Scene):
    spots = [f"bench_approach {shift}".strip() for shift in ("", "+ x_offset", "+ y_offset")]
    assert check(plan(sequence(*probing(*spots)), "bench.height"), scene) == ()
    again = sequence(*probing(spots[0], spots[0], spots[0]))
    assert rules(plan(again, "bench.height"), scene) == {"redundant": "tree.children[8]"}
