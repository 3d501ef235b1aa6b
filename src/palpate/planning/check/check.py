"""Check of a plan before it may move anything, whatever its author.

Rules of single actions are judged by the primitives themselves (`Primitive.violations`), in the state
in which the plan has them. Rules of whole plans are functions, in `PLAN_RULES` and `WALK_RULES`; their
requirements are stated in `rules`. Findings are worded for repair: the fault, its place, the remedy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from palpate.parameter import Parameter
from palpate.planning.check import static_rules, walk_rules
from palpate.planning.check.case import Case, Finding
from palpate.planning.check.regions import unpassable_regions
from palpate.planning.check.rules import CATALOGUE
from palpate.planning.check.static_rules import Fault
from palpate.planning.check.walk import MAX_FINDINGS, Reach, Walk
from palpate.planning.plan import Plan
from palpate.scene.scene import Scene
from palpate.vocabulary.registry import Vocabulary, vocabulary

__all__ = ["MAX_FINDINGS", "PLAN_RULES", "RULES", "WALK_RULES", "Finding", "check"]

PLAN_RULES: Mapping[str, Callable[[Case], Iterable[Fault]]] = {
    "unknown-parameter": static_rules.unknown_parameter,
    "unmeasurable": static_rules.unmeasurable,
    "duplicate-parameter": static_rules.duplicate_parameter,
    "known": static_rules.known_parameter,
    "requested": static_rules.requested,
    "unknown-primitive": static_rules.unknown_primitive,
    "bad-argument": static_rules.bad_argument,
    "leaf-children": static_rules.leaf_children,
    "empty-composite": static_rules.empty_composite,
    "one-owner": static_rules.one_owner,
    "buffer-unwritten": static_rules.order_of_buffers,
}
"""Rules on the text of a plan, by id."""

WALK_RULES: Mapping[str, Callable[[Case, Walk], Iterable[Fault]]] = {
    "known": walk_rules.known,
    "redundant": walk_rules.redundant,
    "untouched": walk_rules.untouched,
    "undischarged": walk_rules.undischarged,
    "gripper-at-end": walk_rules.gripper_at_end,
    "not-restored": walk_rules.not_restored,
}
"""Rules on the symbolic states of a plan, by id."""

COMPLETE_RULES = ("redundant", "undischarged", "gripper-at-end", "not-restored")
"""Rules that can be judged only where every action can be read."""

REJECTION_RULES: Mapping[str, Callable[[Case], Iterable[Fault]]] = {
    "no-explanation": static_rules.no_explanation,
    "undischarged": static_rules.promised_without_tree,
}
"""Rules on a plan without a tree, by id."""


RULES: Mapping[str, str] = {rule.id: rule.asks for rule in CATALOGUE.values()}
"""Requirement of each rule, by id."""


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
    """Check a plan; return its findings, empty when it may run.

    Args:
        plan: the plan of any author.
        scene: the scene that it runs in; without one only the grammar is checked.
        remeasure: allows quantities that the scene states to be measured.
        requested: the parameters that the plan must measure, no more and no fewer.
        reachable: replaces the arm's inverse kinematics.
        words: the vocabulary that the plan may use, by default the installed one.
        repeated: allows a parameter to be measured several times.
    """
    asked = tuple(requested) if requested is not None else None
    case = Case(plan, words or vocabulary(), scene, remeasure, asked, repeated)
    found: list[Finding] = []
    for id, rule in (REJECTION_RULES if plan.tree is None else PLAN_RULES).items():
        found += [Finding.of(path, id, message) for path, message in rule(case)]
    if plan.tree is None:
        return tuple(found)
    if scene is not None:
        walk = Walk.over(case, reachable)
        found += walk.findings
        found += () if walk.full else unpassable_regions(case, walk, reachable)
        for id, judged in WALK_RULES.items() if not walk.full else ():
            if not (walk.unread and id in COMPLETE_RULES):
                found += [Finding.of(path, id, message) for path, message in judged(case, walk)]
    return tuple(dict.fromkeys(found))[:MAX_FINDINGS]
