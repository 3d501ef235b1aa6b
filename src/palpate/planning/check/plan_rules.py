"""Rules on a plan: on its text, and on the symbolic states of a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set

from pydantic import ValidationError

from palpate.common.errors import perhaps
from palpate.common.parameter import Parameter
from palpate.estimation.quantities.catalogue import catalogue
from palpate.estimation.quantities.quantity import Piece
from palpate.planning.check.finding import CheckedPlan
from palpate.planning.check.walk import Walk, WalkedAction, has_measurement, lacking
from palpate.primitives.registry import acquisition
from palpate.primitives.rules.clearance import needed_away

SHOWN = 4
"""Leaves that one message names."""
SEVERAL = 3
"""Nodes with the same strange argument that one message tells of."""

Fault = tuple[str, str]
"""Path in the plan, and message with a remedy."""


def unknown_parameter(case: CheckedPlan) -> Iterator[Fault]:
    """Parameters name objects or surfaces of the scene and quantities of the catalogue."""
    for path, parameter in case.iter_parameters():
        if parameter.quantity not in catalogue():
            # A word of a request ("weight") is a better guess than a similar spelling.
            meant = catalogue().meant(parameter.quantity)
            guess = (
                f" did you mean '{meant}'?" if meant else perhaps(parameter.quantity, catalogue())
            )
            valid = ", ".join(catalogue())
            yield path, f"'{parameter.quantity[:80]}' is not a quantity;{guess} valid: {valid}"
        elif not case.exists(parameter):
            assert case.scene is not None
            valid = ", ".join(case.scene.bodies) or "none"
            guess = perhaps(parameter.object, case.scene.bodies)
            yield path, f"the scene has no '{parameter.object[:80]}';{guess} valid: {valid}"


def unmeasurable(case: CheckedPlan) -> Iterator[Fault]:
    """A parameter is a quantity that can be measured of its object."""
    for path, parameter in case.iter_parameters():
        quantity = catalogue().get(parameter.quantity)
        if quantity is None:
            continue
        if not quantity.identifiable:
            yield (
                path,
                f"{parameter} cannot be measured: {quantity.how}; remove it and say so in the "
                "explanation",
            )
        elif case.scene is not None and not case.is_of_its_kind(parameter):
            subject, role = (
                f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"
                for noun in (quantity.subject, case.scene.bodies[parameter.object].role)
            )
            yield (
                path,
                f"{quantity.label} is a quantity of {subject}, and "
                f"'{parameter.object}' is {role}; remove it",
            )


def duplicate_parameter(case: CheckedPlan) -> Iterator[Fault]:
    """A parameter is listed once."""
    seen: set[Parameter] = set()
    for path, parameter in case.iter_parameters():
        if parameter in seen:
            yield path, f"{parameter} is listed twice; list it once"
        seen.add(parameter)


def check_request(case: CheckedPlan) -> Iterator[Fault]:
    """The parameters are those requested, no more and no fewer."""
    if case.requested is None:
        return
    for parameter in case.requested:
        if parameter not in case.plan.parameters:
            yield "parameters", f"{parameter} is requested and missing; measure it too"
    for path, parameter in case.iter_parameters():
        if parameter not in case.requested:
            yield path, f"{parameter} is not requested; leave it out"


def known_parameter(case: CheckedPlan) -> Iterator[Fault]:
    """The scene does not state a parameter, unless it is measured again."""
    if case.scene is None or case.remeasure:
        return
    # Where the author decides what the request asks for, also whether it asks for it again.
    again = "" if case.requested is not None else ', or mark it "again": true if R wants it anew'
    for path, parameter in case.iter_parameters():
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or not quantity.identifiable or not case.is_known(parameter):
            continue
        if parameter in case.plan.again:
            continue
        if case.is_of_its_kind(parameter):
            values = case.scene.bodies[parameter.object].known[parameter.quantity]
            stated = ", ".join(f"{value:.6g}" for value in values)
            yield (
                path,
                f"{parameter} is stated by the scene ({stated} {quantity.unit}); remove it and what "
                f"measures it{again}",
            )


def unknown_primitive(case: CheckedPlan) -> Iterator[Fault]:
    """Every node's type is a primitive or composite of the vocabulary."""
    names = [*case.words.primitives, *case.words.composites]
    for path, node in case.form.nodes.items():
        if node.type not in names:
            hint = perhaps(node.type, names) or f" valid: {', '.join(names)}"
            yield path, f"there is no '{node.type[:80]}';{hint}"


def bad_argument(case: CheckedPlan) -> Iterator[Fault]:
    """A leaf's arguments are those its primitive declares, of the declared types; composites have none."""
    strange = {name: paths for name, paths in strange_arguments(case) if len(paths) >= SEVERAL}
    for name, paths in strange.items():
        shown = ", ".join(paths[:SHOWN]) + (" …" if len(paths) > SHOWN else "")
        yield (
            paths[0],
            f"'{name[:40]}' is no argument of the {len(paths)} nodes that have it ({shown}); leave it out",
        )
    for path, node in case.form.nodes.items():
        told = {name for name, paths in strange.items() if path in paths}
        if path in case.form.refused:
            for problem in argument_problems(case, node.type, case.form.refused[path], told):
                yield path, problem
        elif node.type in case.words.composites:
            given = ", ".join(repr(key[:40]) for key, _ in node.args if key not in told)
            meant = "" if node.children else "; did you mean 'children'?"
            if given:
                yield path, f"{node.type} takes only 'children' and 'name', not {given}{meant}"


def strange_arguments(case: CheckedPlan) -> Iterable[tuple[str, list[str]]]:
    """Arguments that nodes have and do not declare, with the paths of the nodes; those of a node that
    lacks another are left out, as they may be misspelt."""
    found: dict[str, list[str]] = {}
    for path, node in case.form.nodes.items():
        refused = case.form.refused.get(path)
        names: list[str] = []
        if isinstance(refused, ValidationError):
            problems = refused.errors(include_url=False)
            if all(problem["type"] != "missing" for problem in problems):
                extra = (one for one in problems if one["type"] == "extra_forbidden")
                names = [str(one["loc"][0]) for one in extra]
        elif node.type in case.words.composites:
            names = [name for name, _ in node.args]
        for name in names:
            found.setdefault(name, []).append(path)
    return found.items()


def argument_problems(
    case: CheckedPlan, name: str, error: ValidationError | TypeError, told: Set[str] = frozenset()
) -> Iterator[str]:
    """Describe the first three arguments of a primitive that do not fit, less those `told` before."""
    if isinstance(error, TypeError):
        yield f"the arguments of {name} have no proper names"
        return
    fields = case.words.primitives[name].model_fields
    takes = ", ".join(f"'{field}' ({info.description})" for field, info in fields.items())
    every = error.errors(include_url=False)
    problems = [one for one in every if told.isdisjoint(map(str, one["loc"][:1]))][:3]
    lacking = [str(problem["loc"][0]) for problem in problems if problem["type"] == "missing"]
    # One argument too many and one missing: most likely it is misspelt.
    misspelt = len(lacking) == 1 and any(one["type"] == "extra_forbidden" for one in problems)
    for problem in problems:
        if misspelt and problem["type"] == "missing":
            continue
        where = ".".join(str(part) for part in problem["loc"])[:60]
        extra = misspelt and problem["type"] == "extra_forbidden"
        guess = f"; did you mean '{lacking[0]}'?" if extra else ""
        yield f"{name}: '{where}': {problem['msg']}{guess}; it takes {takes or 'no arguments'}"


def leaf_children(case: CheckedPlan) -> Iterator[Fault]:
    """Only composites have children."""
    for path, node in case.form.nodes.items():
        if node.type in case.words.primitives and node.children:
            yield path, f"{node.type} takes no children; put them beside it, in a Sequence"


def empty_composite(case: CheckedPlan) -> Iterator[Fault]:
    """A Sequence or Parallel has at least one child."""
    for path, node in case.form.nodes.items():
        if node.type in case.words.composites and not node.children:
            yield path, f"an empty {node.type} does nothing; give it children or remove it"


def one_owner(case: CheckedPlan) -> Iterator[Fault]:
    """At most one leaf below a Parallel moves the arm, and at most one the gripper."""
    for path, node in case.form.nodes.items():
        owned = case.form.owners(path) if node.type == "Parallel" else {}
        for resource, owners in owned.items():
            if len(owners) > 1:
                more = " …" if len(owners) > SHOWN else ""
                yield (
                    path,
                    f"{len(owners)} leaves would move the {resource} at once "
                    f"({', '.join(owners[:SHOWN])}{more}); there is one: put all but one after "
                    "another, in a Sequence",
                )


def order_of_buffers(case: CheckedPlan) -> Iterator[Fault]:
    """A conversion comes after the sensing that fills its buffer."""
    # With a scene, the walk judges this branch by branch of a Parallel.
    if case.scene is not None:
        return
    written: set[str | None] = set()
    for path, primitive in case.form.primitives.items():
        if primitive.reads and primitive.reads not in written:
            yield path, primitive.unwritten().message
        written.add(primitive.writes)


def no_explanation(case: CheckedPlan) -> Iterator[Fault]:
    """A plan without a tree says why."""
    if case.plan.tree is None and not case.plan.explanation.strip():
        yield (
            "explanation",
            "'tree' is null; say in 'explanation' what cannot be measured, and why",
        )


def promised_without_tree(case: CheckedPlan) -> Iterator[Fault]:
    """A plan without a tree promises no parameters."""
    if case.plan.tree is None and case.plan.parameters:
        promised = ", ".join(str(parameter) for parameter in case.plan.parameters)
        yield (
            "parameters",
            f"'tree' is null, yet {promised} is promised; give a tree, or leave the parameters "
            "empty and explain",
        )


# Rules on a plan as it would run: economy, restored scene, yielded parameters.


def measure_no_stated_value(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """Quantities that the scene states are not measured, unless measuring again is allowed."""
    for action, parameter in walk.conversions():
        if is_stray(parameter, case):
            yield action.path, f"{parameter} is stated by the scene; do not measure it"


def redundant(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
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


def check_touches(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
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


def parameters_not_measured(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """The tree yields every parameter."""
    for path, parameter in case.iter_parameters():
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or not quantity.identifiable or has_measurement(parameter, walk.state):
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


def gripper_at_end(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
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


def objects_displaced_at_end(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """At the end every object is back in its place."""
    for name, pose in walk.state.displaced_objects().items():
        if name != walk.state.holding:
            x, y, z = pose.position
            away = pose.distance_to(walk.state.scene.body(name).pose_world)
            yield (
                "tree",
                f"'{name}' is left at ({x:.3f}, {y:.3f}, {z:.3f}) m, {1e3 * away:.0f} mm from where it "
                f"was found; MovePose it back to '{name}_pose' before it is released for the last time",
            )


def is_stray(parameter: Parameter, case: CheckedPlan) -> bool:
    """True if the scene states a parameter that the plan does not promise."""
    asked = case.remeasure or parameter in case.plan.parameters
    return not asked and case.is_known(parameter)


def unused_recordings(case: CheckedPlan, walk: Walk) -> Iterator[WalkedAction]:
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


def recorded_piece(parameter: Parameter, action: WalkedAction) -> Piece | None:
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
