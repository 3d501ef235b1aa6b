"""Check of a plan before any motion: rules, their order, and estimated poses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import PoseLine
from palpate.planning.check import plan_rules
from palpate.planning.check.finding import CheckedPlan, Finding
from palpate.planning.check.plan_rules import Fault, objects_displaced_at_end
from palpate.planning.check.walk import MAX_FINDINGS, Reach, Walk
from palpate.planning.plan import Plan
from palpate.primitives.contact import PROBE_TRAVEL
from palpate.primitives.motion import MovePose
from palpate.primitives.registry import Vocabulary, vocabulary
from palpate.primitives.rules.collision import ARM, BESIDE, ENTERED, FIXED
from palpate.primitives.rules.grasp import PUSHED
from palpate.primitives.rules.motion import HELD_UPRIGHT
from palpate.primitives.rules.profile import POSE_ERROR
from palpate.primitives.rules.support import AS_FOUND, EDGE, LIFTED, MIN_SLIDE, TIPPING, UPRIGHT
from palpate.primitives.state import PRECONDITION, RESTORED_POSITION, SINKING
from palpate.scene.places import GUESSED
from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Rule:
    """Rule of the check."""

    id: str  # name in findings
    asks: str  # requirement on a plan, in words for people and models
    about: Literal["parameters", "tree"] = "tree"  # part of a plan that the rule tests
    # The rule prescribes a method of measurement rather than safety, economy or form. The lean
    # prompt leaves recipes to the model.
    recipe: bool = False


def mm(length: float) -> str:
    """Format a length in m as millimetres."""
    return f"{1e3 * length:.3g} mm"


_PARAMETERS = {
    "unknown-parameter": "Parameters name objects or surfaces of the scene, or `gripper`, and quantities of the "
    "catalogue.",
    "unmeasurable": "A parameter is a measurable quantity of its kind of body: object, surface or gripper.",
    "duplicate-parameter": "A parameter is listed once.",
    "known": "A value that the scene states is not measured, unless it is requested again.",
    "requested": "Without a request, the parameters are exactly the missing values of the scene.",
    "undischarged": "The tree yields every parameter: by its conversion or, if it is derived, by all recordings "
    "that it needs. Without a tree there are no parameters.",
    "redundant": "No measurement or log is repeated or unneeded; another place or grasp makes a different one.",
    "untouched": "Only these are grasped: objects of the parameters, objects that block them, and tools held during "
    "a measurement; without parameters, one object that the explanation names.",
    "no-explanation": "A plan without a tree explains why.",
}
_FORM = {
    "unknown-primitive": "Every node's type is a primitive or composite of the vocabulary.",
    "bad-argument": "A leaf's arguments are those that its primitive declares, of the declared types; composites "
    "have only `children`; any node may have a `name`.",
    "leaf-children": "Only composites have children.",
    "empty-composite": "A Sequence or Parallel has at least one child.",
    "one-owner": "At most one leaf below a Parallel moves the arm, and at most one the gripper.",
    "buffer-unwritten": "A conversion comes after the sensing that fills its buffer, not in parallel.",
}
_ACTIONS = {
    "unknown-symbol": "Poses, offsets and joint configurations are named by symbols of the scene.",
    "unreachable": "The arm reaches every pose within its workspace and joint limits; Tilt keeps the wrist bent.",
    "unknown-start": "Every motion starts at a known place: a plan with MoveJoints to `home_config`, a turn at a pose.",
    "gripper-state": "Fingers close only when open, at a pose, and on an object whose middle is within "
    f"{mm(PUSHED)} of theirs; they open only when the held object is supported; neither happens during a motion.",
    "too-wide": "A grasped object fits the hand.",
    "payload": "A grasped object is not known to exceed the payload.",
    "twist": "The pads hold the object: it neither twists nor slips out.",
    PRECONDITION: "Other preconditions hold. MoveUntilContact: from a pose, with empty fingers, no contact yet, and "
    f"a body within {1e3 * PROBE_TRAVEL:.0f} mm whose top is at most {mm(SINKING)} above the fingertips. "
    "MoveJoints: between a level hand and one that points down, the wrist turns first. Conversion: the log is "
    f"evidence of its quantity; for a weight, the object is lifted by more than {mm(LIFTED)}.",
    "blocked": f"Hand and held object keep {mm(BESIDE)} from every other object on the whole path; objects "
    "on top are carried away first.",
    "collision": f"Both keep {mm(ENTERED)} from an object between the fingers, {mm(FIXED)} from fixed bodies "
    f"({mm(GUESSED)} above a surface of unknown height, which is only probed), the arm's links "
    f"{mm(ARM)} from everything; Tilt, Turn and Swing keep {mm(POSE_ERROR)}, in free air.",
    "self-collision": f"The arm keeps {mm(ARM)} from itself.",
    "unsupported": f"A released object is within {mm(AS_FOUND)} of its original pose, or upright to "
    f"{np.degrees(UPRIGHT):.3g}° with its centre of mass {mm(TIPPING)} inside its support (if unknown, its whole "
    f"outline by {mm(EDGE)}). A dragged object stays supported.",
    "tilted": f"A held object stays upright to {np.degrees(HELD_UPRIGHT):.3g}°, except in Tilt and Swing.",
    "short-slide": f"A slide that measures friction is level, on one surface, and at least {mm(MIN_SLIDE)} long.",
    "gripper-at-end": "At the end the gripper is empty and open.",
    "not-restored": f"At the end every object is within {mm(RESTORED_POSITION)} of its original place.",
}
_RECIPES = ("short-slide",)
# All rules by id, in the order of presentation to people and models.
CATALOGUE: Mapping[str, Rule] = {
    **{id: Rule(id, asks, "parameters") for id, asks in _PARAMETERS.items()},
    **{id: Rule(id, asks, recipe=id in _RECIPES) for id, asks in {**_FORM, **_ACTIONS}.items()},
}


# Estimated poses: the whole plan must pass the check at every place in their regions.


def unpassable_regions(
    case: CheckedPlan, walk: Walk, reachable: Reach | None = None
) -> Iterator[Finding]:
    """Yield a finding for every estimated pose with a region that does not pass as a whole.

    Args:
        case: the plan under check.
        walk: the walk over the tree at the believed poses.
        reachable: replaces the arm's inverse kinematics.
    """
    assert case.scene is not None
    symbols = case.scene.symbols
    # Between two estimated poses the path is unknown, so a known pose must come between.
    for action in walk.actions:
        start, goal = (
            symbols.estimated_name(at or "") for at in (action.before.at, action.after.at)
        )
        if start is not None and goal is not None and start != goal:
            message = (
                f"'{start}' and '{goal}' are both estimated in the run, so the path between them is unknown; "
                f"MovePose to '{symbols.subjects[goal]}_pose + z_offset' first"
            )
            yield Finding(action.path, "unknown-start", message)
    # A fault at the believed pose is reported already. Only rules that break elsewhere in the
    # region count.
    known = {(finding.path, finding.rule) for finding in all_findings(case, walk)}
    # Walk over the plan again with each pose placed along its line, up to the first new fault.
    for name, line in estimated_poses(case).items():
        for place in line.places():
            # One new fault per pose is enough.
            other = Walk.over(case, reachable, {name: place})
            added = (f for f in all_findings(case, other) if (f.path, f.rule) not in known)
            if (reached := next(added, None)) is not None:
                problem = reached.message.partition("; ")[0]
                message = (
                    f"'{name}' is estimated in the run, between {1e3 * line.least:.0f} and "
                    f"{1e3 * line.most:.0f} mm along; at {1e3 * place:.0f} mm {problem}; use "
                    f"'{symbols.subjects[name]}_pose' with a free offset instead"
                )
                yield replace(reached, message=message)
                break


def estimated_poses(case: CheckedPlan) -> dict[str, PoseLine]:
    """Return the estimated poses of the plan, each with the line of its possible places."""
    lines: dict[str, PoseLine] = {}
    symbols = case.scene.symbols if case.scene is not None else None
    for primitive in case.form.primitives.values():
        # Only MovePose goes to an estimated pose.
        if symbols is not None and isinstance(primitive, MovePose):
            name = symbols.estimated_name(primitive.pose)
            if name is not None:
                lines[name] = symbols.lines[name]
    return lines


def all_findings(case: CheckedPlan, walk: Walk) -> list[Finding]:
    """Return the findings of a walk, including objects that are displaced at its end."""
    displaced = objects_displaced_at_end(case, walk)
    return [*walk.findings, *(Finding(path, "not-restored", m) for path, m in displaced)]


# The check itself, for plans of any author.


__all__ = ["MAX_FINDINGS", "PLAN_RULES", "RULES", "WALK_RULES", "Finding", "check"]
# Rules on the text of a plan, by id.
PLAN_RULES: Mapping[str, Callable[[CheckedPlan], Iterable[Fault]]] = {
    "unknown-parameter": plan_rules.unknown_parameter,
    "unmeasurable": plan_rules.unmeasurable,
    "duplicate-parameter": plan_rules.duplicate_parameter,
    "known": plan_rules.known_parameter,
    "requested": plan_rules.check_request,
    "unknown-primitive": plan_rules.unknown_primitive,
    "bad-argument": plan_rules.bad_argument,
    "leaf-children": plan_rules.leaf_children,
    "empty-composite": plan_rules.empty_composite,
    "one-owner": plan_rules.one_owner,
    "buffer-unwritten": plan_rules.order_of_buffers,
}
# Rules on the symbolic states of a plan, by id.
WALK_RULES: Mapping[str, Callable[[CheckedPlan, Walk], Iterable[Fault]]] = {
    "known": plan_rules.measure_no_stated_value,
    "redundant": plan_rules.redundant,
    "untouched": plan_rules.check_touches,
    "undischarged": plan_rules.parameters_not_measured,
    "gripper-at-end": plan_rules.gripper_at_end,
    "not-restored": plan_rules.objects_displaced_at_end,
}
# Rules that apply only if every action is readable.
COMPLETE_RULES = ("redundant", "undischarged", "gripper-at-end", "not-restored")
# Rules on a plan without a tree, by id.
REJECTION_RULES: Mapping[str, Callable[[CheckedPlan], Iterable[Fault]]] = {
    "no-explanation": plan_rules.no_explanation,
    "undischarged": plan_rules.promised_without_tree,
}


# Requirement of each rule, by id.
RULES: Mapping[str, str] = {rule.id: rule.asks for rule in CATALOGUE.values()}


def check(
    plan: Plan,
    scene: Scene | None,
    *,
    remeasure: bool = False,
    requested: Iterable[Parameter] | None = None,
    reachable: Reach | None = None,
    words: Vocabulary | None = None,
    repeated: bool = False,
) -> tuple[Finding, ...]:
    """Check a plan; return its findings, empty if it may run.

    Args:
        plan: the plan of any author.
        scene: the scene of the run; without one only the grammar is checked.
        remeasure: allows measurement of quantities that the scene states.
        requested: the exact set of parameters that the plan must measure.
        reachable: replaces the arm's inverse kinematics.
        words: the permitted vocabulary; the installed one by default.
        repeated: allows several measurements of one parameter.
    """
    asked = tuple(requested) if requested is not None else None
    case = CheckedPlan(plan, words or vocabulary(), scene, remeasure, asked, repeated)
    findings: list[Finding] = []
    # Test the text of the plan first: this needs no scene.
    for id, rule in (REJECTION_RULES if plan.tree is None else PLAN_RULES).items():
        findings += [Finding(path, id, message) for path, message in rule(case)]
    # Without a tree there is nothing to walk over.
    if plan.tree is None:
        return tuple(findings)
    # Walk over the symbolic states, then apply the rules on whole plans.
    if scene is not None:
        walk = Walk.over(case, reachable)
        findings += walk.findings
        findings += () if walk.full else unpassable_regions(case, walk, reachable)
        for id, judged in WALK_RULES.items() if not walk.full else ():
            # Rules on complete plans need every action to be readable.
            if not (walk.unread and id in COMPLETE_RULES):
                findings += [Finding(path, id, message) for path, message in judged(case, walk)]
    return tuple(dict.fromkeys(findings))[:MAX_FINDINGS]
