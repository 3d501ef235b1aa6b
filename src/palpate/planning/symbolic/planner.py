"""The embedded planner: grounds R, reads the gap from D, and chains a tree backwards from what it
needs.

It needs no key and no network, and it knows what it does not know.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from palpate.errors import InputError, PlanRejected
from palpate.parameter import Parameter
from palpate.planning.nodes import leaves
from palpate.planning.plan import Node, Plan
from palpate.planning.planner import needs_scene
from palpate.planning.symbolic.grounding import Grounded, ground
from palpate.planning.symbolic.mentions import GRIPPER
from palpate.planning.symbolic.search import Backchainer
from palpate.quantities.evidence import DERIVED
from palpate.quantities.quantity import QUANTITIES
from palpate.robots.kinematics import reachable
from palpate.scene.scene import Scene
from palpate.vocabulary.registry import vocabulary


@dataclass(frozen=True, slots=True)
class Assembled:
    """A tree, the gaps it yields, and one sentence for each that it cannot."""

    tree: Node | None
    measured: tuple[Parameter, ...]
    failed: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SymbolicPlanner:
    """Plans from words and geometry alone. `remeasure`: what R asks is measured even if D states
    it."""

    remeasure: bool = False
    name: str = "symbolic"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """The minimal plan for what R asks and D misses; without R, for everything D misses. Images
        are not used.

        Raises:
            InputError: no scene, empty or too long a request, or it names objects that are not
            there. PlanRejected: ambiguous, not understood, or nothing of it can be done.
        """
        if scene is None:
            raise needs_scene(self.name)
        vocabulary()  # registers the quantities that third parties measure
        asked = Grounded(scene.missing()) if request is None else ground(request, scene)
        known = [
            parameter
            for parameter in asked.asked
            if not self.remeasure and _is_known(parameter, scene)
        ]
        wanted = [parameter for parameter in asked.asked if parameter not in known]
        cannot = [*asked.cannot, *_unidentifiable(wanted)]
        made = assemble(
            scene,
            [parameter for parameter in wanted if QUANTITIES[parameter.quantity].identifiable],
        )
        if made.failed and not made.measured:
            raise PlanRejected(" ".join([*made.failed, *cannot]))
        notes = tuple(_known_note(parameter, scene) for parameter in known)
        sentences = [*asked.remarks, *_explained(made), *notes, *made.failed, *cannot]
        return Plan(
            made.measured,
            made.tree,
            " ".join(sentences) or "Nothing is missing.",
            self.name,
            (*notes, *made.failed, *(cannot if made.measured else ())),
            satisfied=not (wanted or cannot or made.failed),
        )


def requested(
    request: str | None, scene: Scene, remeasure: bool = False
) -> tuple[Parameter, ...] | None:
    """The gaps that a plan for R in this scene must measure, no more and no fewer.

    None where that is not certain: something in R is not understood or is read into it, or cannot
    be measured.
    """
    vocabulary()
    try:
        asked = Grounded(scene.missing()) if request is None else ground(request, scene)
    except (InputError, PlanRejected):
        return None
    wanted = [
        parameter
        for parameter in asked.asked
        if QUANTITIES[parameter.quantity].identifiable
        and (remeasure or not _is_known(parameter, scene))
    ]
    if asked.remarks or asked.cannot or not wanted or assemble(scene, wanted).failed:
        return None
    return tuple(wanted)


def assemble(scene: Scene, parameters: Iterable[Parameter]) -> Assembled:
    """One tree for all gaps that can be measured, those of one thing together."""
    chainer = Backchainer(scene)
    chainer.go_home()
    measured: list[Parameter] = []
    failed: list[str] = []
    surfaces_first = sorted(
        parameters, key=lambda parameter: parameter.object not in scene.surfaces
    )
    for name, group in groupby(surfaces_first, key=lambda parameter: parameter.object):
        done, reasons = _measure(chainer, name, list(group))
        measured += done
        failed += reasons
    chainer.go_home()
    return Assembled(
        chainer.tree() if measured else None, tuple(measured), tuple(dict.fromkeys(failed))
    )


def _measure(
    chainer: Backchainer, name: str, parameters: list[Parameter]
) -> tuple[list[Parameter], list[str]]:
    """As many of one thing's gaps as can be had, and why not the others."""
    reason = _obstacle(chainer.scene, name)
    if reason:
        return [], [f"{_spoken(parameters)} cannot be measured: {reason}."]
    try:
        chainer.measure(name, parameters)
        return parameters, []
    except PlanRejected as rejection:
        if len(parameters) == 1:
            return [], [f"{_spoken(parameters)} cannot be measured: {rejection}."]
    possible = [
        parameter
        for parameter in parameters
        if not _measure(Backchainer.at_home(chainer.scene), name, [parameter])[1]
    ]
    failed = [parameter for parameter in parameters if parameter not in possible]
    done, reasons = _measure(chainer, name, possible) if possible and failed else ([], [])
    return done, [*reasons, *([f"{_spoken(failed)} cannot be measured."] if failed else [])]


def _obstacle(scene: Scene, name: str) -> str:
    """Why a thing cannot be worked on at all, empty when nothing speaks against it."""
    if name == GRIPPER:
        return ""
    if name in scene.symbols.ungraspable:
        return f"'{name}' cannot be grasped: {scene.symbols.ungraspable[name]}"
    symbol = f"{name}_pose" if name in scene.objects else f"{name}_approach"
    try:
        pose = scene.symbols.resolve(symbol)
    except InputError:
        return f"there is no free spot within reach on '{name}' to touch it; give '{symbol}' in poses.yaml"
    if not reachable(scene.arm, pose, scene.pose_world_base):
        x, y, z = pose.position
        return f"'{name}' at ({x:.2f}, {y:.2f}, {z:.2f}) m is out of the arm's reach"
    mass = scene.bodies[name].known.get("mass", (0.0,))[0]
    payload = scene.arm.limits.payload
    if mass > payload:
        return f"'{name}' weighs {mass:g} kg, more than the payload of {payload:g} kg"
    return ""


def _is_known(parameter: Parameter, scene: Scene) -> bool:
    return (
        parameter.object in scene.bodies
        and parameter.quantity in scene.bodies[parameter.object].known
    )


def _known_note(parameter: Parameter, scene: Scene) -> str:
    value = ", ".join(f"{v:.6g}" for v in scene.bodies[parameter.object].known[parameter.quantity])
    quantity = QUANTITIES[parameter.quantity]
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    return (
        f"{_spoken([parameter])} is stated by the scene ({value}{unit}) and not measured again "
        "(--remeasure measures it)."
    )


def _unidentifiable(parameters: Iterable[Parameter]) -> list[str]:
    return [
        f"{_spoken([parameter])} cannot be measured: {QUANTITIES[parameter.quantity].how}."
        for parameter in parameters
        if not QUANTITIES[parameter.quantity].identifiable
    ]


def _spoken(parameters: Sequence[Parameter]) -> str:
    """The gaps in words: "The mass and sliding friction of 'mug'"."""
    labels = [QUANTITIES[parameter.quantity].label for parameter in parameters]
    listed = labels[0] if len(labels) == 1 else f"{', '.join(labels[:-1])} and {labels[-1]}"
    return f"The {listed} of '{parameters[0].object}'"


def _explained(made: Assembled) -> list[str]:
    """What is measured and how, one sentence a quantity, and what is carried out of the way."""
    if made.tree is None:
        return []
    sentences = [f"To be measured: {', '.join(str(parameter) for parameter in made.measured)}."]
    for id in dict.fromkeys(parameter.quantity for parameter in made.measured):
        names = ", ".join(
            f"'{parameter.object}'" for parameter in made.measured if parameter.quantity == id
        )
        how = QUANTITIES[id].how.removesuffix("; derived")
        derived = ", and the value is derived from the recordings" if id in DERIVED else ""
        sentences.append(f"{QUANTITIES[id].label.capitalize()} of {names}: {how}{derived}.")
    poses = [str(value) for _, leaf in leaves(made.tree) for _, value in leaf.args]
    carried = dict.fromkeys(p.removesuffix("_temporary") for p in poses if p.endswith("_temporary"))
    sentences += [
        f"'{name}' is in the way; it is carried to a free place and back." for name in carried
    ]
    return [*sentences, "Everything is put back where it was."]
