"""Estimates into the user's own MJCF text: a minimal change that leaves every other byte alone.

What is written where, each quantity says (`palpate.scene.fill`). Every estimate is also recorded in
`<custom>`:

- numeric `palpate_<object>_<quantity>`: value, standard deviation, low and high end of the 95 %
  interval; with several components all values come first, then all deviations, and so on;
- numeric `palpate_<object>_<quantity>_<component>`: value and deviation of a further result (static
  friction);
- text `palpate_<object>_<quantity>_method`: how it was found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from palpate.errors import InputError
from palpate.estimation.estimate import Estimate
from palpate.mjcf import spans
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.defaults import answered_elsewhere
from palpate.mjcf.document import Document, Element, elements, parse_document, parse_xml
from palpate.mjcf.edits import Change, Edit, Insert, Slot
from palpate.parameter import Parameter
from palpate.quantities.catalogue import Catalogue, catalogue
from palpate.quantities.quantity import Quantity, Values
from palpate.scene.describe import Description, describe
from palpate.scene.fill import changes
from palpate.scene.poses import Poses
from palpate.scene.scene import Scene


def inject(
    text: str, values: Values, records: Sequence[Estimate] = (), folder: Path | None = None
) -> str:
    """The MJCF with `values` in it and `records` in its `<custom>`; nothing else changes.

    A `?` that `values` does not answer stays; see `unfilled`. `folder` is where relative file names
    start. When a value belongs into an included file, that file's content takes the place of its
    `<include>`.

    Raises:
        InputError: not a usable scene, or a value that has no place in it.
    """
    description = describe(parse_document(text, folder), Poses(), catalogue())
    return _injected(description, catalogue(), values, records)


def complete(scene: Scene, estimates: Sequence[Estimate]) -> tuple[str, tuple[str, ...]]:
    """The twin's text, and remarks: what could not be written, and which `?` nobody measured and
    now hold a prior."""
    values = {e.parameter: tuple(e.value.tolist()) for e in estimates}
    fitting: dict[Parameter, tuple[float, ...]] = {}
    notes: list[str] = []
    description = _without_poses(scene)
    marked = _marked(description, scene.catalogue)
    for parameter, value in values.items():
        reason = _unfit(scene, parameter, values, marked)
        if reason:
            notes.append(f"{parameter} is not in the twin: {reason}")
        else:
            fitting[parameter] = value
    unmeasured = [parameter for parameter in marked if parameter not in fitting]
    filled = scene.resolved.completed({p: scene.priors[p] for p in unmeasured}, fitting)
    for parameter in unmeasured:
        assumed = _numbers(filled[parameter])
        notes.append(f"{parameter} was not measured; the twin holds the assumed value {assumed}")
    records = [e for e in estimates if e.parameter in fitting]
    return _injected(description, scene.catalogue, filled, records), tuple(notes)


def unfilled(text: str, folder: Path | None = None) -> list[Parameter]:
    """What is written `?` and hence must be answered before MuJoCo reads the file, in document
    order."""
    return _marked(describe(parse_document(text, folder), Poses(), catalogue()), catalogue())


def _without_poses(scene: Scene) -> Description:
    """The scene's file without the poses that came with it, which the twin's text leaves out."""
    if not scene.resolved.description.placed:
        return scene.resolved.description
    return describe(scene.resolved.document, Poses(), scene.catalogue)


def _marked(description: Description, quantities: Catalogue) -> list[Parameter]:
    found: list[Parameter] = []
    for body in description.bodies.values():
        marked = [q.id for q in quantities.of(body.role) if _is_marked(body, q)]
        found += [Parameter(body.name, id) for id in sorted(marked)]
    return found


def _is_marked(body: BodyDescription, quantity: Quantity) -> bool:
    """Whether a quantity is missing and written `?`, so that the file does not compile without
    it."""
    if quantity.status(body) != "missing":
        return False
    slots = quantity.slots(body.elements)
    return any(slot.open_numbers(_stated(body, slot)) for slot in slots)


def _stated(body: BodyDescription, slot: Slot) -> str | None:
    return body.defaults.attribute(slot.element, slot.attribute)


def _unfit(scene: Scene, parameter: Parameter, values: Values, marked: Sequence[Parameter]) -> str:
    """Why a value cannot be written beside what else the twin will hold, or nothing."""
    others = {p: scene.priors[p] for p in marked} | {**values}
    del others[parameter]
    try:
        scene.resolved.changes({parameter: values[parameter]}, others)
    except InputError as error:
        return str(error)
    return ""


def _injected(
    description: Description, quantities: Catalogue, values: Values, records: Sequence[Estimate]
) -> str:
    document = description.document
    std = {record.parameter: float(min(record.std)) for record in records if record.has_value}
    edits = list(changes(description.bodies, quantities, values, {}, std))
    edits += _leftovers(description, quantities, values, edits)
    if any(_target(edit) not in document.index for edit in edits):
        assert document.folder is not None
        text = spans.inline_includes(document.text, document.folder)
        return inject(text, values, records, document.folder)
    return _written(document, edits, list(_entries(records)))


def _target(edit: Change) -> Element:
    return edit.parent if isinstance(edit, Insert) else edit.element


def _leftovers(
    description: Description, quantities: Catalogue, values: Values, edits: Sequence[Change]
) -> Iterator[Edit]:
    """A `?` that no longer means anything once every mass, or friction, is known: in a defaults
    class, mostly."""
    answered = {(e.element, e.attribute) for e in edits if isinstance(e, Edit)}
    needed: set[str] = set()
    for parameter in _marked(description, quantities):
        if parameter not in values:
            elements_of = description.bodies[parameter.object].elements
            slots = quantities[parameter.quantity].slots(elements_of)
            needed |= {slot.attribute for slot in slots}
    for geom in elements(description.document.root):
        for edit in answered_elsewhere(geom):
            is_answered = (geom, edit.attribute) in answered
            if geom.tag == "geom" and edit.attribute not in needed and not is_answered:
                yield edit


@dataclass(frozen=True, slots=True)
class _Entry:
    """An element of `<custom>`."""

    tag: str
    name: str
    data: str

    @property
    def attributes(self) -> dict[str, str]:
        return {"name": self.name, "data": self.data}


def _entries(records: Iterable[Estimate]) -> Iterator[_Entry]:
    for record in records:
        name = f"palpate_{record.parameter.object}_{record.parameter.quantity}"
        low, high = record.ci95.T
        yield _Entry("numeric", name, _numbers([*record.value, *record.std, *low, *high]))
        for further, part in record.parts.items():
            numbers = _numbers([part.value, part.std])
            yield _Entry("numeric", f"{name}_{further.replace(' ', '_')}", numbers)
        yield _Entry("text", f"{name}_method", _printable(record.method) or "measured")


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.7g}" for value in values)


def _printable(text: str) -> str:
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:1000]


def _written(document: Document, edits: Sequence[Change], entries: list[_Entry]) -> str:
    """The main text with the changes made, read again to make sure that nothing else has
    changed."""
    tags = spans.scan(document.text)
    data = document.text.encode("utf-8")
    values = _attribute_values(document, edits, data, tags)
    inserts = [edit for edit in edits if isinstance(edit, Insert)]
    changes = [
        spans.remove_attribute(data, tags[i], name)
        if value is None
        else spans.set_attribute(tags[i], name, value)
        for (i, name), value in values.items()
    ]
    changes += [
        spans.first_child(data, tags[document.index[i.parent]], spans.element(i.tag, i.attributes))
        for i in inserts
    ]
    result = spans.changed(document.text, changes)
    _require_same(document, result, values, inserts)
    return _recorded(result, entries)


def _attribute_values(
    document: Document, edits: Sequence[Change], data: bytes, tags: Sequence[spans.Tag]
) -> dict[tuple[int, str], str | None]:
    """New text of each changed attribute, by number of its element; several edits of one attribute
    add up."""
    values: dict[tuple[int, str], str | None] = {}
    for edit in edits:
        if isinstance(edit, Edit):
            i = document.index[edit.element]
            now = _as_written(data, tags[i], edit.attribute, edit.element.get(edit.attribute))
            values[i, edit.attribute] = edit.value(values.get((i, edit.attribute), now))
    return values


def _as_written(data: bytes, tag: spans.Tag, attribute: str, parsed: str | None) -> str | None:
    """An attribute with its own line breaks, which parsing turns into spaces; as parsed if it has
    references."""
    written = _value(data, tag, attribute)
    return parsed if parsed is None or "&" in written else written


def _require_same(
    document: Document,
    result: str,
    values: Mapping[tuple[int, str], str | None],
    inserts: Sequence[Insert],
) -> None:
    before, after = parse_xml(document.text, "the scene"), parse_xml(result, "the twin")
    listed = list(elements(before))
    for (i, name), value in values.items():
        if value is None:
            del listed[i].attrib[name]
        else:
            listed[i].set(name, value)
    for insert in inserts:
        listed[document.index[insert.parent]].insert(
            0, etree.Element(insert.tag, dict(insert.attributes))
        )
    if _content(before) != _content(after):
        raise InputError(
            "the estimates cannot be written into this MJCF without changing more than their numbers"
        )


def _content(root: Element) -> list[tuple[str, dict[str, str]]]:
    return [
        (str(e.tag), {str(k): " ".join(str(v).split()) for k, v in e.items()})
        for e in elements(root)
    ]


def _recorded(text: str, entries: Sequence[_Entry]) -> str:
    """With the entries in `<custom>`: those that are there get new data, the others are added."""
    if not entries:
        return text
    tags = spans.scan(text)
    data = text.encode("utf-8")
    custom = next((tag for tag in tags if tag.name == "custom" and tag.depth == 1), None)
    present = {
        _value(data, tag, "name"): tag
        for tag in tags
        if tag.name in ("numeric", "text") and tag.depth == 2
    }
    changes = [
        spans.set_attribute(present[e.name], "data", e.data) for e in entries if e.name in present
    ]
    added = [spans.element(e.tag, e.attributes) for e in entries if e.name not in present]
    if added:
        changes.append(_added(data, tags, custom, added))
    return spans.changed(text, changes)


def _value(data: bytes, tag: spans.Tag, name: str) -> str:
    start, end = tag.attributes.get(name, (0, 0))
    return data[start:end].decode("utf-8")


def _added(
    data: bytes, tags: list[spans.Tag], custom: spans.Tag | None, added: list[str]
) -> spans.Change:
    line = _line_break(data, tags)
    step = line.lstrip("\r\n") or "  "
    deeper = line + step if line else ""
    inner = "".join(deeper + element for element in added)
    if custom is None:
        return spans.last_children(data, tags[0], [f"<custom>{inner}{line}</custom>"], line)
    if custom.empty:
        return spans.Change(custom.start, custom.last, f"<custom>{inner}{line}</custom>")
    return spans.last_children(data, custom, added, deeper)


def _line_break(data: bytes, tags: list[spans.Tag]) -> str:
    """Line break and indentation before the first element inside the root; nothing in a text of one
    line."""
    before = data[tags[0].end : tags[1].start]
    space = before[len(before.rstrip(b" \t")) :].decode("utf-8")
    if b"\n" not in before:
        return ""
    return ("\r\n" if b"\r\n" in before else "\n") + space
