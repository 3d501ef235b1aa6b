"""The embedded planner: grounds the request, reads what the scene misses, and chains a tree
backwards from what it needs.

It needs no key and no network, and it knows what it does not know.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from palpate.errors import InputError, PlanRejected
from palpate.parameter import Parameter
from palpate.planning.check.case import Case, Form
from palpate.planning.check.finding import Finding
from palpate.planning.check.regions import found_out, somewhere
from palpate.planning.check.walk import Walk
from palpate.planning.nodes import leaves
from palpate.planning.plan import Node, Plan
from palpate.planning.planner import needs_scene
from palpate.planning.request.grounding import Grounded, ground
from palpate.planning.request.item import GRIPPER
from palpate.planning.symbolic.passes import Efforts, efforts
from palpate.planning.symbolic.places import BALANCE
from palpate.planning.symbolic.search import Backchainer
from palpate.planning.symbolic.steps import TEMPORARY
from palpate.quantities.catalogue import catalogue
from palpate.quantities.quantity import Effort
from palpate.quantities.within import Within
from palpate.robots.kinematics import reachable
from palpate.scene.raised import is_open, risen
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.grasp import does_not_fit, too_heavy
from palpate.vocabulary.admissible.reach import too_far
from palpate.vocabulary.registry import Vocabulary, acquisition, vocabulary


@dataclass(frozen=True, slots=True)
class Assembled:
    """A tree, the parameters it yields, and one sentence for each that it cannot, and for what there is no room
    for."""

    tree: Node | None
    measured: tuple[Parameter, ...]
    failed: tuple[str, ...]
    spared: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SymbolicPlanner:
    """Plans from words and geometry alone.

    Attributes:
        remeasure: what the request asks is measured even if the scene states it.
        within: how narrow intervals are to be.
    """

    remeasure: bool = False
    within: Within = field(default_factory=Within)
    name: str = "symbolic"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """The minimal plan for what the request asks and the scene misses; without a request, for
        everything it misses. Images are not used.

        Raises:
            InputError: no scene, empty or too long a request, or it names objects that are not
            there.
            PlanRejected: ambiguous, not understood, or nothing of it can be done.
        """
        if scene is None:
            raise needs_scene(self.name)
        asked = _asked(request, scene)
        known, wanted = _known_apart(asked.asked, scene, self.remeasure)
        cannot = [*asked.cannot, *_unidentifiable(wanted)]
        found = _with_needs(scene, _identifiable(wanted))
        made = assemble(scene, found, efforts=efforts(scene, found, self.within))
        if made.failed and not made.measured:
            raise PlanRejected(" ".join([*made.failed, *cannot]))
        notes = [_known_note(parameter, scene) for parameter in known]
        sentences = [*asked.remarks, *_explained(made), *notes, *made.failed, *cannot]
        remarks = [*notes, *_guessed(made, scene), *made.failed]
        if made.measured:
            remarks += cannot
        return Plan(
            parameters=made.measured,
            tree=made.tree,
            explanation=" ".join(sentences) or "Nothing is missing.",
            planner=self.name,
            notes=tuple(remarks),
            declared=None if wanted or cannot or made.failed else "nothing_missing",
        )


def requested(
    request: str | None, scene: Scene, remeasure: bool = False
) -> tuple[Parameter, ...] | None:
    """The parameters that a plan for the request in this scene must measure, no more and no fewer.

    None where that is not certain: something in the request is not understood or is read into it,
    or cannot be measured.
    """
    try:
        asked = _asked(request, scene)
    except (InputError, PlanRejected):
        return None
    _, unknown = _known_apart(asked.asked, scene, remeasure)
    wanted = _with_needs(scene, _identifiable(unknown))
    if asked.remarks or asked.cannot or not wanted or assemble(scene, wanted).failed:
        return None
    return tuple(wanted)


def assemble(
    scene: Scene,
    parameters: Iterable[Parameter],
    words: Vocabulary | None = None,
    efforts: Efforts | None = None,
    mirrored: bool = False,
) -> Assembled:
    """One tree of `words` for all parameters that can be measured, those of one thing together, each
    with the effort that it takes; `mirrored` as in `Backchainer`. Poses that a run finds out are taken
    where the whole of their regions passes the check."""
    words, wanted = words or vocabulary(), list(parameters)
    made = Assembled(None, (), ())
    for finds_out, extras in ((True, True), (True, False), (False, True)):
        chainer = Backchainer(scene, words, mirrored, finds_out, extras)
        made = _assembled(chainer, wanted, efforts or {})
        if made.tree is None or not any(_refused(made.tree, words, scene)):
            break
    return made


def _refused(tree: Node, words: Vocabulary, scene: Scene) -> Iterator[Finding]:
    """Findings on poses that a run estimates."""
    case = Case(Plan((), tree, ""), Form.of(tree, words), words, scene)
    if found_out(case):
        yield from somewhere(case, Walk.over(tree, case.form, words, scene))


def _assembled(
    chainer: Backchainer, parameters: Iterable[Parameter], efforts: Efforts
) -> Assembled:
    scene = chainer.scene
    chainer.go_home()
    measured: list[Parameter] = []
    failed: list[str] = []
    surfaces_first = sorted(parameters, key=lambda wanted: wanted.object not in scene.surfaces)
    for name, group in groupby(surfaces_first, key=lambda wanted: wanted.object):
        done, reasons = _measure(chainer, name, list(group), efforts)
        measured += done
        failed += reasons
    chainer.go_home()
    tree = chainer.tree() if measured else None
    return Assembled(tree, tuple(measured), tuple(dict.fromkeys(failed)), tuple(chainer.spared))


def _with_needs(scene: Scene, wanted: Sequence[Parameter]) -> list[Parameter]:
    """Requested parameters with those that they depend on."""
    found = list(wanted)
    for parameter in wanted:
        body = scene.bodies.get(parameter.object)
        if body is not None:
            found += catalogue()[parameter.quantity].needs(body, scene.bodies)
    return list(dict.fromkeys(found))


def _asked(request: str | None, scene: Scene) -> Grounded:
    """Parameters of the request; without one, all that the scene misses."""
    if request is None:
        return Grounded(scene.missing)
    return ground(request, scene)


def _known_apart(
    parameters: Iterable[Parameter], scene: Scene, remeasure: bool
) -> tuple[list[Parameter], list[Parameter]]:
    """Split into parameters that the scene states, and those to be measured."""
    known: list[Parameter] = []
    wanted: list[Parameter] = []
    for parameter in parameters:
        if _is_known(parameter, scene) and not remeasure:
            known.append(parameter)
        else:
            wanted.append(parameter)
    return known, wanted


def _measure(
    chainer: Backchainer, name: str, parameters: list[Parameter], efforts: Efforts
) -> tuple[list[Parameter], list[str]]:
    """Measure as many parameters of a body as possible; return them, and the reasons against the
    others."""
    reason = _obstacle(chainer.scene, name)
    if reason:
        return [], [f"{_spoken(parameters)} cannot be measured: {reason}."]
    try:
        chainer.measure(name, parameters, _effort(parameters, efforts))
    except PlanRejected as rejection:
        if len(parameters) == 1:
            return [], [f"{_spoken(parameters)} cannot be measured: {rejection}."]
    else:
        _again(chainer, name, parameters, efforts)
        return parameters, []
    # Together they cannot be had: those that can be had alone are tried once more.
    possible, impossible = _possible_apart(chainer, name, parameters)
    failed = [f"{_spoken(impossible)} cannot be measured."] if impossible else []
    if not possible or not impossible:
        return [], failed
    done, reasons = _measure(chainer, name, possible, efforts)
    return done, [*reasons, *failed]


def _again(
    chainer: Backchainer, name: str, parameters: Sequence[Parameter], efforts: Efforts
) -> None:
    """Measure those of one thing anew that are to be measured several times."""
    times = {wanted: efforts[wanted].times for wanted in parameters if wanted in efforts}
    for count in range(2, max(times.values(), default=1) + 1):
        chainer.measure_anew(name, [wanted for wanted in times if times[wanted] >= count])


def _effort(parameters: Iterable[Parameter], efforts: Efforts) -> Effort | None:
    """The most that any of them takes."""
    found = [efforts[parameter] for parameter in parameters if parameter in efforts]
    return max(found, key=lambda effort: effort.cycles, default=None)


def _possible_apart(
    chainer: Backchainer, name: str, parameters: Iterable[Parameter]
) -> tuple[list[Parameter], list[Parameter]]:
    """Split into parameters that can be measured on their own, and the others."""
    possible: list[Parameter] = []
    impossible: list[Parameter] = []
    for parameter in parameters:
        alone = Backchainer.at_home(chainer.scene, chainer.words)
        _, reasons = _measure(alone, name, [parameter], {})
        if reasons:
            impossible.append(parameter)
        else:
            possible.append(parameter)
    return possible, impossible


def _obstacle(scene: Scene, name: str) -> str:
    """Reason why a body cannot be worked on at all; empty if there is none."""
    if name == GRIPPER:
        return ""
    unfit = does_not_fit(scene, name)
    if unfit:
        return unfit
    symbol = f"{name}_pose" if name in scene.objects else f"{name}_approach"
    try:
        pose = scene.symbols.resolve(symbol)
    except InputError:
        return f"there is no free spot within reach on '{name}' to touch it; give '{symbol}' in poses.yaml"
    if not reachable(scene.arm, pose, scene.pose_world_base):
        return too_far(pose, name)
    return too_heavy(scene, scene.bodies[name])


def _is_known(parameter: Parameter, scene: Scene) -> bool:
    body = scene.bodies.get(parameter.object)
    return body is not None and catalogue()[parameter.quantity].known_as() in body.known


def _known_note(parameter: Parameter, scene: Scene) -> str:
    quantity = catalogue()[parameter.quantity]
    stated = scene.bodies[parameter.object].known[quantity.known_as()]
    value = ", ".join(f"{v:.6g}" for v in stated)
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    return (
        f"{_spoken([parameter])} is stated by the scene ({value}{unit}) and not measured again "
        "unless it is to be remeasured."
    )


def _guessed(made: Assembled, scene: Scene) -> list[str]:
    """Notes on surfaces of unknown height that the plan leaves unmeasured below measured objects."""
    sentences: list[str] = []
    for name, body in scene.surfaces.items():
        if not is_open(scene, name) or Parameter(name, "height") in made.measured:
            continue
        on = risen(scene, name, body.top_z(), lambda other: scene.bodies[other].pose_world)
        touched = sorted({one.object for one in made.measured} & on.keys() & scene.objects.keys())
        if touched:
            sentences.append(
                f"The height of '{name}' is unknown and not asked for: {', '.join(map(repr, touched))} "
                "must stand within 3 mm of the z in the scene; else ask for the height, too."
            )
    return sentences


def _identifiable(parameters: Iterable[Parameter]) -> list[Parameter]:
    return [wanted for wanted in parameters if catalogue()[wanted.quantity].identifiable]


def _unidentifiable(parameters: Iterable[Parameter]) -> list[str]:
    """Notes on parameters that the vocabulary cannot measure at all."""
    sentences: list[str] = []
    for parameter in parameters:
        quantity = catalogue()[parameter.quantity]
        if not quantity.identifiable:
            sentences.append(f"{_spoken([parameter])} cannot be measured: {quantity.how}.")
    return sentences


def _spoken(parameters: Sequence[Parameter]) -> str:
    """The parameters of one object in words: "The mass and sliding friction of 'mug'"."""
    labels = [catalogue()[parameter.quantity].label for parameter in parameters]
    *others, last = labels
    listed = f"{', '.join(others)} and {last}" if others else last
    return f"The {listed} of '{parameters[0].object}'"


def _explained(made: Assembled) -> list[str]:
    """Explanation: measured parameters and methods, a sentence per quantity, and objects carried
    out of the way."""
    if made.tree is None:
        return []
    sentences = [f"To be measured: {', '.join(str(wanted) for wanted in made.measured)}."]
    objects: dict[str, list[str]] = {}
    for parameter in made.measured:
        objects.setdefault(parameter.quantity, []).append(f"'{parameter.object}'")
    for id, names in objects.items():
        sentences.append(_acquired(id, names))
    for name in _visited(made.tree, TEMPORARY):
        sentences.append(f"'{name}' is in the way; it is carried to a free place and back.")
    for name in _visited(made.tree, BALANCE):
        sentences.append(f"'{name}' is grasped last where the run finds it to balance.")
    return [*sentences, *made.spared, "Everything is put back where it was."]


def _acquired(id: str, names: Sequence[str]) -> str:
    """Method for a quantity of the named objects."""
    quantity = catalogue()[id]
    how = acquisition(quantity)
    if quantity.derived:
        how = f"{quantity.how}, and the value is derived from the recordings"
    return f"{quantity.label.capitalize()} of {', '.join(names)}: {how}."


def _visited(tree: Node, ending: str) -> list[str]:
    """The objects to whose pose with a name of that ending the hand goes, in the order of the tree."""
    visited: dict[str, None] = {}
    for _, leaf in leaves(tree):
        for _, value in leaf.args:
            name = str(value).removesuffix(ending)
            if name != str(value):
                visited[name] = None
    return list(visited)
