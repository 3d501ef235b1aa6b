"""Rules of how a plan ends: everything is measured, and everything as it was found."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.planning.check.case import Case
from palpate.planning.check.finding import Finding
from palpate.planning.check.measured import lacking, measured
from palpate.planning.check.walk import Walk
from palpate.quantities.catalogue import catalogue
from palpate.vocabulary.registry import acquisition


def no_explanation(case: Case) -> Iterator[Finding]:
    """A plan without a tree says why."""
    if case.plan.tree is None and not case.plan.explanation.strip():
        message = "'tree' is null; say in 'explanation' what cannot be measured, and why"
        yield Finding.of("explanation", "no-explanation", message)


def promised_without_tree(case: Case) -> Iterator[Finding]:
    """The tree yields every parameter."""
    if case.plan.tree is None and case.plan.parameters:
        promised = ", ".join(str(parameter) for parameter in case.plan.parameters)
        message = (
            f"'tree' is null, yet {promised} is promised; give a tree, or leave the parameters "
            "empty and explain"
        )
        yield Finding.of("parameters", "undischarged", message)


def undischarged(case: Case, walk: Walk) -> Iterator[Finding]:
    """The tree yields every parameter."""
    for i, parameter in enumerate(case.plan.parameters):
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or not quantity.identifiable or measured(parameter, walk.state):
            continue
        if not (case.exists(parameter) and case.is_of_its_kind(parameter)):
            continue
        missing = f"it needs: {acquisition(quantity)}"
        if quantity.derived:
            missing = f"of its recordings it lacks: {'; '.join(lacking(parameter, walk.state))}"
        message = f"the tree does not yield {parameter}; {missing}"
        if walk.failed:
            message = (
                f"the tree does not yield {parameter}, which may follow from the findings above"
            )
        yield Finding.of(f"parameters[{i}]", "undischarged", message)


def gripper_at_end(case: Case, walk: Walk) -> Iterator[Finding]:
    """At the end the gripper is empty and open."""
    state = walk.state
    if state.holding:
        message = (
            f"'{state.holding}' is still in the gripper at the end; put it back to "
            f"'{state.grasp}' and OpenGripper"
        )
        yield Finding.of("tree", "gripper-at-end", message)
    elif state.gripper == "closed":
        message = "the gripper is closed at the end; OpenGripper"
        yield Finding.of("tree", "gripper-at-end", message)


def not_restored(case: Case, walk: Walk) -> Iterator[Finding]:
    """At the end every object is back in its place."""
    for name, pose in walk.state.not_restored().items():
        if name != walk.state.holding:
            x, y, z = pose.position
            away = pose.distance_to(walk.state.scene.body(name).pose_world)
            message = (
                f"'{name}' is left at ({x:.3f}, {y:.3f}, {z:.3f}) m, {1e3 * away:.0f} mm from where it "
                f"was found; MovePose it back to '{name}_pose' before it is released for the last time"
            )
            yield Finding.of("tree", "not-restored", message)
