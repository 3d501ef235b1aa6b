"""Planners without a model: `symbolic`, from words and geometry, and the exhaustive baseline.

The symbolic planner grounds the request, determines the missing parameters, and chains a tree
backwards from them. It needs no key and no network. It rejects a request that it does not
understand.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.estimation.quantities.catalogue import catalogue
from palpate.estimation.quantities.within import Within
from palpate.planning.check.check import estimated_poses, unpassable_regions
from palpate.planning.check.finding import CheckedPlan
from palpate.planning.check.walk import Walk
from palpate.planning.plan import Node, Plan, UnmeasuredParameters
from palpate.planning.planner import needs_scene
from palpate.planning.request.grounding import ground
from palpate.planning.request.query import GRIPPER, Grounded
from palpate.planning.symbolic.efforts import Efforts, efforts, errand
from palpate.planning.symbolic.search import Backchainer
from palpate.planning.symbolic.steps import BALANCE, SIDEWAYS, approach
from palpate.primitives.registry import Vocabulary, acquisition, vocabulary
from palpate.primitives.rules.collision_geometry import too_far
from palpate.primitives.rules.grasp import does_not_fit, too_heavy
from palpate.primitives.rules.solids import solids
from palpate.scene.load import TEMPORARY, compute_rises, is_open
from palpate.scene.remarks import contradictions, overlap_of
from palpate.scene.scene import Scene

# Quantities of the exhaustive baseline by role: "probe heights, weigh, and test friction" in the
# paper.
SUITE = {"surface": ("height",), "object": ("mass", "friction")}


@dataclass(frozen=True, slots=True)
class AssembledPlan:
    """Assembled tree with its results."""

    tree: Node | None  # the tree; None if nothing can be measured
    measured: tuple[Parameter, ...]  # the parameters that the tree yields
    failed: tuple[UnmeasuredParameters, ...]  # the parameters that it cannot yield, with reasons
    omitted: tuple[str, ...] = ()  # a sentence for each optional recording without free space


@dataclass(frozen=True, slots=True)
class SymbolicPlanner:
    """Planner that uses words and geometry alone."""

    remeasure: bool = False  # requested values are measured even where the scene states them
    within: Within = field(default_factory=Within)  # requested widths of intervals
    # The parameters to measure; None for those of the request.
    measure: tuple[Parameter, ...] | None = None
    name: str = "symbolic"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """Make the minimal plan for the missing parameters of a request.

        Without a request, the plan covers all missing parameters of the scene. Images are not used.

        Raises:
            InputError: no scene, an empty or too long request, or unknown objects in it.
            PlanRejected: the request is ambiguous or not understood, or no parameter of it can be
                measured.
        """
        if scene is None:
            raise needs_scene(self.name)
        # Ground the request. A request without measurable parameters may still be an errand with a
        # tool.
        try:
            asked = asked_parameters(request, scene, self.measure)
        except (InputError, PlanRejected):
            carried = self._errand(request, scene)
            if carried is None:
                raise
            return carried
        if asked.cannot and not asked.asked:
            carried = self._errand(request, scene)
            if carried is not None:
                return carried
        # Separate stated values and quantities that no primitive measures.
        known, wanted = split_known(asked.asked, scene, self.remeasure)
        cannot = [UnmeasuredParameters(reason) for reason in asked.cannot]
        for parameter in wanted:
            quantity = catalogue()[parameter.quantity]
            if not quantity.identifiable:
                cannot.append(_explain_unmeasured([parameter], quantity.how))
        # Assemble a tree for the identifiable parameters and those they depend on.
        parameters = with_needs(scene, wanted)
        assembled = assemble(scene, parameters, efforts=efforts(scene, parameters, self.within))
        unmeasured = (*assembled.failed, *cannot)
        reasons = [item.reason for item in unmeasured]
        doubts = [item for item in contradictions(scene.resolved) if item not in " ".join(reasons)]
        nothing_asked = not asked.asked and scene.resolved.description.roles.untouchable
        # Reject the request if none of it can be measured.
        if not assembled.measured and (assembled.failed or nothing_asked):
            raise PlanRejected(" ".join([*reasons, *doubts]))
        # Collect the remarks: stated values, unknown heights, and contradictions in the scene.
        stated = (stated_clause(parameter, scene) for parameter in known)
        notes = [f"{clause}, and is measured again only on request." for clause in stated]
        sentences = [*asked.remarks, *explanation(assembled), *notes, *reasons]
        remarks = [*notes, *unknown_heights(assembled, scene), *doubts]
        if assembled.measured:
            remarks += reasons
        return Plan(
            parameters=assembled.measured,
            tree=assembled.tree,
            explanation=" ".join(sentences) or "Nothing is missing.",
            planner=self.name,
            notes=tuple(remarks),
            declared=None if wanted or unmeasured else "nothing_missing",
            unmeasured=unmeasured,
        )

    def _errand(self, request: str | None, scene: Scene) -> Plan | None:
        """Plan to carry a tool without a measurement; None if the request is no errand."""
        if request is None:
            return None
        task = errand(request, scene)
        if task is None:
            return None
        chainer = Backchainer(scene)
        chainer.go_home()
        chainer.hold(task.tool, task.spots)
        chainer.go_home()
        return Plan((), chainer.tree(), task.explanation, self.name)


@dataclass(frozen=True, slots=True)
class ExhaustivePlanner:
    """Baseline of the paper: task-agnostic identification of every surface and object."""

    name: str = "exhaustive"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """Measure the full suite on every body, independently of the request and of known values."""
        if scene is None:
            raise needs_scene(self.name)
        # Surfaces first, then objects, each with all quantities of its role.
        bodies = [*scene.surfaces.values(), *scene.objects.values()]
        parameters = [
            Parameter(body.name, quantity) for body in bodies for quantity in SUITE[body.role]
        ]
        assembled = assemble(scene, parameters)
        return Plan(
            assembled.measured,
            assembled.tree,
            "Every surface is probed, every object weighed and slid, known, requested or not.",
            self.name,
            tuple(p.reason for p in assembled.failed),
            unmeasured=tuple(
                p for p in assembled.failed if not set(scene.missing).isdisjoint(p.parameters)
            ),
        )


def requested_parameters(
    request: str | None,
    scene: Scene,
    remeasure: bool = False,
    measure: tuple[Parameter, ...] | None = None,
) -> tuple[Parameter, ...] | None:
    """Return the exact parameters that a plan for this request must measure; None if they are uncertain."""
    wanted = surely_requested_parameters(request, scene, remeasure, measure)
    if wanted is None or assemble(scene, wanted).failed:
        return None
    return wanted


def surely_requested_parameters(
    request: str | None,
    scene: Scene,
    remeasure: bool = False,
    measure: tuple[Parameter, ...] | None = None,
) -> tuple[Parameter, ...] | None:
    """Return the parameters of `requested_parameters`, including those that cannot be measured."""
    try:
        asked = asked_parameters(request, scene, measure)
    except (InputError, PlanRejected):
        return None
    _, unknown = split_known(asked.asked, scene, remeasure)
    wanted = with_needs(scene, unknown)
    if asked.remarks or asked.cannot or not wanted:
        return None
    return tuple(wanted)


def assemble(
    scene: Scene,
    parameters: Iterable[Parameter],
    words: Vocabulary | None = None,
    efforts: Efforts | None = None,
    mirrored: bool = False,
) -> AssembledPlan:
    """Assemble one tree for all measurable parameters, grouped by object.

    Args:
        scene, parameters: the scene, and the parameters to measure in it.
        words: the vocabulary of the tree; the installed one by default.
        efforts: effort of each parameter; the minimum by default.
        mirrored: slides go to the opposite side first, as in `Backchainer`.
    """
    words, wanted = words or vocabulary(), list(parameters)
    assembled = AssembledPlan(None, (), ())
    # The whole region of an estimated pose must pass the check. If a part fails, assemble again
    # without extras, then without balance points.
    for balances, extras in ((True, True), (True, False), (False, True)):
        assembled = _assemble_tree(
            Backchainer(scene, words, mirrored, balances, extras), wanted, efforts or {}
        )
        if assembled.tree is None:
            break
        case = CheckedPlan(Plan((), assembled.tree, ""), words, scene)
        if not estimated_poses(case) or not any(unpassable_regions(case, Walk.over(case))):
            break
    return assembled


def _assemble_tree(
    chainer: Backchainer, parameters: Iterable[Parameter], efforts: Efforts
) -> AssembledPlan:
    chainer.go_home()
    # Group the parameters by body: one grasp serves all parameters of a body.
    measured: list[Parameter] = []
    failed: list[UnmeasuredParameters] = []
    groups: dict[str, list[Parameter]] = {}
    for wanted in parameters:
        groups.setdefault(wanted.object, []).append(wanted)
    # A measured height makes the motions above that surface exact.
    for name in sorted(groups, key=lambda name: name not in chainer.scene.surfaces):
        done, reasons = _measure(chainer, name, groups[name], efforts)
        measured += done
        for reason in dict.fromkeys(reasons.values()):
            alike = [parameter for parameter in reasons if reasons[parameter] == reason]
            failed.append(_explain_unmeasured(alike, reason))
    chainer.go_home()
    tree = chainer.tree() if measured else None
    return AssembledPlan(tree, tuple(measured), tuple(failed), tuple(chainer.omitted))


def _measure(
    chainer: Backchainer, name: str, parameters: list[Parameter], efforts: Efforts
) -> tuple[list[Parameter], dict[Parameter, str]]:
    """Measure as many parameters of a body as possible; return them, and the reasons against the others."""
    reason = unusable(chainer.scene, name)
    if reason:
        return [], dict.fromkeys(parameters, reason)
    # One grasp serves all parameters of a body, so the greatest requested effort applies.
    chosen = {wanted: efforts[wanted] for wanted in parameters if wanted in efforts}
    most = max(chosen.values(), key=lambda effort: effort.cycles, default=None)
    try:
        chainer.measure(name, parameters, most)
    except PlanRejected as rejection:
        # Where bodies overlap, every way is blocked, and no motion is the cause.
        reason = str(overlap_of(chainer.scene.resolved, name) or rejection)
        if len(parameters) == 1:
            return [], dict.fromkeys(parameters, reason)
    else:
        # Repeat each parameter by the number of times in its effort.
        times = {wanted: effort.times for wanted, effort in chosen.items()}
        for count in range(2, max(times.values(), default=1) + 1):
            chainer.repeat(name, [wanted for wanted in times if times[wanted] >= count])
        return parameters, {}
    # No plan measures all of them. Find those that can be measured alone, and try these together.
    reasons: dict[Parameter, str] = {}
    for parameter in parameters:
        alone = Backchainer(chainer.scene, chainer.words)
        alone.go_home()
        reasons |= _measure(alone, name, [parameter], {})[1]
    possible = [parameter for parameter in parameters if parameter not in reasons]
    if not possible or not reasons:
        return [], reasons or dict.fromkeys(parameters, reason)
    done, others = _measure(chainer, name, possible, efforts)
    return done, {**others, **reasons}


def _explain_unmeasured(parameters: Sequence[Parameter], reason: str) -> UnmeasuredParameters:
    """Parameters of one body with a sentence that states why they cannot be measured."""
    why = reason.removesuffix(".")
    return UnmeasuredParameters(
        f"{spoken(parameters)} cannot be measured: {why}.", tuple(parameters)
    )


def unusable(scene: Scene, name: str) -> str:
    """Return the reason why a body cannot be measured at all; empty if it can.

    Tests, in order: fit between the fingers, a resolvable grasp or touch pose, reach, and payload.
    """
    if name == GRIPPER:
        return ""
    unfit = does_not_fit(scene, name)
    if unfit:
        return unfit
    # The approach pose must exist and be within reach.
    _, symbol = approach(scene, name)
    try:
        pose = scene.symbols.resolve(symbol)
    except InputError:
        return f"there is no free reachable spot to touch '{name}'; give '{symbol}' in poses.yaml"
    if not solids(scene).reaches(pose):
        return too_far(pose, name)
    return too_heavy(scene, scene.bodies[name])


def asked_parameters(
    request: str | None, scene: Scene, measure: tuple[Parameter, ...] | None = None
) -> Grounded:
    """Return the exactly named parameters, else those of the request, else all missing ones of the scene."""
    if measure is not None:
        return Grounded(measure)
    if request is None:
        return Grounded(scene.missing)
    return ground(request, scene)


def with_needs(scene: Scene, wanted: Iterable[Parameter]) -> list[Parameter]:
    """Return the identifiable parameters and those that they depend on."""
    parameters = [p for p in wanted if catalogue()[p.quantity].identifiable]
    for parameter in tuple(parameters):
        body = scene.bodies.get(parameter.object)
        if body is not None:
            parameters += catalogue()[parameter.quantity].needs(body, scene.bodies)
    return list(dict.fromkeys(parameters))


def split_known(
    parameters: Iterable[Parameter], scene: Scene, remeasure: bool
) -> tuple[list[Parameter], list[Parameter]]:
    """Split parameters into those that the scene states and those to be measured."""
    known: list[Parameter] = []
    wanted: list[Parameter] = []
    for parameter in parameters:
        body = scene.bodies.get(parameter.object)
        stated = body is not None and catalogue()[parameter.quantity].known_as() in body.known
        (known if stated and not remeasure else wanted).append(parameter)
    return known, wanted


def stated_clause(parameter: Parameter, scene: Scene) -> str:
    """Clause on a stated parameter, with its value."""
    quantity = catalogue()[parameter.quantity]
    # Stated value with its unit.
    values = scene.bodies[parameter.object].known[quantity.known_as()]
    value = ", ".join(f"{v:.6g}" for v in values)
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    return f"{spoken([parameter])} is stated by the scene ({value}{unit})"


def unknown_heights(assembled: AssembledPlan, scene: Scene) -> list[str]:
    """Notes on surfaces of unknown height that carry measured objects and are not measured."""
    sentences: list[str] = []
    for name, body in scene.surfaces.items():
        # Only a surface of unknown height that the plan does not measure is of interest.
        if not is_open(scene, name) or Parameter(name, "height") in assembled.measured:
            continue
        # Objects directly or indirectly on this surface.
        on = compute_rises(scene, name, body.top_z(), scene.body_poses)
        touched = sorted({p.object for p in assembled.measured} & on.keys() & scene.objects.keys())
        if touched:
            sentences.append(
                f"The height of '{name}' is unknown and not requested: {', '.join(map(repr, touched))} "
                "must be within 3 mm of the z in the scene; otherwise request the height too."
            )
    return sentences


def spoken(parameters: Sequence[Parameter]) -> str:
    """Name the parameters of one object in words: "The mass and sliding friction of 'mug'"."""
    labels = [catalogue()[parameter.quantity].label for parameter in parameters]
    *others, last = labels
    listed = f"{', '.join(others)} and {last}" if others else last
    return f"The {listed} of '{parameters[0].object}'"


def explanation(plan: AssembledPlan) -> list[str]:
    """Explain a plan in sentences: parameters, one method per quantity, and the objects carried away."""
    if plan.tree is None:
        return []
    sentences = [f"Measured: {', '.join(str(wanted) for wanted in plan.measured)}."]
    # One sentence per quantity, with all its objects.
    objects: dict[str, list[str]] = {}
    for parameter in plan.measured:
        objects.setdefault(parameter.quantity, []).append(f"'{parameter.object}'")
    for id, names in objects.items():
        quantity = catalogue()[id]
        how = acquisition(quantity)
        if quantity.derived:
            how = f"{quantity.how}, and the value is derived from the recordings"
        sentences.append(f"{quantity.label.capitalize()} of {', '.join(names)}: {how}.")
    # One sentence per object that is carried to a temporary place or grasped at its balance point.
    for name in visited_objects(plan.tree, TEMPORARY):
        slides = any(visited_objects(plan.tree, axis, f"{name}{TEMPORARY}") for axis in SIDEWAYS)
        reason = "is on several surfaces and slides on one" if slides else "is in the way"
        sentences.append(f"'{name}' {reason}; it is carried to a free place and back.")
    for name in visited_objects(plan.tree, BALANCE):
        sentences.append(f"'{name}' is grasped last at the balance point that the run estimates.")
    return [*sentences, *plan.omitted, "All objects are put back."]


def visited_objects(tree: Node, ending: str, start: str = "") -> Mapping[str, None]:
    """Objects that the hand visits at a pose with this name ending (and `start`), in tree order."""
    values = [str(value) for _, node in tree.walk() for _, value in node.args]
    values = [value for value in values if value.startswith(start)]
    return dict.fromkeys(v.removesuffix(ending) for v in values if v.endswith(ending))
