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

SHOWN = 4  # Maximum number of leaves in one message
SEVERAL = 3  # Minimum number of nodes with the same undeclared argument for a common message
Fault = tuple[str, str]  # Path in the plan, and message with a remedy


def unknown_parameter(case: CheckedPlan) -> Iterator[Fault]:
    """Require objects of the scene and quantities of the catalogue."""
    for path, parameter in case.iter_parameters():
        if parameter.quantity not in catalogue():
            # A synonym in a request ("weight") is a better guess than a similar spelling.
            near = catalogue().meant(parameter.quantity)
            guess = f" did you mean '{near}'?" if near else perhaps(parameter.quantity, catalogue())
            valid = ", ".join(catalogue())
            yield path, f"'{parameter.quantity[:80]}' is not a quantity;{guess} valid: {valid}"
        elif not case.exists(parameter):
            assert case.scene is not None
            valid = ", ".join(case.scene.bodies) or "none"
            guess = perhaps(parameter.object, case.scene.bodies)
            yield path, f"the scene has no '{parameter.object[:80]}';{guess} valid: {valid}"


def unmeasurable(case: CheckedPlan) -> Iterator[Fault]:
    """Require quantities that can be measured of their object."""
    for path, parameter in case.iter_parameters():
        quantity = catalogue().get(parameter.quantity)
        if quantity is None:
            continue
        # No primitive measures this quantity for any object.
        if not quantity.identifiable:
            yield (
                path,
                f"{parameter} cannot be measured: {quantity.how}; remove it and say so in the "
                "explanation",
            )
        # Some primitive measures it, but not for this kind of body.
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
    """Require that a parameter is listed once."""
    seen: set[Parameter] = set()
    for path, parameter in case.iter_parameters():
        if parameter in seen:
            yield path, f"{parameter} is listed twice; list it once"
        seen.add(parameter)


def check_request(case: CheckedPlan) -> Iterator[Fault]:
    """Require exactly the requested parameters."""
    if case.requested is None:
        return
    # Missing parameters first, then superfluous ones.
    for parameter in case.requested:
        if parameter not in case.plan.parameters:
            yield "parameters", f"{parameter} is requested and missing; measure it too"
    for path, parameter in case.iter_parameters():
        if parameter not in case.requested:
            yield path, f"{parameter} is not requested; leave it out"


def known_parameter(case: CheckedPlan) -> Iterator[Fault]:
    """Require that the scene does not state a parameter, unless it is measured again."""
    if case.scene is None or case.remeasure:
        return
    # An author who interprets the request may also decide on repeated measurements.
    again = (
        ""
        if case.requested is not None
        else ', or mark it "again": true if R requests a new measurement'
    )
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
                f"{parameter} is stated by the scene ({stated} {quantity.unit}); remove it and its "
                f"measurement{again}",
            )


def unknown_primitive(case: CheckedPlan) -> Iterator[Fault]:
    """Require a primitive or composite of the vocabulary for every node."""
    names = [*case.words.primitives, *case.words.composites]
    for path, node in case.form.nodes.items():
        if node.type not in names:
            hint = perhaps(node.type, names) or f" valid: {', '.join(names)}"
            yield path, f"there is no '{node.type[:80]}';{hint}"


def bad_argument(case: CheckedPlan) -> Iterator[Fault]:
    """Require the declared arguments and types of a leaf; composites have no arguments."""
    # Report an undeclared argument of several nodes once, at the first of them.
    strange = {name: paths for name, paths in strange_arguments(case) if len(paths) >= SEVERAL}
    for name, paths in strange.items():
        shown = ", ".join(paths[:SHOWN]) + (" …" if len(paths) > SHOWN else "")
        yield (
            paths[0],
            f"'{name[:40]}' is not an argument of {len(paths)} nodes that have it ({shown}); remove it",
        )
    # Report the other invalid arguments node by node.
    for path, node in case.form.nodes.items():
        reported = {name for name, paths in strange.items() if path in paths}
        if path in case.form.refused:
            for problem in argument_problems(case, node.type, case.form.refused[path], reported):
                yield path, problem
        elif node.type in case.words.composites:
            # A composite takes children and a name only.
            given = ", ".join(repr(key[:40]) for key, _ in node.args if key not in reported)
            guess = "" if node.children else "; did you mean 'children'?"
            if given:
                yield path, f"{node.type} takes only 'children' and 'name', not {given}{guess}"


def strange_arguments(case: CheckedPlan) -> Iterable[tuple[str, list[str]]]:
    """Return undeclared arguments with the paths of their nodes; a misspelt argument is left out."""
    paths_of: dict[str, list[str]] = {}
    for path, node in case.form.nodes.items():
        refused = case.form.refused.get(path)
        names: list[str] = []
        # A leaf: pydantic reports each undeclared argument as `extra_forbidden`.
        if isinstance(refused, ValidationError):
            problems = refused.errors(include_url=False)
            if all(problem["type"] != "missing" for problem in problems):
                extra = (problem for problem in problems if problem["type"] == "extra_forbidden")
                names = [str(problem["loc"][0]) for problem in extra]
        elif node.type in case.words.composites:
            names = [name for name, _ in node.args]
        for name in names:
            paths_of.setdefault(name, []).append(path)
    return paths_of.items()


def argument_problems(
    case: CheckedPlan,
    name: str,
    error: ValidationError | TypeError,
    reported: Set[str] = frozenset(),
) -> Iterator[str]:
    """Describe the first three invalid arguments of a primitive, except those in `reported`."""
    if isinstance(error, TypeError):
        yield f"the arguments of {name} have no valid names"
        return
    # List the declared arguments with their descriptions in every message.
    fields = case.words.primitives[name].model_fields
    takes = ", ".join(f"'{field}' ({info.description})" for field, info in fields.items())
    every = error.errors(include_url=False)
    problems = [p for p in every if reported.isdisjoint(map(str, p["loc"][:1]))][:3]
    lacking = [str(p["loc"][0]) for p in problems if p["type"] == "missing"]
    # One undeclared argument and one missing: most likely the name is misspelt.
    misspelt = len(lacking) == 1 and any(p["type"] == "extra_forbidden" for p in problems)
    for p in problems:
        if misspelt and p["type"] == "missing":
            continue
        where = ".".join(str(part) for part in p["loc"])[:60]
        extra = misspelt and p["type"] == "extra_forbidden"
        guess = f"; did you mean '{lacking[0]}'?" if extra else ""
        yield f"{name}: '{where}': {p['msg']}{guess}; it takes {takes or 'no arguments'}"


def leaf_children(case: CheckedPlan) -> Iterator[Fault]:
    """Require that only composites have children."""
    for path, node in case.form.nodes.items():
        if node.type in case.words.primitives and node.children:
            yield path, f"{node.type} takes no children; put them next to it, in a Sequence"


def empty_composite(case: CheckedPlan) -> Iterator[Fault]:
    """Require a child of every Sequence and Parallel."""
    for path, node in case.form.nodes.items():
        if node.type in case.words.composites and not node.children:
            yield path, f"an empty {node.type} has no effect; give it children or remove it"


def one_owner(case: CheckedPlan) -> Iterator[Fault]:
    """Require at most one leaf for the arm and one for the gripper below a Parallel."""
    for path, node in case.form.nodes.items():
        # Leaves below a Parallel run at the same time, so a resource has one owner.
        owned = case.form.owners(path) if node.type == "Parallel" else {}
        for resource, owners in owned.items():
            if len(owners) > 1:
                more = " …" if len(owners) > SHOWN else ""
                yield (
                    path,
                    f"{len(owners)} leaves would move the {resource} at once "
                    f"({', '.join(owners[:SHOWN])}{more}); a Parallel allows one: put the others "
                    "into a Sequence",
                )


def order_of_buffers(case: CheckedPlan) -> Iterator[Fault]:
    """Require that sensing fills a buffer before its conversion."""
    # With a scene, the walk tests this branch by branch of a Parallel.
    if case.scene is not None:
        return
    written: set[str | None] = set()
    for path, primitive in case.form.primitives.items():
        if primitive.reads and primitive.reads not in written:
            yield path, primitive.unwritten().message
        written.add(primitive.writes)


def no_explanation(case: CheckedPlan) -> Iterator[Fault]:
    """Require an explanation of a plan without a tree."""
    if case.plan.tree is None and not case.plan.explanation.strip():
        yield (
            "explanation",
            "'tree' is null; explain in 'explanation' what cannot be measured, and why",
        )


def promised_without_tree(case: CheckedPlan) -> Iterator[Fault]:
    """Require that a plan without a tree has no parameters."""
    if case.plan.tree is None and case.plan.parameters:
        promised = ", ".join(str(parameter) for parameter in case.plan.parameters)
        yield (
            "parameters",
            f"'tree' is null, but the plan has the parameters {promised}; give a tree, or no "
            "parameters and an explanation",
        )


# Rules on the run of a plan: economy, restored scene, measured parameters.


def measure_no_stated_value(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """Forbid measurements of stated quantities, unless measuring again is allowed."""
    for action, parameter in walk.conversions():
        if is_stray(parameter, case):
            yield action.path, f"{parameter} is stated by the scene; do not measure it"


def redundant(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """Require that each measurement and recording is made once and serves a parameter."""
    # Conversions: each parameter once, and only those of the plan.
    measured: set[Parameter] = set()
    for action, parameter in walk.conversions():
        if not is_stray(parameter, case):
            if parameter in measured and not case.repeated:
                yield action.path, f"{parameter} is already measured; remove this"
            elif parameter not in case.plan.parameters and not case.is_unclear:
                yield (action.path, f"this yields {parameter}, which is not a parameter; remove it")
        measured.add(parameter)
    # Recordings that serve no parameter. A slide with a finding is skipped: it will change.
    for action in unused_recordings(case, walk):
        if not walk.has_doubt_about(action.path):
            _, context = action.after.logged[-1]
            of = f"of '{context.holding}' in the hand" if context.holding else "of the empty hand"
            yield (
                action.path,
                f"no parameter needs this recording, {of}, {context.activity}, at '{context.at}'; remove it",
            )


def check_touches(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """Allow grasps of the parameters' objects, their blockers and tools; without parameters, of one named tool."""
    assert case.scene is not None
    if case.is_unclear:
        return
    # Objects of the parameters are always allowed.
    concerned = {parameter.object for parameter in case.plan.parameters}
    grasped = [(action.path, action.grasps) for action in walk.actions if action.grasps]
    if concerned:
        # A tool is held during the measurement of another object.
        allowed = concerned | {
            action.before.holding
            for action, parameter in walk.conversions()
            if action.before.holding and parameter in case.plan.parameters
        }
    else:
        # Without parameters, allow a single object that the explanation names.
        objects = {name for _, name in grasped}
        allowed = {name for name in objects if name in case.plan.explanation}
        allowed = allowed if len(objects) == 1 else set[str]()
    strange = [(path, name) for path, name in grasped if name not in allowed]
    # The search for blockers is slow: run it only if an object is in question.
    away = needed_away(case.scene, concerned) if strange else ()
    for path, name in strange:
        if name not in away:
            yield (
                path,
                f"'{name}' is not an object of the parameters and blocks none of them; do not grasp it",
            )


def parameters_not_measured(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """Require that the tree yields every parameter."""
    for path, parameter in case.iter_parameters():
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or not quantity.identifiable or has_measurement(parameter, walk.state):
            continue
        # Unknown objects and wrong kinds have findings of other rules.
        if not (case.exists(parameter) and case.is_of_its_kind(parameter)):
            continue
        # It may follow from an earlier finding, unless no action of the tree converts the quantity.
        converted = {p.measures.id for p in case.form.primitives.values() if p.measures}
        if walk.failed and (quantity.derived or quantity.id in converted):
            continue
        # Explain the missing measurement: missing recordings, or the method.
        if quantity.derived:
            missing = f"; missing recordings: {'; '.join(lacking(parameter, walk.state))}"
        else:
            missing = f"; it needs: {acquisition(quantity)}"
        yield path, f"the tree does not yield {parameter}{missing}"


def gripper_at_end(case: CheckedPlan, walk: Walk) -> Iterator[Fault]:
    """Require an empty and open gripper at the end."""
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
    """Require every object at its initial pose at the end."""
    for name, pose in walk.state.displaced_objects().items():
        if name != walk.state.holding:
            x, y, z = pose.position
            away = pose.distance_to(walk.state.scene.body(name).pose_world)
            yield (
                "tree",
                f"'{name}' is left at ({x:.3f}, {y:.3f}, {z:.3f}) m, {1e3 * away:.0f} mm from its original "
                f"place; MovePose it back to '{name}_pose' before its last release",
            )


def is_stray(parameter: Parameter, case: CheckedPlan) -> bool:
    """True if the scene states a parameter that is not in the plan."""
    asked = case.remeasure or parameter in case.plan.parameters
    return not asked and case.is_known(parameter)


def unused_recordings(case: CheckedPlan, walk: Walk) -> Iterator[WalkedAction]:
    """Yield the sensing leaves that neither a conversion nor a derived parameter needs."""
    # A conversion reads the latest recording visible in its branch of the tree.
    paths = {id(action.after.logged[-1]): action.path for action in walk.actions if action.records}
    converted: set[str | None] = set()
    for action in walk.actions:
        if action.primitive.measures is not None:
            read = [entry for entry in action.before.logged if entry[0] == action.primitive.reads]
            converted.add(paths.get(id(read[-1])) if read else None)
    # Evidence that duplicates an earlier recording does not count.
    seen: set[tuple[Parameter, Piece]] = set()
    for action in walk.actions:
        if not action.records:
            continue
        evidence: set[tuple[Parameter, Piece]] = set()
        # Collect the evidence that this recording gives to any parameter.
        for parameter in case.plan.parameters:
            piece = recorded_piece(parameter, action)
            if piece is not None:
                evidence.add((parameter, piece))
        if action.path not in converted and evidence <= seen:
            yield action
        if not case.repeated:
            seen |= evidence


def recorded_piece(parameter: Parameter, action: WalkedAction) -> Piece | None:
    """Return the evidence that an action records for a parameter of several or derived recordings, or None."""
    logged = action.after.logged[-1]
    quantity = catalogue().get(parameter.quantity)
    if quantity is None:
        return None
    # A single recording is judged by its conversion instead.
    piece = quantity.piece(parameter, *logged)
    if piece is None or quantity.derived or quantity.evidence[piece[0]].distinct is not None:
        return piece
    return None
