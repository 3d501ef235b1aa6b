"""Changes of the user's own text that leave every other byte unchanged, and records in its
`<custom>`.

The records of an estimate:

- numeric `palpate_<object>_<quantity>`: value, standard deviation, low and high end of the 95 %
  interval; with several components all values come first, then all deviations, and so on;
- numeric `palpate_<object>_<quantity>_<component>`: value and deviation of a further result (static
  friction);
- text `palpate_<object>_<quantity>_method`: method of the estimate;
- text `palpate_<object>_<quantity>_verdict`: verdict, if it is not identified.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from lxml import etree

from palpate.common.errors import InputError
from palpate.estimation.estimate import Estimate
from palpate.mjcf.document import Document, Element, Texts, elements, parse_xml
from palpate.mjcf.edits import (
    Change,
    Insert,
    TextChange,
    XmlTag,
    apply_changes,
    first_child,
    last_children,
    remove_attribute,
    scan,
    set_attribute,
    write_element,
)

MAX_SENTENCE = 1000  # Characters of a method that are kept
# New text of an attribute, by the number of its element and its name; None removes it.
Attributes = Mapping[tuple[int, str], str | None]


def rewrite(document: Document, edits: Sequence[Change]) -> Texts:
    """Make the changes in the document's texts, each in the file of its element, and change nothing else."""
    # Collect the edits of each file; None is the main text.
    by_file: dict[Path | None, list[Change]] = {None: []}
    for edit in edits:
        element = edit.parent if isinstance(edit, Insert) else edit.element
        by_file.setdefault(document.index[element].file, []).append(edit)
    main = _rewrite(document, document.text, by_file.pop(None))
    parts: dict[Path, str] = {}
    for file, changes in by_file.items():
        if file is not None:
            parts[file] = _rewrite(document, document.texts[file], changes)
    return Texts(main, parts)


def _rewrite(document: Document, text: str, edits: Sequence[Change]) -> str:
    """Make the changes in the text of one file."""
    tags = scan(text)
    data = text.encode("utf-8")
    # Collect the edits: several edits of one attribute add up.
    values: dict[tuple[int, str], str | None] = {}
    inserts: list[Insert] = []
    for edit in edits:
        if isinstance(edit, Insert):
            inserts.append(edit)
        else:
            i, name = document.index[edit.element].number, edit.attribute
            now = edit.element.get(name)
            # Use the text as written, with its own line breaks, which parsing turns into spaces.
            # Only parsing resolves references such as &#63;.
            if now is not None and "&" not in (written := tags[i].value(data, name)):
                now = written
            values[i, name] = edit.value(values.get((i, name), now))
    # Convert the values and inserts to changes of the text, and apply them.
    changes: list[TextChange] = []
    for (i, name), value in values.items():
        if value is None:
            changes.append(remove_attribute(data, tags[i], name))
        else:
            changes.append(set_attribute(tags[i], name, value))
    for insert in inserts:
        parent = tags[document.index[insert.parent].number]
        content = write_element(insert.tag, insert.attributes)
        changes.append(first_child(data, parent, content))
    result = apply_changes(text, changes)
    require_same(document, text, result, values, inserts)
    return result


def require_same(
    document: Document, text: str, result: str, values: Attributes, inserts: Sequence[Insert]
) -> None:
    """Require that the parsed result equals the parsed text after the same changes."""
    # Apply the changes to the parsed original, and compare its content.
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
    if content_of(before) != content_of(after):
        raise InputError("the estimates cannot be written into this MJCF without other changes")


def content_of(root: Element) -> list[tuple[str, dict[str, str]]]:
    """Name and attributes of every element, with normalized white space."""
    content: list[tuple[str, dict[str, str]]] = []
    for element in elements(root):
        attributes = {str(key): " ".join(str(v).split()) for key, v in element.items()}
        content.append((str(element.tag), attributes))
    return content


def write_records(text: str, records: Sequence[Estimate]) -> str:
    """Write `records` into the `<custom>` of the MJCF: existing ones get new data, the others are added."""
    if not records:
        return text
    # Find the existing records.
    tags = scan(text)
    data = text.encode("utf-8")
    present: dict[str, XmlTag] = {}
    for tag in tags:
        if tag.name in ("numeric", "text") and tag.depth == 2:
            present[tag.value(data, "name")] = tag
    changes: list[TextChange] = []
    added: list[str] = []
    for tag, name, content in entries_of(records):
        if name in present:
            changes.append(set_attribute(present[name], "data", content))
        else:
            added.append(write_element(tag, {"name": name, "data": content}))
    if added:
        changes.append(_add_elements(data, tags, added))
    return apply_changes(text, changes)


def entries_of(records: Iterable[Estimate]) -> Iterator[tuple[str, str, str]]:
    """Yield tag, name and data of the elements of `<custom>`."""
    for record in records:
        name = f"palpate_{record.parameter.object}_{record.parameter.quantity}"
        low, high = record.intervals.T
        yield "numeric", name, as_text([*record.values, *record.stds, *low, *high])
        for further, part in record.parts.items():
            further = further.replace(" ", "_")
            yield "numeric", f"{name}_{further}", as_text([part.value, part.std])
        printable = "".join(c if c.isprintable() else " " for c in record.method)
        method = " ".join(printable.split())[:MAX_SENTENCE]
        yield "text", f"{name}_method", method or "measured"
        if not record.identified:
            yield "text", f"{name}_verdict", record.verdict


def as_text(values: Iterable[float]) -> str:
    """Format numbers with seven significant digits."""
    return " ".join(f"{value:.7g}" for value in values)


def _add_elements(data: bytes, tags: list[XmlTag], added: list[str]) -> TextChange:
    """Add elements to `<custom>`, with the indentation of the file; a missing `<custom>` is made."""
    # Line break and indentation before the first element in the root; none in a text of one line.
    before = data[tags[0].end : tags[1].start]
    line = ""
    if b"\n" in before:
        line = "\r\n" if b"\r\n" in before else "\n"
        line += before[len(before.rstrip(b" \t")) :].decode("utf-8")
    deeper = line + (line.lstrip("\r\n") or "  ") if line else ""
    content = f"<custom>{''.join(deeper + element for element in added)}{line}</custom>"
    # Three cases: no `<custom>`, an empty one, one with content.
    custom = next((tag for tag in tags if tag.name == "custom" and tag.depth == 1), None)
    if custom is None:
        return last_children(data, tags[0], [content], line)
    if custom.empty:
        return TextChange(custom.start, custom.last, content)
    return last_children(data, custom, added, deeper)
