"""Estimates into the user's own MJCF text: a minimal change that leaves every other byte alone.

What is written where, each quantity says (`palpate.scene.resolve`); every estimate is also recorded in
`<custom>` (`palpate.twin.records`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.estimation.estimate import Estimate, Part, rounded
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.defaults import INHERITED, unknowns_replaced
from palpate.mjcf.document import Element, Texts, elements, has_unknown, tokens
from palpate.mjcf.edits import Change, Edit, number
from palpate.mjcf.reading import parse_document
from palpate.parameter import Parameter
from palpate.quantities.catalogue import Catalogue, catalogue
from palpate.quantities.quantity import Quantity, Values
from palpate.scene.describe import Description, describe
from palpate.scene.poses import Poses
from palpate.scene.raised import at_heights
from palpate.scene.resolve import changes
from palpate.scene.scene import Scene
from palpate.twin.one_text import in_one
from palpate.twin.reading import misread
from palpate.twin.records import as_text, recorded
from palpate.twin.rewrite import rewritten


def inject(
    text: str, values: Values, records: Sequence[Estimate] = (), folder: Path | None = None
) -> str:
    """The MJCF with `values` in it and `records` in its `<custom>`; nothing else changes.

    A `?` that `values` does not answer stays; see `unfilled`. `folder` is where relative file names
    start. Where a value belongs into an included file, the content of all of them takes the place of
    the `<include>`s.

    Raises:
        InputError: not a usable scene, or a value that has no place in it.
    """
    description = describe(parse_document(text, folder), Poses(), catalogue())
    texts = _injected(description, catalogue(), values, records)
    std = _deviations(records)
    for parameter, reason in misread(description, texts, values, std, catalogue()):
        raise InputError(f"{parameter} cannot be stated in this file: {reason}")
    made = in_one(description.document, texts)
    if made.beside:
        raise InputError(
            "what is stated belongs into attached models, which are files of their own"
        )
    return made.main


@dataclass(frozen=True, slots=True)
class Completed:
    """The texts of a twin.

    Attributes:
        notes: remarks: what could not be written, and which `?` nobody measured and now hold a
            prior.
        unwritten: what was measured of objects and surfaces and is not in it.
    """

    texts: Texts
    notes: tuple[str, ...]
    unwritten: tuple[Parameter, ...]


def complete(
    scene: Scene, estimates: Sequence[Estimate], asked: Collection[Parameter] = ()
) -> Completed:
    """The scene's texts with the estimates in them, as MuJoCo reads them back. What an estimate says
    in passing of a quantity that was `asked` for is not written in the place of its own estimate."""
    estimates = [_in_its_place(estimate, scene.catalogue) for estimate in estimates]
    values, notes = _values(scene, estimates, asked)
    description = _without_poses(scene)
    marked = _marked(description, scene.catalogue)
    reasons: dict[Parameter, str] = {}
    for parameter in values:
        if reason := _unfit(scene, parameter, values, marked):
            reasons[parameter] = reason
    fitting = _but_for(values, reasons)
    texts, filled = _filled(scene, description, marked, fitting, estimates)
    wrong = dict(_misread(scene, texts, fitting, estimates))
    if wrong:
        reasons |= wrong
        fitting = _but_for(fitting, wrong)
        texts, filled = _filled(scene, description, marked, fitting, estimates)
    for parameter, reason in reasons.items():
        notes.append(f"{parameter} is not in the twin: {reason}")
    for parameter in marked:
        if parameter not in fitting:
            held = f"the twin holds the assumed value {as_text(filled[parameter])}"
            notes.append(f"{parameter} was not measured; {held}")
    if _keyframes_state_places(scene, fitting):
        notes.append("the keyframes state places of their own, which were left as they are")
    unwritten = tuple(parameter for parameter in reasons if parameter.object in scene.bodies)
    return Completed(texts, tuple(notes), unwritten)


def _values(
    scene: Scene, estimates: Sequence[Estimate], asked: Collection[Parameter]
) -> tuple[dict[Parameter, tuple[float, ...]], list[str]]:
    """Values to be written, and remarks on the others."""
    values: dict[Parameter, tuple[float, ...]] = {}
    for estimate in estimates:
        values[estimate.parameter] = tuple(estimate.values.tolist())
    notes: list[str] = []
    for parameter, found in _found_besides(scene, estimates):
        if parameter not in values and parameter not in asked:
            values[parameter] = tuple(part.value for part in found)
            held = f"the twin holds {_told(found)}, found besides"
            notes.append(f"{parameter} was not asked for; {held}")
    return values, notes


def _but_for(values: Values, without: Collection[Parameter]) -> dict[Parameter, tuple[float, ...]]:
    """The values of all other parameters."""
    return {parameter: value for parameter, value in values.items() if parameter not in without}


def _keyframes_state_places(scene: Scene, values: Values) -> bool:
    """True if something was found to stand elsewhere that a keyframe places, too."""
    moved = {"position", "height"} & {parameter.quantity for parameter in values}
    keys = scene.resolved.document.root.iterfind("keyframe/key")
    return bool(moved) and any(key.get("qpos") for key in keys)


def _in_its_place(estimate: Estimate, quantities: Catalogue) -> Estimate:
    """Estimate as one of the quantity that the file states in its place."""
    name, quantity = estimate.parameter.object, quantities.get(estimate.parameter.quantity)
    if quantity is None or quantity.stands_for is None:
        return estimate
    return replace(estimate, parameter=Parameter(name, quantity.stands_for))


def _filled(
    scene: Scene,
    description: Description,
    marked: Sequence[Parameter],
    fitting: Values,
    estimates: Sequence[Estimate],
) -> tuple[Texts, Values]:
    """The texts with `fitting` in it and beliefs for the rest of what is `marked`; all of these."""
    unmeasured = {p: scene.priors[p] for p in marked if p not in fitting}
    filled = scene.resolved.completed(unmeasured, fitting)
    records = [estimate for estimate in estimates if estimate.parameter in fitting]
    moved = tuple(_moved_along(scene, description, fitting, records))
    return _injected(description, scene.catalogue, filled, records, moved), filled


def _moved_along(
    scene: Scene, description: Description, values: Values, records: Sequence[Estimate]
) -> Iterator[Edit]:
    """The z of each object that stands on a surface of measured height. An open z follows by itself
    (`Position.follows`), and a z of the poses belongs to the poses."""
    heights = {
        parameter.object: parameter for parameter in values if parameter.quantity == "height"
    }
    std = min((_deviations(records)[one] for one in heights.values()), default=None)
    for name, rise in at_heights(scene, values).rises.items():
        body = description.bodies[name]
        element = body.elements.element
        if body.role == "surface" or scene.resolved.description.bodies[name].given is not None:
            continue
        if has_unknown(element, "pos", 2) or body.elements.moved_by() is not None:
            continue
        z = float(tokens(element.get("pos") or "0 0 0")[2]) + rise
        yield Edit(element, "pos", {2: number(z, std)}, "0 0 0")


def _misread(
    scene: Scene, texts: Texts, values: Values, estimates: Sequence[Estimate]
) -> Iterator[tuple[Parameter, str]]:
    """Values that MuJoCo does not read back; empty for a file that it does not accept."""
    before, std = scene.resolved.description, _deviations(estimates)
    try:
        yield from misread(before, texts, values, std, scene.catalogue)
    except InputError as error:
        for parameter in values:
            yield parameter, str(error)


def _found_besides(
    scene: Scene, estimates: Sequence[Estimate]
) -> Iterator[tuple[Parameter, Sequence[Part]]]:
    """Missing quantities of which another's estimate says a value in passing: the mass of an object
    whose centre of mass was asked for; of a vector, all its components, `com x` and so on."""
    for estimate in estimates:
        body = scene.bodies.get(estimate.parameter.object)
        for name in sorted(body.missing) if body is not None else ():
            size = scene.catalogue[name].size
            names = [name] if size == 1 else [f"{name} {axis}" for axis in "xyz"[:size]]
            found = [estimate.parts[one] for one in names if one in estimate.parts]
            if len(found) == size:
                yield Parameter(estimate.parameter.object, name), found


def _told(found: Sequence[Part]) -> str:
    """`0.3410 ± 0.0010 kg`, or several in brackets."""
    told: list[str] = []
    for part in found:
        value, std = rounded(part.value, part.std)
        told.append(f"{value} ± {std}")
    text = told[0] if len(told) == 1 else f"({', '.join(told)})"
    return f"{text} {found[0].unit or ''}".rstrip()


def unfilled(text: str, folder: Path | None = None) -> list[Parameter]:
    """Attributes written `?` that must be filled before MuJoCo reads the file, in document order."""
    return _marked(describe(parse_document(text, folder), Poses(), catalogue()), catalogue())


def _without_poses(scene: Scene) -> Description:
    """The scene's file without the poses that came with it, which the twin's text leaves out."""
    if not scene.resolved.description.placed:
        return scene.resolved.description
    return describe(scene.resolved.document, Poses(), scene.catalogue)


def _marked(description: Description, quantities: Catalogue) -> list[Parameter]:
    """Parameters that are missing and written `?`, so that the file does not compile without them."""
    found: list[Parameter] = []
    for body in description.bodies.values():
        for quantity in sorted(quantities.of(body.role), key=lambda quantity: quantity.id):
            if _is_marked(body, quantity):
                found.append(Parameter(body.name, quantity.id))
    return found


def _is_marked(body: BodyDescription, quantity: Quantity) -> bool:
    if quantity.status(body) != "missing":
        return False
    for slot in quantity.slots(body.elements):
        if slot.open_numbers(body.defaults.attribute(slot.element, slot.attribute)):
            return True
    return False


def _unfit(scene: Scene, parameter: Parameter, values: Values, marked: Sequence[Parameter]) -> str:
    """Reason why a value cannot be written together with the others, or None."""
    others = dict(values)
    for unknown in marked:
        others.setdefault(unknown, scene.priors[unknown])
    del others[parameter]
    try:
        scene.resolved.changes({parameter: values[parameter]}, others)
    except InputError as error:
        return str(error)
    return ""


def _injected(
    description: Description,
    quantities: Catalogue,
    values: Values,
    records: Sequence[Estimate],
    moved: Sequence[Edit] = (),
) -> Texts:
    edits = list(changes(description.bodies, quantities, values, {}, _deviations(records)))
    edits += moved
    edits += _leftovers(description, quantities, values, edits)
    texts = rewritten(description.document, edits)
    return replace(texts, main=recorded(texts.main, records))


def _deviations(records: Sequence[Estimate]) -> dict[Parameter, float]:
    """The smallest standard deviation of each, which decides how many digits are written."""
    return {record.parameter: float(min(record.stds)) for record in records if record.has_value}


def _leftovers(
    description: Description, quantities: Catalogue, values: Values, edits: Sequence[Change]
) -> Iterator[Edit]:
    """A `?` that no longer means anything once every mass, or friction, is known: in a defaults
    class, mostly."""
    answered: set[tuple[Element, str]] = set()
    for edit in edits:
        if isinstance(edit, Edit):
            answered.add((edit.element, edit.attribute))
    needed: set[str] = set()
    for parameter in _marked(description, quantities):
        if parameter not in values:
            body = description.bodies[parameter.object]
            for slot in quantities[parameter.quantity].slots(body.elements):
                needed.add(slot.attribute)
    for geom in elements(description.document.root):
        for leftover in unknowns_replaced(geom, INHERITED):
            is_answered = (geom, leftover.attribute) in answered
            if geom.tag == "geom" and leftover.attribute not in needed and not is_answered:
                yield leftover
