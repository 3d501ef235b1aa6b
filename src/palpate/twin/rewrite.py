"""Changes made in the user's own text, which leave every other byte alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from lxml import etree

from palpate.errors import InputError
from palpate.mjcf import spans
from palpate.mjcf.document import Document, Element, Texts, elements, parse_xml
from palpate.mjcf.edits import Change, Edit, Insert

Attributes = Mapping[tuple[int, str], str | None]
"""New text of an attribute by the number of its element and its name; None where it goes."""


def rewritten(document: Document, edits: Sequence[Change]) -> Texts:
    """The changes made in the texts in which they belong, which are read again to make sure that
    nothing else has changed.

    Raises:
        InputError: something else would change.
    """
    by_file: dict[Path | None, list[Change]] = {None: []}
    for edit in edits:
        by_file.setdefault(document.index[target(edit)].file, []).append(edit)
    main = _rewritten(document, document.text, by_file.pop(None))
    parts: dict[Path, str] = {}
    for file, made in by_file.items():
        if file is not None:
            parts[file] = _rewritten(document, document.texts[file], made)
    return Texts(main, parts)


def target(edit: Change) -> Element:
    """The element in whose text a change is made."""
    return edit.parent if isinstance(edit, Insert) else edit.element


def _rewritten(document: Document, text: str, edits: Sequence[Change]) -> str:
    """Text of the document with its changes made."""
    tags = spans.scan(text)
    data = text.encode("utf-8")
    values = _attribute_values(document, edits, data, tags)
    inserts = [edit for edit in edits if isinstance(edit, Insert)]
    made: list[spans.Change] = []
    for (i, name), value in values.items():
        if value is None:
            made.append(spans.remove_attribute(data, tags[i], name))
        else:
            made.append(spans.set_attribute(tags[i], name, value))
    for insert in inserts:
        parent = tags[document.index[insert.parent].number]
        content = spans.element(insert.tag, insert.attributes)
        made.append(spans.first_child(data, parent, content))
    result = spans.changed(text, made)
    _require_same(document, text, result, values, inserts)
    return result


def _attribute_values(
    document: Document, edits: Sequence[Change], data: bytes, tags: Sequence[spans.Tag]
) -> Attributes:
    """Several edits of one attribute add up."""
    values: dict[tuple[int, str], str | None] = {}
    for edit in edits:
        if isinstance(edit, Edit):
            i = document.index[edit.element].number
            now = _as_written(data, tags[i], edit.attribute, edit.element.get(edit.attribute))
            values[i, edit.attribute] = edit.value(values.get((i, edit.attribute), now))
    return values


def _as_written(data: bytes, tag: spans.Tag, attribute: str, parsed: str | None) -> str | None:
    """An attribute with its own line breaks, which parsing turns into spaces; as parsed if it has
    references."""
    written = tag.value(data, attribute)
    return parsed if parsed is None or "&" in written else written


def _require_same(
    document: Document, text: str, result: str, values: Attributes, inserts: Sequence[Insert]
) -> None:
    """The result is the text with just these changes, once both are parsed."""
    before, after = parse_xml(text, "the scene"), parse_xml(result, "the twin")
    listed = list(elements(before))
    for (i, name), value in values.items():
        if value is None:
            del listed[i].attrib[name]
        else:
            listed[i].set(name, value)
    for insert in inserts:
        new = etree.Element(insert.tag, dict(insert.attributes))
        listed[document.index[insert.parent].number].insert(0, new)
    if _content(before) != _content(after):
        raise InputError(
            "the estimates cannot be written into this MJCF without changing more than their numbers"
        )


def _content(root: Element) -> list[tuple[str, dict[str, str]]]:
    """Every element's name and attributes, their white space made alike."""
    found: list[tuple[str, dict[str, str]]] = []
    for element in elements(root):
        attributes = {str(key): " ".join(str(v).split()) for key, v in element.items()}
        found.append((str(element.tag), attributes))
    return found
