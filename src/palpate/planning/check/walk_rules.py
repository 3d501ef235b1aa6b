"""Rules on a plan as it would run: economy, restored scene, yielded parameters.

Each rule yields a path and a message for every place where the walk over a plan breaks it.
"""

from __future__ import annotations

from collections.abc import Iterator

from palpate.parameter import Parameter
from palpate.planning.check.case import Case
from palpate.planning.check.static_rules import Fault
from palpate.planning.check.walk import Action, Walk, lacking, measured
from palpate.quantities.catalogue import catalogue
from palpate.quantities.quantity import Piece
from palpate.vocabulary.admissible.clearance import needed_away
from palpate.vocabulary.registry import acquisition


def known(case: Case, walk: Walk) -> Iterator[Fault]:
    """Quantities that the scene states are not measured, unless measuring again is allowed."""
    for action, parameter in walk.conversions():
        if is_stray(parameter, case):
            yield action.path, f"{parameter} is stated by the scene; do not measure it"


def redundant(case: Case, walk: Walk) -> Iterator[Fault]:
    """Each measurement and recording is made once, and a parameter needs it."""
    made: set[Parameter] = set()
    for action, parameter in walk.conversions():
        if not is_stray(parameter, case):
            if parameter in made and not case.repeated:
                yield action.path, f"{parameter} is measured already; remove this"
            elif parameter not in case.plan.parameters and not case.unclear:
                yield (
                    action.path,
                    f"this yields {parameter}, which is not among the parameters; remove it",
                )
        made.add(parameter)
    for action in unused_recordings(case, walk):
        if not walk.doubts(action.path):
            _, context = action.after.logged[-1]
            of = f"of '{context.holding}' in the hand" if context.holding else "of the empty hand"
            yield (
                action.path,
                f"no parameter needs what is logged here, {of}, {context.activity}, "
                f"at '{context.at}'; remove it",
            )


def untouched(case: Case, walk: Walk) -> Iterator[Fault]:
    """Only objects among the parameters are grasped, objects that block them, and tools for measuring
    them; without parameters, one tool that the explanation names."""
    assert case.scene is not None
    if case.unclear:
        return
    concerned = {parameter.object for parameter in case.plan.parameters}
    grasped = [(action.path, action.grasps) for action in walk.actions if action.grasps]
    if concerned:
        # A tool is held while a parameter of another object is measured.
        allowed = concerned | {
            action.before.holding
            for action, parameter in walk.conversions()
            if action.before.holding and parameter in case.plan.parameters
        }
    else:
        objects = {name for _, name in grasped}
        allowed = {name for name in objects if name in case.plan.explanation}
        allowed = allowed if len(objects) == 1 else set[str]()
    strange = [(path, name) for path, name in grasped if name not in allowed]
    # The objects that block the others are costly to find: only where one is in question.
    away = needed_away(case.scene, concerned) if strange else ()
    for path, name in strange:
        if name not in away:
            yield (
                path,
                f"'{name}' is not among the parameters' objects and blocks none of them; "
                "leave it alone",
            )


def undischarged(case: Case, walk: Walk) -> Iterator[Fault]:
    """The tree yields every parameter."""
    for path, parameter in case.listed():
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or not quantity.identifiable or measured(parameter, walk.state):
            continue
        if not (case.exists(parameter) and case.is_of_its_kind(parameter)):
            continue
        if walk.failed:
            missing = ", which may follow from the findings above"
        elif quantity.derived:
            missing = f"; of its recordings it lacks: {'; '.join(lacking(parameter, walk.state))}"
        else:
            missing = f"; it needs: {acquisition(quantity)}"
        yield path, f"the tree does not yield {parameter}{missing}"


def gripper_at_end(case: Case, walk: Walk) -> Iterator[Fault]:
    """At the end the gripper is empty and open."""
    state = walk.state
    if state.holding:
        yield (
            "tree",
            f"'{state.holding}' is still in the gripper at the end; put it back to "
            f"'{state.grasp}' and OpenGripper",
        )
    elif state.gripper == "closed":
        yield "tree", "the gripper is closed at the end; OpenGripper"


def not_restored(case: Case, walk: Walk) -> Iterator[Fault]:
    """At the end every object is back in its place."""
    for name, pose in walk.state.not_restored().items():
        if name != walk.state.holding:
            x, y, z = pose.position
            away = pose.distance_to(walk.state.scene.body(name).pose_world)
            yield (
                "tree",
                f"'{name}' is left at ({x:.3f}, {y:.3f}, {z:.3f}) m, {1e3 * away:.0f} mm from where it "
                f"was found; MovePose it back to '{name}_pose' before it is released for the last time",
            )


def is_stray(parameter: Parameter, case: Case) -> bool:
    """True if the scene states a parameter that the plan does not promise."""
    asked = case.remeasure or parameter in case.plan.parameters
    return not asked and case.is_known(parameter)


def unused_recordings(case: Case, walk: Walk) -> Iterator[Action]:
    """Sensing leaves that neither a conversion nor a derived parameter needs."""
    # A conversion reads the latest recording that its branch of the tree knows of.
    paths = {id(action.after.logged[-1]): action.path for action in walk.actions if action.records}
    converted: set[str | None] = set()
    for action in walk.actions:
        if action.primitive.measures is not None:
            read = [entry for entry in action.before.logged if entry[0] == action.primitive.reads]
            converted.add(paths.get(id(read[-1])) if read else None)
    # Evidence that an earlier recording gave already is none.
    seen: set[tuple[Parameter, Piece]] = set()
    for action in walk.actions:
        if not action.records:
            continue
        evidence: set[tuple[Parameter, Piece]] = set()
        for parameter in case.plan.parameters:
            piece = recorded_piece(parameter, action)
            if piece is not None:
                evidence.add((parameter, piece))
        if action.path not in converted and evidence <= seen:
            yield action
        if not case.repeated:
            seen |= evidence


def recorded_piece(parameter: Parameter, action: Action) -> Piece | None:
    """Piece of evidence that an action records for a derived parameter, or for one whose evidence is
    several distinct recordings."""
    logged = action.after.logged[-1]
    quantity = catalogue().get(parameter.quantity)
    if quantity is None:
        return None
    piece = quantity.piece(parameter, *logged)
    if piece is None or quantity.derived or quantity.evidence[piece[0]].distinct is not None:
        return piece
    return None
