"""The check every plan passes before it may move anything, whoever made it.

Rules of single actions are judged by the primitives themselves (`Primitive.violations`), at the
place where the plan has them. Rules of whole plans are functions, in `PLAN_RULES` and `WALK_RULES`.
What each of them demands stands in `rules`.
Findings are worded for repair: what is wrong, where, and what to do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from palpate.parameter import Parameter
from palpate.planning.check import end, grammar, minimal
from palpate.planning.check import parameters as promised
from palpate.planning.check.case import Case, Form
from palpate.planning.check.finding import Finding
from palpate.planning.check.regions import somewhere
from palpate.planning.check.rules import CATALOGUE
from palpate.planning.check.walk import Reach, Walk
from palpate.planning.plan import Plan
from palpate.scene.scene import Scene
from palpate.vocabulary.registry import Vocabulary, vocabulary

__all__ = ["MAX_FINDINGS", "PLAN_RULES", "RULES", "WALK_RULES", "Finding", "check"]

MAX_FINDINGS = 50

PLAN_RULES: Mapping[str, Callable[[Case], Iterable[Finding]]] = {
    "unknown-parameter": promised.unknown_parameter,
    "unmeasurable": promised.unmeasurable,
    "duplicate-parameter": promised.duplicate_parameter,
    "known": promised.known_parameter,
    "requested": promised.requested,
    "unknown-primitive": grammar.unknown_primitive,
    "bad-argument": grammar.bad_argument,
    "leaf-children": grammar.leaf_children,
    "empty-composite": grammar.empty_composite,
    "one-owner": grammar.one_owner,
    "buffer-unwritten": grammar.order_of_buffers,
}
"""Rule id to who finds where a plan breaks it, by what is written alone."""

WALK_RULES: Mapping[str, Callable[[Case, Walk], Iterable[Finding]]] = {
    "known": minimal.known,
    "redundant": minimal.redundant,
    "untouched": minimal.untouched,
    "undischarged": end.undischarged,
    "gripper-at-end": end.gripper_at_end,
    "not-restored": end.not_restored,
}
"""Rule id to who finds where a plan breaks it, by what would be believed while it runs."""

OF_THE_WHOLE = ("redundant", "undischarged", "gripper-at-end", "not-restored")
"""Rules that nobody can judge where an action cannot be read."""

REJECTION_RULES: Mapping[str, Callable[[Case], Iterable[Finding]]] = {
    "no-explanation": end.no_explanation,
    "undischarged": end.promised_without_tree,
}
"""Rule id to who finds where a plan without a tree breaks it."""


RULES: Mapping[str, str] = {rule.id: rule.asks for rule in CATALOGUE.values()}
"""Rule id to what it demands."""


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
        plan: whoever made it.
        scene: where it is to run; without one only its grammar is checked.
        remeasure: allows what the scene states to be measured.
        requested: the parameters that the plan must measure, no more and no fewer.
        reachable: replaces the arm's inverse kinematics.
        words: the vocabulary that it may use, by default what is installed.
        repeated: allows a parameter to be measured several times.
    """
    words = words or vocabulary()
    asked = tuple(requested) if requested is not None else None
    case = Case(plan, Form.of(plan.tree, words), words, scene, remeasure, asked, repeated)
    found: list[Finding] = []
    if plan.tree is None:
        for rule in REJECTION_RULES.values():
            found += rule(case)
        return tuple(found)
    for rule in PLAN_RULES.values():
        found += rule(case)
    if scene is not None:
        walk = Walk.over(plan.tree, case.form, words, scene, reachable)
        found += walk.findings
        found += somewhere(case, walk, reachable)
        for rule, judged in WALK_RULES.items():
            if not (walk.unread and rule in OF_THE_WHOLE):
                found += judged(case, walk)
    return tuple(dict.fromkeys(found))[:MAX_FINDINGS]
