"""The check every plan passes before it may move anything, whoever made it.

Findings are worded for repair: what is wrong, where, and what to do. The rules are listed in `RULES`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate.planning.clearance import needed_away
from palpate.planning.evidence import DERIVED, discharged
from palpate.planning.mentions import GRIPPER
from palpate.planning.plan import Plan
from palpate.planning.walk import Finding, Reach, Walk, static_findings
from palpate.quantities import QUANTITIES, Gap
from palpate.scene.scene import Scene
from palpate.vocabulary.primitive import vocabulary
from palpate.vocabulary.state import SymbolicState

__all__ = ["MAX_FINDINGS", "RULES", "Finding", "check"]

MAX_FINDINGS = 50

RULES: dict[str, str] = {
    "unknown-primitive": "Every node's type is a primitive or composite of the vocabulary.",
    "bad-argument": "A leaf's arguments are those its primitive declares, of the declared types; composites have none.",
    "leaf-children": "Only composites have children.",
    "empty-composite": "A Sequence or Parallel has at least one child.",
    "one-owner": "At most one leaf below a Parallel moves the arm, and at most one the gripper.",
    "unknown-symbol": "Poses and joint configurations are named by symbols of the scene.",
    "unreachable": "The arm reaches every pose within its joint limits.",
    "gripper-state": "Fingers close only when open and on an object, and open only when nothing would fall.",
    "buffer-unwritten": "A conversion comes after the sensing that fills its buffer.",
    "precondition": "What else a primitive requires at its place in the plan holds.",
    "sideways": "Objects are approached from straight above and left straight upwards.",
    "blocked": "The hand, and what it holds, meets no other object on its way.",
    "short-slide": "A slide beside a force log is long enough to feel friction.",
    "too-wide": "An object that is grasped fits the hand.",
    "payload": "An object that is grasped is not known to be heavier than the payload.",
    "unknown-parameter": "Parameters name objects or surfaces of the scene and quantities of the catalogue.",
    "unmeasurable": "A parameter is a quantity that can be measured of its object.",
    "duplicate-parameter": "A parameter is listed once.",
    "requested": "The parameters are those requested, no more and no fewer.",
    "known": "Nothing that the scene states is measured (unless re-measuring is asked for).",
    "redundant": "Nothing is measured twice, and nothing that no parameter needs.",
    "untouched": "Only objects among the parameters are grasped, those that block them, and tools for measuring them.",
    "undischarged": "The tree yields every parameter.",
    "not-restored": "At the end every object is back in its place.",
    "gripper-at-end": "At the end the gripper is empty and open.",
    "no-explanation": "A plan without a tree says why.",
}
"""Rule id to what it demands."""


def check(plan: Plan, scene: Scene | None, *, remeasure: bool = False, requested: Iterable[Gap] | None = None,
          reachable: Reach | None = None) -> tuple[Finding, ...]:
    """What is wrong with a plan; empty when it may run.

    Without a scene only the plan's grammar is checked. `remeasure` allows what the scene states to be measured;
    `requested` are the gaps the parameters must match; `reachable` replaces the arm's inverse kinematics.
    """
    if plan.tree is None:
        return tuple(_without_tree(plan))
    found = [*static_findings(plan.tree, buffers=scene is None)]
    if scene is None:
        return tuple([*_parameters(plan, None, remeasure), *found][:MAX_FINDINGS])
    walk = Walk(scene, reachable)
    walk.fold(plan.tree)
    found = [*_parameters(plan, scene, remeasure), *_requested(plan, requested), *found, *walk.findings,
             *_minimal(plan, walk, scene, remeasure), *_end(plan, walk.state)]
    return tuple(dict.fromkeys(found))[:MAX_FINDINGS]


def _without_tree(plan: Plan) -> Iterator[Finding]:
    if not plan.explanation.strip():
        yield Finding("explanation", "no-explanation", "'tree' is null; say in 'explanation' what cannot be measured, "
                                                       "and why")
    if plan.parameters:
        promised = ", ".join(str(gap) for gap in plan.parameters)
        yield Finding("parameters", "undischarged", f"'tree' is null, yet {promised} is promised; give a tree, or "
                                                    "leave the parameters empty and explain")


def _parameters(plan: Plan, scene: Scene | None, remeasure: bool) -> Iterator[Finding]:
    vocabulary()  # registers the quantities that third parties measure
    for i, gap in enumerate(plan.parameters):
        path = f"parameters[{i}]"
        if gap in plan.parameters[:i]:
            yield Finding(path, "duplicate-parameter", f"{gap} is listed twice; list it once")
        if gap.quantity not in QUANTITIES:
            yield Finding(path, "unknown-parameter", f"'{gap.quantity[:80]}' is not a quantity; valid: "
                                                     f"{', '.join(QUANTITIES)}")
        elif not QUANTITIES[gap.quantity].identifiable:
            yield Finding(path, "unmeasurable", f"{gap} cannot be measured: {QUANTITIES[gap.quantity].how}; remove it "
                                                "and say so in the explanation")
        elif scene is not None:
            yield from _of_body(gap, path, scene, remeasure)


def _of_body(gap: Gap, path: str, scene: Scene, remeasure: bool) -> Iterator[Finding]:
    quantity = QUANTITIES[gap.quantity]
    if gap.object not in scene.bodies:
        if not (gap.object == GRIPPER and quantity.subject == GRIPPER):
            yield Finding(path, "unknown-parameter", f"the scene has no '{gap.object[:80]}'; valid: "
                                                     f"{', '.join(scene.bodies) or 'none'}")
        return
    body = scene.bodies[gap.object]
    if quantity.subject not in (body.role, GRIPPER):
        yield Finding(path, "unmeasurable", f"{quantity.label} is a quantity of a {quantity.subject}, and "
                                            f"'{body.name}' is a {body.role}; remove it")
    elif gap.quantity in body.known and not remeasure:
        stated = ", ".join(f"{v:.6g}" for v in body.known[gap.quantity])
        yield Finding(path, "known", f"{gap} is stated by the scene ({stated} {quantity.unit}); remove it and what "
                                     "measures it")


def _requested(plan: Plan, requested: Iterable[Gap] | None) -> Iterator[Finding]:
    if requested is None:
        return
    wanted = tuple(requested)
    for gap in wanted:
        if gap not in plan.parameters:
            yield Finding("parameters", "requested", f"{gap} is requested and missing; measure it too")
    for i, gap in enumerate(plan.parameters):
        if gap not in wanted:
            yield Finding(f"parameters[{i}]", "requested", f"{gap} is not requested; leave it out")


def _minimal(plan: Plan, walk: Walk, scene: Scene, remeasure: bool) -> Iterator[Finding]:
    """Known things re-measured, redundant measurements, objects touched without need."""
    for path, gap, first in walk.conversions:
        known = gap.object in scene.bodies and gap.quantity in scene.bodies[gap.object].known
        if known and not remeasure and gap not in plan.parameters:
            yield Finding(path, "known", f"{gap} is stated by the scene; do not measure it")
        elif not first:
            yield Finding(path, "redundant", f"{gap} is measured already; remove this")
        elif gap not in plan.parameters:
            yield Finding(path, "redundant", f"this yields {gap}, which is not among the parameters; remove it")
    for path in walk.unused_recordings(plan.parameters):
        yield Finding(path, "redundant", "no parameter needs what is logged here; remove it")
    concerned = {gap.object for gap in plan.parameters}
    if not concerned:
        return
    allowed = concerned | walk.tools(plan.parameters)
    for path, name in walk.grasped:
        if name not in allowed and name not in (allowed := allowed | needed_away(scene, concerned)):
            yield Finding(path, "untouched", f"'{name}' is not among the parameters' objects and blocks none of them; "
                                             "leave it alone")


def _end(plan: Plan, state: SymbolicState) -> Iterator[Finding]:
    for i, gap in enumerate(plan.parameters):
        if gap.quantity in QUANTITIES and QUANTITIES[gap.quantity].identifiable and not discharged(gap, state):
            how = DERIVED.get(gap.quantity, QUANTITIES[gap.quantity].how)
            yield Finding(f"parameters[{i}]", "undischarged", f"the tree does not yield {gap}; it needs: {how}")
    if state.holding:
        yield Finding("tree", "gripper-at-end", f"'{state.holding}' is still in the gripper at the end; put it back to "
                                                f"'{state.grasp}' and OpenGripper")
    elif state.gripper == "closed":
        yield Finding("tree", "gripper-at-end", "the gripper is closed at the end; OpenGripper")
    for name, pose in state.not_restored().items():
        if name != state.holding:
            x, y, z = pose.position
            yield Finding("tree", "not-restored", f"'{name}' is left at ({x:.3f}, {y:.3f}, {z:.3f}) m; carry it back "
                                                  f"to '{name}_pose' before the end")
