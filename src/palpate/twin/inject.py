"""Injection of estimates into the user's own MJCF text.

The change is minimal: every other byte stays, and MuJoCo reads the values back. Each quantity
declares where its value is written (`palpate.scene.resolve`). Every estimate is also recorded in
`<custom>`.

Other parts of a file can overrule a number: `settotalmass`, the mass computation of a mesh, a
second geom, a defaults class. A value that MuJoCo does not read back is not in the twin.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, axes_of, round_to_std
from palpate.estimation.quantities.catalogue import Catalogue, catalogue
from palpate.estimation.quantities.quantity import Values
from palpate.mjcf.document import Element, Texts, elements, has_unknown, tokens
from palpate.mjcf.edits import Change, Edit, number
from palpate.mjcf.elements import INHERITED, replace_unknowns
from palpate.mjcf.reading import parse_document, reparse
from palpate.scene.describe import Description, describe
from palpate.scene.load import at_heights
from palpate.scene.poses import Poses
from palpate.scene.resolve import changes
from palpate.scene.scene import Scene
from palpate.twin.files import one_text
from palpate.twin.text import as_text, rewrite, write_records

# Relative tolerance: single precision of meshes, and seven digits of shares that add up to a value.
ROUNDED = 1e-5
# Standard deviations: the resolution of a written value is a tenth of its deviation.
DIGITS = 0.1
# Standard deviations: tolerance where one number states several components, as the radius of a
# round object.
SHARED_TOLERANCE = 1.0


def inject(
    text: str, values: Values, records: Sequence[Estimate] = (), folder: Path | None = None
) -> str:
    """Write `values` into the MJCF and `records` into its `<custom>`, without any other change.

    A `?` without a value stays; see `unfilled_unknowns`. Relative file names start at `folder`. If
    a value belongs into an included file, the contents of all included files replace the
    `<include>`s. Raises InputError: not a usable scene, or a value that has no place in it.
    """
    # Write the values, and require that MuJoCo reads them back.
    description = describe(parse_document(text, folder), Poses(), catalogue())
    texts = _inject_values(description, catalogue(), values, records)
    std = deviations(records)
    for parameter, reason in iter_misread(description, texts, values, std, catalogue()):
        raise InputError(f"{parameter} cannot be stated in this file: {reason}")
    document = description.document
    if texts.parts.keys() - set(document.includes.values()):
        raise InputError("the values belong to attached models, which are separate files")
    return one_text(document, texts)


def unfilled_unknowns(text: str, folder: Path | None = None) -> list[Parameter]:
    """List the `?` attributes that must be filled before MuJoCo reads the file, in document order."""
    return list_unknowns(describe(parse_document(text, folder), Poses(), catalogue()), catalogue())


@dataclass(frozen=True, slots=True)
class CompletedTexts:
    """Texts of a twin.

    Attributes:
        texts: with the values.
        notes: values that could not be written, and each `?` that was not measured and now holds a
            prior.
        unwritten: measured parameters of objects and surfaces that are not in it.
    """

    texts: Texts
    notes: tuple[str, ...]
    unwritten: tuple[Parameter, ...]


def complete(
    scene: Scene, estimates: Sequence[Estimate], asked: Collection[Parameter] = ()
) -> CompletedTexts:
    """Write the estimates into the scene's texts, as far as MuJoCo reads them back.

    A missing quantity that is a part of another estimate is written as well, unless it was `asked`
    for.
    """
    quantities, resolved = scene.catalogue, scene.resolved
    stated = [
        replace(each, parameter=stated_parameter(each.parameter, quantities)) for each in estimates
    ]
    values, notes = values_to_write(scene, stated, asked)

    # The twin's text leaves out the poses that came with the scene.
    description = resolved.description
    if description.placed:
        description = describe(resolved.document, Poses(), quantities)
    marked = list_unknowns(description, quantities)
    # Test each value against the others, then all of them as MuJoCo reads them back.
    reasons: dict[Parameter, str] = {}
    for parameter in values:
        if reason := find_conflict(scene, parameter, values, marked):
            reasons[parameter] = reason
    fitting = {parameter: value for parameter, value in values.items() if parameter not in reasons}
    texts, filled = _fill_unknowns(scene, description, marked, fitting, stated)
    try:
        std = deviations(stated)
        wrong = dict(iter_misread(resolved.description, texts, fitting, std, quantities))
    except InputError as error:  # MuJoCo does not accept the file
        wrong = dict.fromkeys(fitting, str(error))
    if wrong:
        # Write the remaining values again without the wrong ones.
        reasons |= wrong
        fitting = {p: value for p, value in fitting.items() if p not in wrong}
        texts, filled = _fill_unknowns(scene, description, marked, fitting, stated)

    # Note the values that are not in the twin, and the priors that it holds instead.
    for parameter, reason in reasons.items():
        notes.append(f"{parameter} is not in the twin: {reason}")
    for parameter in marked:
        if parameter not in fitting:
            has_verdict = parameter in reasons or parameter in asked
            what = ":" if has_verdict else " was not measured;"
            note = f"the twin holds the assumed value {as_text(filled[parameter])}"
            notes.append(f"{parameter}{what} {note}")
    # Keyframes state whole poses, which stay.
    is_moved = any(parameter.quantity in ("position", "height") for parameter in fitting)
    if is_moved and any(key.get("qpos") for key in resolved.document.root.iterfind("keyframe/key")):
        notes.append("the keyframes keep their stated poses")
    unwritten = tuple(parameter for parameter in reasons if parameter.object in scene.bodies)
    return CompletedTexts(texts, tuple(notes), unwritten)


def part_names(quantity: str, size: int) -> list[str]:
    """Names of a quantity's components as parts of another estimate: `mass`, or `com x` and so on."""
    return [f"{quantity} {axis}".strip() for axis in axes_of(size)]


def stated_parameter(parameter: Parameter, quantities: Catalogue) -> Parameter:
    """Convert to the parameter that the file states: `com` for `com_3d`."""
    quantity = quantities.get(parameter.quantity)
    if quantity is None or quantity.stands_for is None:
        return parameter
    return Parameter(parameter.object, quantity.stands_for)


def values_to_write(
    scene: Scene, estimates: Sequence[Estimate], asked: Collection[Parameter]
) -> tuple[dict[Parameter, tuple[float, ...]], list[str]]:
    """Collect the values to write, requested or missing parts of another estimate, and remarks on the latter."""
    # Requested estimates first, then parts that fill gaps.
    values: dict[Parameter, tuple[float, ...]] = {}
    for estimate in estimates:
        values[estimate.parameter] = tuple(estimate.values.tolist())
    notes: list[str] = []
    for estimate in estimates:
        body = scene.bodies.get(estimate.parameter.object)
        for name in sorted(body.missing) if body is not None else ():
            parameter, size = Parameter(estimate.parameter.object, name), scene.catalogue[name].size
            # A vector needs all its components.
            names = part_names(name, size)
            parts = [estimate.parts[part] for part in names if part in estimate.parts]
            if len(parts) < size or parameter in values or parameter in asked:
                continue
            values[parameter] = tuple(part.value for part in parts)
            written = [" ± ".join(round_to_std(part.value, part.std)) for part in parts]
            text = written[0] if size == 1 else f"({', '.join(written)})"
            note = f"the twin holds {text} {parts[0].unit or ''}".rstrip()
            notes.append(f"{parameter} was not requested; {note}, from {estimate.parameter}")
    return values, notes


def list_unknowns(description: Description, quantities: Catalogue) -> list[Parameter]:
    """List the missing parameters written as `?`, without which the file does not compile."""
    parameters: list[Parameter] = []
    for body in description.bodies.values():
        for quantity in sorted(quantities.of(body.role), key=lambda quantity: quantity.id):
            if quantity.status(body) == "missing" and any(
                slot.open_numbers(body.defaults.attribute(slot.element, slot.attribute))
                for slot in quantity.slots(body.elements)
            ):
                parameters.append(Parameter(body.name, quantity.id))
    return parameters


def find_conflict(
    scene: Scene, parameter: Parameter, values: Values, marked: Sequence[Parameter]
) -> str:
    """Reason why a value cannot be written together with the others; empty if it can."""
    # Fill the other unknowns with priors.
    others = dict(values)
    for unknown in marked:
        others.setdefault(unknown, scene.priors[unknown])
    del others[parameter]
    try:
        scene.resolved.changes({parameter: values[parameter]}, others)
    except InputError as error:
        return str(error)
    return ""


def _fill_unknowns(
    scene: Scene,
    description: Description,
    marked: Sequence[Parameter],
    fitting: Values,
    estimates: Sequence[Estimate],
) -> tuple[Texts, Values]:
    """Write `fitting` values, and priors for other `marked` parameters; return the texts and all values."""
    # Priors fill the unknowns that no value determines.
    unmeasured = {p: scene.priors[p] for p in marked if p not in fitting}
    filled = scene.resolved.complete_values(unmeasured, fitting)
    records = [estimate for estimate in estimates if estimate.parameter in fitting]
    shifts = tuple(shift_carried(scene, description, fitting, records))
    return _inject_values(description, scene.catalogue, filled, records, shifts), filled


def shift_carried(
    scene: Scene, description: Description, values: Values, records: Sequence[Estimate]
) -> Iterator[Edit]:
    """Move bodies that are on a surface of measured height, with its precision."""
    # Write each z with the precision of the most accurate height.
    heights = [parameter for parameter in values if parameter.quantity == "height"]
    std = min((deviations(records)[parameter] for parameter in heights), default=None)
    for name, rise in at_heights(scene, values).rises.items():
        body = description.bodies[name]
        element = body.elements.element
        # A z from the poses stays in the poses; an unknown z follows by `Position.follows`.
        posed = scene.resolved.description.bodies[name].given is not None
        is_measured = Parameter(name, "height") in values
        is_placed = element.get("fromto") is None and body.elements.posed_ancestor() is None
        if is_measured or posed or not is_placed:
            continue
        if not has_unknown(element, "pos", 2):
            z = float(tokens(element.get("pos") or "0 0 0")[2]) + rise
            yield Edit(element, "pos", {2: number(z, std)}, "0 0 0")


def _inject_values(
    description: Description,
    quantities: Catalogue,
    values: Values,
    records: Sequence[Estimate],
    shifts: Sequence[Edit] = (),
) -> Texts:
    # Edits of the values, of the moved bodies, and of unknowns without meaning.
    edits = list(changes(description.bodies, quantities, values, {}, deviations(records)))
    edits += shifts
    edits += remove_leftovers(description, quantities, values, edits)
    texts = rewrite(description.document, edits)
    return replace(texts, main=write_records(texts.main, records))


def deviations(records: Sequence[Estimate]) -> dict[Parameter, float]:
    """Smallest standard deviation of each record, which determines the number of written digits."""
    return {record.parameter: float(min(record.stds)) for record in records if record.has_value}


def remove_leftovers(
    description: Description, quantities: Catalogue, values: Values, edits: Sequence[Change]
) -> Iterator[Edit]:
    """Remove each `?` without a meaning, most in a defaults class: every mass, or friction, is known."""
    # Find the attributes that stay unknown.
    answered = {(edit.element, edit.attribute) for edit in edits if isinstance(edit, Edit)}
    needed: set[str] = set()
    for parameter in list_unknowns(description, quantities):
        if parameter not in values:
            body = description.bodies[parameter.object]
            for slot in quantities[parameter.quantity].slots(body.elements):
                needed.add(slot.attribute)
    geoms: list[Element] = [e for e in elements(description.document.root) if e.tag == "geom"]
    for geom in geoms:
        for leftover in replace_unknowns(geom, INHERITED):
            is_answered = (geom, leftover.attribute) in answered
            if leftover.attribute not in needed and not is_answered:
                yield leftover


def iter_misread(
    before: Description,
    texts: Texts,
    values: Values,
    std: Mapping[Parameter, float],
    quantities: Catalogue,
) -> Iterator[tuple[Parameter, str]]:
    """Find values that the compiled file does not reproduce, each with the reason.

    Args:
        before: description of the document before the edits.
        texts: with the values.
        values: written.
        std: their standard deviations.
        quantities: catalogue.

    Raises:
        InputError: MuJoCo does not accept the file.
    """
    after = describe(reparse(texts, before.document), Poses(), quantities)
    for parameter, value in values.items():
        quantity = quantities[parameter.quantity]
        body = after.bodies.get(parameter.object)
        status = "missing" if body is None else quantity.status(body)
        if body is None or status == "missing":
            yield parameter, "the written text does not determine it"
            continue
        if reason := quantity.overruled(body):
            yield parameter, reason
            continue
        stated = status in ("known", "assumed")
        read = quantity.compiled(body)
        if read is None:
            continue
        # Compare only written components: those with a prior, or all of them.
        written = np.ones(quantity.size, dtype=np.bool_)
        original = before.bodies[parameter.object]
        if quantity.status(original) == "missing":
            written = np.array(quantity.prior(original, values).std) > 0.0
        # Tolerance: rounding, and a share of the standard deviation.
        error = np.abs(np.array(read) - value)[written]
        share = DIGITS if stated else SHARED_TOLERANCE
        allowed = ROUNDED * float(np.abs(value).max()) + share * std.get(parameter, 0.0)
        if (error > allowed).any():
            wrote, got = (" ".join(f"{part:.6g}" for part in numbers) for numbers in (value, read))
            yield (
                parameter,
                f"{wrote} {quantity.unit} is written, but MuJoCo reads {got} {quantity.unit}; "
                "another statement of the file overrides it",
            )
