"""The check every plan passes before it may move anything, whoever made it.

Findings are worded for repair: what is wrong, where, and what to do. The rules are listed in
`RULES`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate.parameter import Parameter
from palpate.planning.check.measured import measured
from palpate.planning.check.walk import Finding, Reach, Walk, static_findings
from palpate.planning.plan import Plan
from palpate.planning.symbolic.mentions import GRIPPER
from palpate.quantities.catalogue import catalogue
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.clearance import needed_away
from palpate.vocabulary.registry import acquisition
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


def check(
    plan: Plan,
    scene: Scene | None,
    *,
    remeasure: bool = False,
    requested: Iterable[Parameter] | None = None,
    reachable: Reach | None = None,
) -> tuple[Finding, ...]:
    """What is wrong with a plan; empty when it may run.

    Without a scene only the plan's grammar is checked. `remeasure` allows what the scene states to
    be measured; `requested` are the gaps the parameters must match; `reachable` replaces the arm's
    inverse kinematics.
    """
    if plan.tree is None:
        return tuple(_without_tree(plan))
    found = [*static_findings(plan.tree, buffers=scene is None)]
    if scene is None:
        return tuple([*_parameters(plan, None, remeasure), *found][:MAX_FINDINGS])
    walk = Walk(scene, reachable)
    walk.fold(plan.tree)
    found = [
        *_parameters(plan, scene, remeasure),
        *_requested(plan, requested),
        *found,
        *walk.findings,
        *_minimal(plan, walk, scene, remeasure),
        *_end(plan, walk.state),
    ]
    return tuple(dict.fromkeys(found))[:MAX_FINDINGS]


def _without_tree(plan: Plan) -> Iterator[Finding]:
    if not plan.explanation.strip():
        yield Finding(
            "explanation",
            "no-explanation",
            "'tree' is null; say in 'explanation' what cannot be measured, and why",
        )
    if plan.parameters:
        promised = ", ".join(str(parameter) for parameter in plan.parameters)
        yield Finding(
            "parameters",
            "undischarged",
            f"'tree' is null, yet {promised} is promised; give a tree, or "
            "leave the parameters empty and explain",
        )


def _parameters(plan: Plan, scene: Scene | None, remeasure: bool) -> Iterator[Finding]:
    for i, parameter in enumerate(plan.parameters):
        path = f"parameters[{i}]"
        if parameter in plan.parameters[:i]:
            yield Finding(path, "duplicate-parameter", f"{parameter} is listed twice; list it once")
        if parameter.quantity not in catalogue():
            yield Finding(
                path,
                "unknown-parameter",
                f"'{parameter.quantity[:80]}' is not a quantity; valid: {', '.join(catalogue())}",
            )
        elif not catalogue()[parameter.quantity].identifiable:
            yield Finding(
                path,
                "unmeasurable",
                f"{parameter} cannot be measured: {catalogue()[parameter.quantity].how}; remove it "
                "and say so in the explanation",
            )
        elif scene is not None:
            yield from _of_body(parameter, path, scene, remeasure)


def _of_body(parameter: Parameter, path: str, scene: Scene, remeasure: bool) -> Iterator[Finding]:
    quantity = catalogue()[parameter.quantity]
    if parameter.object not in scene.bodies:
        if not (parameter.object == GRIPPER and quantity.subject == GRIPPER):
            yield Finding(
                path,
                "unknown-parameter",
                f"the scene has no '{parameter.object[:80]}'; valid: "
                f"{', '.join(scene.bodies) or 'none'}",
            )
        return
    body = scene.bodies[parameter.object]
    if quantity.subject not in (body.role, GRIPPER):
        yield Finding(
            path,
            "unmeasurable",
            f"{quantity.label} is a quantity of a {quantity.subject}, and "
            f"'{body.name}' is a {body.role}; remove it",
        )
    elif parameter.quantity in body.known and not remeasure:
        stated = ", ".join(f"{v:.6g}" for v in body.known[parameter.quantity])
        yield Finding(
            path,
            "known",
            f"{parameter} is stated by the scene ({stated} {quantity.unit}); remove it and what "
            "measures it",
        )


def _requested(plan: Plan, requested: Iterable[Parameter] | None) -> Iterator[Finding]:
    if requested is None:
        return
    wanted = tuple(requested)
    for parameter in wanted:
        if parameter not in plan.parameters:
            yield Finding(
                "parameters", "requested", f"{parameter} is requested and missing; measure it too"
            )
    for i, parameter in enumerate(plan.parameters):
        if parameter not in wanted:
            yield Finding(
                f"parameters[{i}]", "requested", f"{parameter} is not requested; leave it out"
            )


def _minimal(plan: Plan, walk: Walk, scene: Scene, remeasure: bool) -> Iterator[Finding]:
    """Known things re-measured, redundant measurements, objects touched without need."""
    for path, parameter, first in walk.conversions:
        known = (
            parameter.object in scene.bodies
            and parameter.quantity in scene.bodies[parameter.object].known
        )
        if known and not remeasure and parameter not in plan.parameters:
            yield Finding(path, "known", f"{parameter} is stated by the scene; do not measure it")
        elif not first:
            yield Finding(path, "redundant", f"{parameter} is measured already; remove this")
        elif parameter not in plan.parameters:
            yield Finding(
                path,
                "redundant",
                f"this yields {parameter}, which is not among the parameters; remove it",
            )
    for path in walk.unused_recordings(plan.parameters):
        yield Finding(path, "redundant", "no parameter needs what is logged here; remove it")
    concerned = {parameter.object for parameter in plan.parameters}
    if not concerned:
        return
    allowed = concerned | walk.tools(plan.parameters)
    for path, name in walk.grasped:
        if name not in allowed and name not in (allowed := allowed | needed_away(scene, concerned)):
            yield Finding(
                path,
                "untouched",
                f"'{name}' is not among the parameters' objects and blocks none of them; "
                "leave it alone",
            )


def _end(plan: Plan, state: SymbolicState) -> Iterator[Finding]:
    for i, parameter in enumerate(plan.parameters):
        if (
            parameter.quantity in catalogue()
            and catalogue()[parameter.quantity].identifiable
            and not measured(parameter, state)
        ):
            how = acquisition(catalogue()[parameter.quantity])
            yield Finding(
                f"parameters[{i}]",
                "undischarged",
                f"the tree does not yield {parameter}; it needs: {how}",
            )
    if state.holding:
        yield Finding(
            "tree",
            "gripper-at-end",
            f"'{state.holding}' is still in the gripper at the end; put it back to "
            f"'{state.grasp}' and OpenGripper",
        )
    elif state.gripper == "closed":
        yield Finding("tree", "gripper-at-end", "the gripper is closed at the end; OpenGripper")
    for name, pose in state.not_restored().items():
        if name != state.holding:
            x, y, z = pose.position
            yield Finding(
                "tree",
                "not-restored",
                f"'{name}' is left at ({x:.3f}, {y:.3f}, {z:.3f}) m; carry it back "
                f"to '{name}_pose' before the end",
            )
