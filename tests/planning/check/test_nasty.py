"""Plans that would do harm, one way each, and the rule that must catch each; beside them plans that
differ by little and do none."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from workbench import BOTTLE, CRATE, KNOWN, MUG, bench, parallel, plan, sequence, weigh

from palpate.planning.check.check import RULES, check
from palpate.planning.plan import Node, Plan
from palpate.scene.scene import Scene

HOME, OPEN, CLOSE = "MoveJoints home_config", "OpenGripper", "CloseGripper"
ABOVE, AT = "MovePose bottle_pose + z_offset", "MovePose bottle_pose"
BEGIN, END = (HOME, OPEN), (OPEN, ABOVE, HOME)
TAKEN = (*BEGIN, ABOVE, AT, CLOSE)
"""The bottle stands between the closed fingers."""
HELD = (*TAKEN, ABOVE)
"""It hangs."""

PLACES = """places:
  inside: {pos: [0.50, 0.50, 0.125], yaw: 0}
  edge: {pos: [0.50, 0.597, 0.125], yaw: 0}
  beyond: {pos: [0.50, 0.66, 0.125], yaw: 0}
  above_inside: {pos: [0.50, 0.50, 0.265], yaw: 0}
  above_edge: {pos: [0.50, 0.597, 0.265], yaw: 0}
  above_beyond: {pos: [0.50, 0.66, 0.265], yaw: 0}
  on_crate: {pos: [0.45, -0.25, 0.185], yaw: 0}
  off_crate: {pos: [0.45, -0.215, 0.185], yaw: 0}
  above_crate: {pos: [0.45, -0.25, 0.33], yaw: 0}
  above_off_crate: {pos: [0.45, -0.215, 0.33], yaw: 0}
  turned_crate: {pos: [0.45, -0.25, 0.03], yaw: 1.5708}
  above_turned_crate: {pos: [0.45, -0.25, 0.21], yaw: 1.5708}
  leaning: {pos: [0.50, 0.20, 0.30], euler: [2.6, 0, 0]}
  upright: {pos: [0.50, 0.20, 0.30], yaw: 0}
  low: {pos: [0.30, 0.10, 0.03], yaw: 0}
  top_of_bottle: {pos: [0.50, 0.00, 0.173], yaw: 0}
  near_wall: {pos: [0.40, 0.30, 0.10], yaw: 0}
  over_wall: {pos: [0.40, 0.30, 0.30], yaw: 0}
  above_rim: {pos: [0.468, -0.25, 0.21], yaw: 1.5708}
"""
WALL = '<geom name="wall" type="box" pos="0.40 0.357 0.1" size=".1 .005 .1"/>'
TALL_WALL = '<geom name="wall" type="box" pos="0.28 0 0.25" size=".01 .2 .25"/>'
SCREEN = '<geom name="screen" type="box" pos="0.14 0.275 0.35" size=".02 .02 .35"/>'
POST = '<geom name="post" type="box" pos="0.4 0.05 0.1" size=".01 .01 .1"/>'
STACK = (
    '<body name="under" pos="0.50 0.20 0.04"><freejoint/><geom type="box" size=".10 .03 .04"/></body>'
    '<body name="over" pos="0.43 0.20 0.10"><freejoint/><geom type="box" size=".02 .02 .02"/></body>'
)
BAR = '<body name="bar" pos="0.50 0.00 0.02"><freejoint/><geom type="box" size=".18 .015 .02" mass="2.4"/></body>'
THIN = '<body name="thin" pos="0.50 0.20 0.06"><freejoint/><geom type="box" size=".08 .012 .06"/></body>'
HAMMER = (
    '<body name="hammer" pos="0.5 0 0.018"><freejoint/><inertial pos="? ? ?" mass="?" diaginertia="? ? ?"/>'
    '<geom type="box" size=".13 .012 .012"/><geom type="box" pos=".145 0 0" size=".015 .045 .018"/></body>'
)
ALL = (BOTTLE, MUG, CRATE, KNOWN)
THROUGH_TABLE = (0.0, 1.0, 0.0, -1.6, 0.0, 2.6, 0.785)
FOLDED = (0.0, -1.7, 0.0, -3.0, 0.0, 0.5, 0.785)
ASIDE = (0.6, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)


def angles(*joints: float) -> Node:
    return Node("MoveJoints", (("joints", joints),))


@dataclass(frozen=True)
class Case:
    """A plan in a scene, and the rule that catches it; none where it does no harm."""

    name: str
    rule: str | None
    steps: tuple[str | Node, ...]
    bodies: tuple[str, ...] = ALL
    height: str = "-0.03"
    poses: str = PLACES

    def scene(self) -> Scene:
        return bench(*self.bodies, height=self.height, poses=self.poses)

    def findings(self) -> dict[str, str]:
        """Rule to message of the plan's findings, those of economy left out."""
        scene = self.scene()
        plan = Plan((), sequence(*self.steps), " ".join(scene.objects))
        findings = check(plan, scene, remeasure=True)
        assert {finding.rule for finding in findings} <= RULES.keys()
        return {f.rule: f.message for f in findings if f.rule not in ("untouched", "redundant")}


def carried(*poses: str) -> tuple[str, ...]:
    """The bottle taken along poses, let go of at the last but one, and left at the last."""
    *way, last = (f"MovePose {pose}" for pose in poses)
    return (*HELD, *way, OPEN, last, HOME)


def at(name: str, *shift: str) -> tuple[str, ...]:
    """The open hand above an object and down at it, a little beside."""
    shifted = " ".join([f"{name}_pose", *shift])
    return (*BEGIN, f"MovePose {shifted} + z_offset", f"MovePose {shifted}")


def up(name: str, *shift: str) -> tuple[str, ...]:
    return (" ".join(["MovePose", f"{name}_pose", *shift, "+ z_offset"]), HOME)


CASES = [
    # Into fixed things.
    Case(
        "just above the table",
        None,
        (*BEGIN, "MovePose bench_approach", "MovePose bench_approach - 0.7*z_offset", HOME),
    ),
    Case(
        "into the table",
        "collision",
        (*BEGIN, "MovePose bench_approach", "MovePose bench_approach - 2*z_offset", HOME),
    ),
    Case(
        "fingertips into the table",
        "collision",
        (*BEGIN, "MovePose bench_approach", "MovePose bench_approach - 0.8*z_offset", HOME),
    ),
    Case(
        "into a table of unknown height",
        "collision",
        (*BEGIN, "MovePose bench_approach", "MovePose bench_approach - 1.2*z_offset", HOME),
        height="?",
    ),
    Case("seven angles aside", None, (*BEGIN, angles(*ASIDE), HOME)),
    Case("seven angles through the table", "collision", (*BEGIN, angles(*THROUGH_TABLE), HOME)),
    Case(
        "joints through a post",
        "collision",
        (*BEGIN, angles(*ASIDE), angles(1.6, *ASIDE[1:]), HOME),
        (BOTTLE, SCREEN),
    ),
    Case(
        "joints where no post is",
        None,
        (*BEGIN, angles(*ASIDE), angles(1.6, *ASIDE[1:]), HOME),
        (BOTTLE,),
    ),
    Case(
        "a forearm through a wall",
        "collision",
        (*BEGIN, ABOVE, AT, ABOVE, HOME),
        (BOTTLE, TALL_WALL),
    ),
    Case(
        "a load into a post",
        "collision",
        (*HELD, "MovePose low + z_offset", ABOVE, AT, *END),
        (BOTTLE, POST),
    ),
    Case(
        "a load pressed into the table",
        "collision",
        (*TAKEN, "MovePose bottle_pose - 0.1*z_offset", AT, *END),
    ),
    Case(
        "fingers opening into a wall",
        "collision",
        (HOME, CLOSE, "MovePose over_wall", "MovePose near_wall", OPEN, "MovePose over_wall", HOME),
        (BOTTLE, WALL),
    ),
    # Into itself.
    Case("the hand on its own base", "self-collision", (*BEGIN, angles(*FOLDED), HOME)),
    # From nowhere.
    Case("a pose first", "unknown-start", (ABOVE, OPEN, HOME)),
    Case("angles first", "unknown-start", (angles(*ASIDE), OPEN, HOME)),
    Case("fingers first", "unknown-start", (OPEN, HOME)),
    Case("a probe first", "precondition", ("MoveUntilContact -z", HOME)),
    Case("home first", None, (HOME, OPEN)),
    # Objects entered.
    Case("entered from above", None, (*BEGIN, ABOVE, AT, ABOVE, HOME)),
    Case(
        "a finger on its top, 47 mm off",
        "collision",
        (*at("bottle", "+ 3.13*y_offset"), *up("bottle", "+ 3.13*y_offset")),
    ),
    Case(
        "a finger on its top, the other way",
        "collision",
        (*at("bottle", "- 3.13*y_offset"), *up("bottle", "- 3.13*y_offset")),
    ),
    Case(
        "a finger grazing its side",
        "collision",
        (*at("bottle", "+ 0.62*y_offset"), *up("bottle", "+ 0.62*y_offset")),
    ),
    Case("4 mm off", None, (*at("bottle", "+ 0.25*y_offset"), *up("bottle", "+ 0.25*y_offset"))),
    Case(
        "a wide side between the fingers",
        "collision",
        (
            *BEGIN,
            "MovePose above_turned_crate",
            "MovePose turned_crate",
            "MovePose above_turned_crate",
            HOME,
        ),
    ),
    Case(
        "entered from the side",
        None,
        (
            *BEGIN,
            "MovePose bottle_pose + z_offset + 30*x_offset",
            "MovePose bottle_pose + 30*x_offset",
            AT,
            ABOVE,
            HOME,
        ),
    ),
    Case(
        "entered at a slant",
        None,
        (*BEGIN, "MovePose bottle_pose + z_offset + 10*x_offset", AT, ABOVE, HOME),
    ),
    Case(
        "left at a slant that rises more than it goes aside",
        "collision",
        (*BEGIN, ABOVE, AT, "MovePose bottle_pose + z_offset + 4*y_offset", HOME),
    ),
    Case(
        "left at a slant along its length, as the paper's hammer is",
        None,
        (*BEGIN, ABOVE, AT, "MovePose bottle_pose + z_offset + 10*x_offset", HOME),
    ),
    Case("left by a joint motion", None, (*BEGIN, ABOVE, AT, HOME)),
    Case(
        "from angles straight to the grasp", "collision", (*BEGIN, angles(*ASIDE), AT, ABOVE, HOME)
    ),
    Case(
        "from a probe straight to the grasp",
        "collision",
        (*BEGIN, "MovePose bench_approach", "MoveUntilContact -z", AT, ABOVE, HOME),
    ),
    Case("closed fingers on its top", "collision", (*BEGIN[:1], ABOVE, AT, ABOVE, HOME)),
    Case(
        "through a neighbour",
        "blocked",
        (
            *BEGIN,
            ABOVE,
            AT,
            ABOVE,
            "MovePose bottle_pose + z_offset + 30*y_offset",
            "MovePose can_pose + 0.1*z_offset + 12*y_offset",
            "MovePose can_pose - 0.2*z_offset - 12*y_offset",
            HOME,
        ),
    ),
    # Grasps.
    Case(
        "an edge of 2 mm",
        "gripper-state",
        (*BEGIN, "MovePose bottle_pose + z_offset", "MovePose top_of_bottle", CLOSE, ABOVE, HOME),
    ),
    Case(
        "15 mm from where it stands",
        "gripper-state",
        (*at("thin", "+ 2.5*y_offset"), CLOSE, OPEN, *up("thin", "+ 2.5*y_offset")),
        (THIN,),
    ),
    Case(
        "5 mm from where it stands",
        None,
        (*at("thin", "+ 0.8*y_offset"), CLOSE, OPEN, *up("thin", "+ 0.8*y_offset")),
        (THIN,),
    ),
    Case(
        "after a probe of its top",
        "gripper-state",
        (*BEGIN, ABOVE, "MoveUntilContact -z", CLOSE, ABOVE, HOME),
    ),
    Case(
        "a heavy bar at its end",
        "twist",
        (*at("bar", "+ 1.5*x_offset"), CLOSE, OPEN, *up("bar", "+ 1.5*x_offset")),
        (BAR,),
    ),
    Case("a heavy bar in its middle", None, (*at("bar"), CLOSE, OPEN, *up("bar")), (BAR,)),
    Case(
        "the lower one of a stack",
        "blocked",
        (*at("under"), CLOSE, *up("under")[:1], "MovePose under_pose", OPEN, *up("under")),
        (STACK,),
    ),
    # Letting go.
    Case("well inside the table", None, carried("above_inside", "inside", "above_inside")),
    Case("over the edge", "unsupported", carried("above_edge", "edge", "above_edge")),
    Case("beyond the edge", "gripper-state", carried("above_beyond", "beyond", "above_beyond")),
    Case("in mid-air", "gripper-state", (*HELD, OPEN, HOME)),
    Case(
        "slid over the edge", "unsupported", carried("above_inside", "inside", "edge", "above_edge")
    ),
    Case(
        "dragged over the edge and back",
        "unsupported",
        carried("above_inside", "inside", "edge", "inside", "above_inside"),
    ),
    Case(
        "off the middle of a crate",
        "unsupported",
        carried("above_off_crate", "off_crate", "above_off_crate"),
    ),
    Case("beside a moving arm", "gripper-state", (*TAKEN, parallel(ABOVE, OPEN), HOME)),
    Case(
        "taken by a moving arm",
        "gripper-state",
        (*BEGIN, ABOVE, parallel(AT, CLOSE), ABOVE, AT, *END),
    ),
    # Held.
    Case("carried upright", None, (*HELD, "MovePose upright", ABOVE, AT, *END)),
    Case("laid over", "tilted", (*HELD, "MovePose leaning", ABOVE, AT, *END)),
    Case(
        "carried through a neighbour",
        "blocked",
        (*HELD, "MovePose mug_pose + 0.1*z_offset", ABOVE, AT, *END),
    ),
    Case(
        "turned over by the joints",
        "tilted",
        (*HELD, angles(0.0, -0.785, 0.0, -2.356, 0.0, 2.6, 0.785), ABOVE, AT, *END),
    ),
    # Probes.
    Case(
        "a probe of the table",
        None,
        (*BEGIN, "MovePose bench_approach", "MoveUntilContact -z", "MovePose bench_approach", HOME),
    ),
    Case(
        "a probe that pushes a bottle",
        "precondition",
        (
            *BEGIN,
            "MovePose bottle_pose + z_offset - 30*x_offset",
            "MovePose bottle_pose - 30*x_offset",
            "MoveUntilContact +x",
            "MovePose bottle_pose - 30*x_offset",
            "MovePose bottle_pose + z_offset - 30*x_offset",
            HOME,
        ),
    ),
    Case(
        "a probe of nothing",
        "precondition",
        (*BEGIN, "MovePose bench_approach", "MoveUntilContact +z", HOME),
    ),
    Case(
        "a probe with the palm",
        "collision",
        (*BEGIN, ABOVE, AT, "MoveUntilContact -z", ABOVE, HOME),
    ),
    Case(
        "a probe of a crate",
        None,
        (
            *BEGIN,
            "MovePose above_turned_crate",
            "MoveUntilContact -z",
            "MovePose above_turned_crate",
            HOME,
        ),
    ),
    Case(
        "a probe of a crate's rim",
        None,
        (*BEGIN, "MovePose above_rim", "MoveUntilContact -z", "MovePose above_rim", HOME),
    ),
]


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_a_harmful_plan_is_found_and_a_harmless_variant_passes(case: Case) -> None:
    result = case.findings()
    result.pop("not-restored", None)
    result.pop("gripper-at-end", None)
    if case.rule is None:
        assert result == {}
    else:
        assert case.rule in result, result
        assert len(result[case.rule]) > 20


@st.composite
def mutated(draw: st.DrawFn) -> Node:
    """A valid plan with a few of its leaves dropped, doubled, swapped, put side by side, or with
    another argument."""
    steps: list[str | Node] = [*weigh("bottle")]
    for _ in range(draw(st.integers(1, 4))):
        i, j = (draw(st.integers(0, len(steps) - 1)) for _ in range(2))
        kind = draw(st.sampled_from(["drop", "double", "swap", "together", "other"]))
        if kind == "drop" and len(steps) > 1:
            del steps[i]
        elif kind == "double":
            steps.insert(j, steps[i])
        elif kind == "swap":
            steps[i], steps[j] = steps[j], steps[i]
        elif kind == "together":
            steps[i] = parallel(steps[i], steps[j])
        else:
            steps[i] = draw(other)
    return sequence(*steps)


other = st.one_of(
    st.sampled_from(
        [
            "MovePose nowhere",
            "MovePose bottle_pose + nothing",
            "MovePose bottle_pose - 900*z_offset",
            "MovePose crate_temporary",
            "MovePose bottle_pose - 0.5*z_offset + 3*y_offset",
            "MoveUntilContact -z",
            "MoveUntilContact +x",
            "MoveUntilContact sideways",
            "Pose2Plan",
            "Force2Velocity",
        ]
    ),
    st.lists(st.floats(-1e300, 1e300), min_size=0, max_size=8).map(lambda q: angles(*q)),
    st.lists(st.floats(-2.5, 2.5), min_size=7, max_size=7).map(lambda q: angles(*q)),
    st.just(Node("Parallel")),
)


@given(mutated())
@settings(max_examples=60, deadline=None)
def test_a_mutated_plan_is_judged_and_never_raises(tree: Node) -> None:
    findings = check(plan(tree, "bottle.mass"), crowded())
    assert all(finding.rule in RULES and finding.message for finding in findings)


@cache
def crowded() -> Scene:
    return bench(*ALL, poses=PLACES)


def test_a_parallel_with_a_pose_that_does_not_exist_is_a_finding() -> None:
    tree = sequence(HOME, OPEN, parallel("MovePose nowhere", "MeasureForces"), HOME)
    by_name = {
        finding.rule: finding.path for finding in check(plan(tree, "bottle.mass"), crowded())
    }
    assert by_name["unknown-symbol"] == "tree.children[2].children[0]"


def test_the_set_has_more_than_thirty_nasty_plans() -> None:
    assert sum(case.rule is not None for case in CASES) >= 30
