"""Estimates into the user's own MJCF text: a minimal change that leaves every other byte alone.

What is written where is decided in `palpate.scene.fill`. Every estimate is also recorded in
`<custom>`:

- numeric `palpate_<object>_<quantity>`: value, standard deviation, low and high end of the 95 %
  interval; with several components all values come first, then all deviations, and so on;
- numeric `palpate_<object>_<quantity>_<component>`: value and deviation of a further result (static
  friction);
- text `palpate_<object>_<quantity>_method`: how it was found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lxml import etree

from palpate.errors import InputError
from palpate.estimation.estimate import Estimate
from palpate.mjcf import spans
from palpate.mjcf.compile import MUJOCO_FRICTION
from palpate.mjcf.document import (
    UNKNOWN,
    Document,
    Element,
    elements,
    parse_document,
    parse_xml,
    tokens,
)
from palpate.mjcf.edits import Edit, Insert
from palpate.mjcf.roles import inventory, marked
from palpate.parameter import Parameter
from palpate.scene.poses import Poses
from palpate.scene.resolve import Source, resolve
from palpate.scene.scene import Scene

Values = Mapping[Parameter, tuple[float, ...]]


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
    document = parse_document(text, folder)
    source = resolve(document, Poses()).source
    source = replace(source, filler=replace(source.filler, std=_deviations(records)))
    edits = [*source.filler.edits(values, {}), *_leftovers(source, values)]
    if any(_target(edit) not in document.index for edit in edits):
        assert folder is not None
        return inject(spans.inline_includes(text, folder), values, records, folder)
    return _written(document, edits, list(_entries(records)))


def complete(scene: Scene, estimates: Sequence[Estimate]) -> tuple[str, tuple[str, ...]]:
    """The twin's text, and remarks: what could not be written, and which `?` nobody measured and
    now hold a prior."""
    folder = scene.source.document.folder
    values = {e.parameter: tuple(e.value.tolist()) for e in estimates}
    reasons = {parameter: _unfit(scene, parameter, values) for parameter in values}
    fitting = {parameter: value for parameter, value in values.items() if not reasons[parameter]}
    notes = [
        f"{parameter} is not in the twin: {reason}"
        for parameter, reason in reasons.items()
        if reason
    ]
    open_parameters = [
        parameter for parameter in unfilled(scene.text, folder) if parameter not in fitting
    ]
    filled = scene.source.filler.completed(
        {parameter: scene.priors[parameter] for parameter in open_parameters}, fitting
    )
    notes += [
        f"{parameter} was not measured; the twin holds the assumed value {_numbers(filled[parameter])}"
        for parameter in open_parameters
    ]
    text = inject(scene.text, filled, [e for e in estimates if e.parameter in fitting], folder)
    return text, tuple(notes)


def unfilled(text: str, folder: Path | None = None) -> list[Parameter]:
    """What is written `?` and hence must be answered before MuJoCo reads the file, in document
    order."""
    found = inventory(parse_document(text, folder))
    parameters = marked(found)
    return sorted(
        (Parameter(*parameter) for parameter in parameters),
        key=lambda parameter: (found.order.index(parameter.object), parameter.quantity),
    )


def _unfit(scene: Scene, parameter: Parameter, values: Values) -> str:
    """Why a value cannot be written, or nothing."""
    needed = {
        g: v
        for g, v in values.items()
        if g.object == parameter.object and g.quantity in (parameter.quantity, "mass")
    }
    try:
        scene.source.filler.edits(needed, scene.priors)
    except InputError as error:
        return str(error)
    return ""


def _deviations(records: Sequence[Estimate]) -> dict[Parameter, float]:
    return {record.parameter: float(min(record.std)) for record in records if record.has_value}


def _target(edit: Edit | Insert) -> Element:
    return edit.parent if isinstance(edit, Insert) else edit.element


def _leftovers(source: Source, values: Values) -> Iterator[Edit]:
    """A `?` that no longer means anything once every mass, or friction, is known: in a defaults
    class, mostly."""
    still = {
        quantity
        for name, quantity in marked(source.found)
        if Parameter(name, quantity) not in values
    }
    things = source.found.objects.values()
    answered = {(g, a) for thing in things for g in thing.unweighed for a in ("mass", "density")}
    answered |= {(g, "friction") for thing in things for g in thing.missing_friction}
    for geom in (e for e in elements(source.document.root) if e.tag == "geom"):
        for attribute, quantity in (
            ("mass", "mass"),
            ("density", "mass"),
            ("friction", "friction"),
        ):
            open_numbers = [
                i for i, part in enumerate(tokens(geom.get(attribute))) if part == UNKNOWN
            ]
            if open_numbers and quantity not in still and (geom, attribute) not in answered:
                numbers = (
                    {i: MUJOCO_FRICTION[min(i, 2)] for i in open_numbers}
                    if attribute == "friction"
                    else None
                )
                yield Edit(geom, attribute, numbers)


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


def _written(document: Document, edits: Sequence[Edit | Insert], entries: list[_Entry]) -> str:
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
    document: Document, edits: Sequence[Edit | Insert], data: bytes, tags: Sequence[spans.Tag]
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
