"""Edits of an MJCF text: positions of tags and attributes, and changes that keep every other byte."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from lxml import etree

from palpate.common.errors import InputError
from palpate.mjcf.document import (
    UNKNOWN,
    Element,
    expand_unknown,
    parse_xml,
    read_text,
    tokens,
    with_tokens,
)

_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')")


@dataclass(slots=True)
class XmlTag:
    """Position of an element, in bytes."""

    name: str
    depth: int
    # start, end: span of its start tag
    start: int
    end: int
    attributes: dict[str, tuple[int, int]]  # name to the span between the quotes
    attributes_end: int  # position of a further attribute
    close: int = -1  # start of its end tag; for an empty tag the start of the tag
    last: int = -1  # end of the whole element

    @property
    def empty(self) -> bool:
        """True if written `<tag/>`."""
        return self.close == self.start

    def value(self, data: bytes, name: str) -> str:
        """Return the text of an attribute between the quotes in `data`; empty without the attribute."""
        start, end = self.attributes.get(name, (0, 0))
        return data[start:end].decode("utf-8")


@dataclass(slots=True)
class TextChange:
    """Replace the bytes from `start` to `end` by `new`."""

    start: int
    end: int
    new: str


def scan(text: str) -> list[XmlTag]:
    """Find the positions of every element, in the order of start tags; the text must be well-formed."""
    # Expat counts bytes, so positions are in bytes, not characters.
    data, tags, unclosed = text.encode("utf-8"), list[XmlTag](), list[XmlTag]()
    parser = expat.ParserCreate("utf-8")

    def start_element(name: str, _: Mapping[str, str]) -> None:
        # Match the attributes after the tag's name, one by one.
        start = parser.CurrentByteIndex
        position = start + 1 + len(name.encode("utf-8"))
        attributes: dict[str, tuple[int, int]] = {}
        while (match := _ATTRIBUTE.match(data, position)) is not None:
            attributes[match[1].decode("utf-8")] = (match.start(2) + 1, match.end(2) - 1)
            position = match.end()
        end = data.index(b">", position) + 1
        tag = XmlTag(name, len(unclosed), start, end, attributes, attributes_end=position)
        tags.append(tag)
        unclosed.append(tag)

    def end_element(_: str) -> None:
        tag = unclosed.pop()
        at = parser.CurrentByteIndex
        if data[tag.end - 2 : tag.end] == b"/>":  # an empty tag ends at its start
            tag.close, tag.last = tag.start, tag.end
        else:
            tag.close, tag.last = at, data.index(b">", at) + 1

    parser.StartElementHandler = start_element
    parser.EndElementHandler = end_element
    parser.Parse(data, True)
    return tags


def set_attribute(tag: XmlTag, name: str, value: str) -> TextChange:
    """Replace the value of an attribute within its quotes, or add the attribute after the others."""
    from xml.sax.saxutils import quoteattr

    if name not in tag.attributes:
        return TextChange(tag.attributes_end, tag.attributes_end, f" {name}={quoteattr(value)}")
    start, end = tag.attributes[name]
    return TextChange(start, end, escape_attribute(value))


def remove_attribute(data: bytes, tag: XmlTag, name: str) -> TextChange:
    """Remove an attribute and the white space before it."""
    first, end = tag.attributes[name]
    before = data.rindex(name.encode("utf-8"), tag.start, first)
    start = len(data[:before].rstrip())
    return TextChange(start, end + 1, "")


def escape_attribute(value: str) -> str:
    """Escape an attribute's text for either kind of quotes."""
    return (
        value.replace("&", "&amp;")
        .replace("<", "&lt;")
        .replace('"', "&quot;")
        .replace("'", "&apos;")
    )


def write_element(name: str, attributes: Mapping[str, str]) -> str:
    """Write an empty element."""
    text = f"<{name}"
    for attribute, value in attributes.items():
        text += f' {attribute}="{escape_attribute(value)}"'
    return f"{text}/>"


def first_child(data: bytes, tag: XmlTag, content: str) -> TextChange:
    """Insert a first child, indented like the child that it precedes."""
    # Reuse the white space before the present first child.
    rest = data[tag.end :]
    space = rest[: len(rest) - len(rest.lstrip())].decode("utf-8")
    indent = space if "\n" in space else ""
    return TextChange(tag.end, tag.end, indent + content)


def last_children(data: bytes, tag: XmlTag, contents: Sequence[str], indent: str) -> TextChange:
    """Insert last children; `indent` is the line break and space before each."""
    at = len(data[: tag.close].rstrip())
    return TextChange(at, at, "".join(indent + content for content in contents))


def apply_changes(text: str, changes: Iterable[TextChange]) -> str:
    """Apply all changes to a text, those at one position in the given order."""
    data = text.encode("utf-8")
    parts: list[bytes] = []
    position = 0
    for change in sorted(changes, key=lambda c: c.start):
        if change.start < position:
            raise InputError("two changes of the scene overlap; state the attribute once")
        parts += [data[position : change.start], change.new.encode("utf-8")]
        position = change.end
    return b"".join([*parts, data[position:]]).decode("utf-8")


def inline_includes(
    text: str,
    includes: Mapping[str, Path],
    renamed: Mapping[str, str] | None = None,
    texts: Mapping[Path, str] | None = None,
) -> str:
    """Replace every `<include>` in a text by the content of its file.

    Args:
        includes: the files by their names in `<include>`.
        texts: texts in place of some of the files.
        renamed: new names for files that their content names.
    """
    # Included files may include others: repeat until none is left.
    while tags := [tag for tag in scan(text) if tag.name == "include"]:
        data = text.encode("utf-8")
        parts: list[TextChange] = []
        for tag in tags:
            # Read the file or its replacement, and check that it is well-formed.
            path = includes[html.unescape(tag.value(data, "file"))]
            included = (texts or {}).get(path)
            if included is None:
                included = read_text(path)
            parse_xml(included, str(path))
            # Insert the content of its root element.
            root = scan(included)[0]
            content = included.encode("utf-8")[root.end : root.close].decode("utf-8").strip()
            parts.append(TextChange(tag.start, tag.last, _with_names(content, renamed or {})))
        text = apply_changes(text, parts)
    return text


def _with_names(content: str, renamed: Mapping[str, str]) -> str:
    """Rename the files that an included file's content names."""
    data = f"<mujoco>{content}</mujoco>".encode()
    changes: list[TextChange] = []
    for tag in scan(data.decode("utf-8")):
        start, end = tag.attributes.get("file", (0, 0))
        name = html.unescape(tag.value(data, "file"))
        if tag.name != "include" and name in renamed:
            changes.append(TextChange(start, end, html.escape(renamed[name])))
    if not changes:
        return content
    text = apply_changes(data.decode("utf-8"), changes)
    return text.removeprefix("<mujoco>").removesuffix("</mujoco>")


# Changes of an MJCF: numbers of an attribute, or a new first child; applied to a parsed tree.


@dataclass(frozen=True, slots=True)
class Edit:
    """Change of some of an attribute's numbers."""

    element: Element
    attribute: str
    # Position in the attribute to new text; None removes the attribute.
    numbers: Mapping[int, str] | None
    base: str = "?"  # the attribute's text where the element has none

    def value(self, stated: str | None) -> str | None:
        """Return the attribute's new text, from its text `stated`."""
        if self.numbers is None:
            return None
        return with_tokens(
            expand_unknown(self.attribute, self.base if stated is None else stated), self.numbers
        )

    def apply(self, element: Element) -> None:
        """Make the change in `element`, which may be a copy."""
        value = self.value(element.get(self.attribute))
        if value is None:
            element.attrib.pop(self.attribute, None)
        else:
            element.set(self.attribute, value)


@dataclass(frozen=True, slots=True)
class Insert:
    """Insertion of `<tag attributes…/>` as the first child of an element."""

    parent: Element
    tag: str
    attributes: Mapping[str, str]


Change = Edit | Insert


@dataclass(frozen=True, slots=True)
class Slot:
    """A place in the file where a `?` may be written."""

    element: Element
    attribute: str
    stand_in: str  # text for each open number until it is measured
    numbers: tuple[int, ...] | None = None  # positions in the attribute; None for all of them
    # Text of the entire attribute until then, where open numbers are incompatible with stated ones.
    whole: tuple[str, ...] | None = None
    # Number of values that MuJoCo requires; all are open where the attribute is missing.
    required: int = 0

    def covers(self, number: int) -> bool:
        """Test if a `?` may be written at this position."""
        return self.numbers is None or number in self.numbers

    def open_numbers(self, stated: str | None) -> list[int]:
        """Return the positions of the `?` in the attribute's text `stated`."""
        # A missing attribute is open in all required numbers.
        parts = [UNKNOWN] * self.required if stated is None else tokens(stated)
        return [i for i, part in enumerate(parts) if part == UNKNOWN and self.covers(i)]

    def placeholder(self) -> Iterator[Edit]:
        """Yield the change that lets the scene compile before a measurement."""
        unknown = self.open_numbers(self.element.get(self.attribute))
        if unknown and self.whole is not None:
            yield Edit(self.element, self.attribute, dict(enumerate(self.whole)))
        elif unknown:
            base = " ".join([UNKNOWN] * max(self.required, 1))
            numbers = dict.fromkeys(unknown, self.stand_in)
            yield Edit(self.element, self.attribute, numbers, base)


def unknown_only(element: Element, attribute: str, texts: Mapping[int, str]) -> dict[int, str]:
    """Return the entries of `texts` whose number is `?`; all of them if none is, for a repeated measurement."""
    parts = tokens(element.get(attribute))
    unknown = {i: text for i, text in texts.items() if i < len(parts) and parts[i] == UNKNOWN}
    return unknown or dict(texts)


def apply(edits: Iterable[Change], twin_of: Mapping[Element, Element]) -> None:
    """Make the changes in a copy; `twin_of` maps each element to its copy."""
    for edit in edits:
        if isinstance(edit, Insert):
            twin_of[edit.parent].insert(0, etree.Element(edit.tag, dict(edit.attributes)))
        else:
            edit.apply(twin_of[edit.element])


def number(value: float, std: float | None = None) -> str:
    """Format a number: rounded to a tenth of its standard deviation, without one to seven digits."""
    if std is None or not 0 < std < float("inf"):
        return f"{value:.7g}"
    digits = max(0, -int(f"{std:e}".split("e")[1]) + 1)  # one more than the first digit of std
    return f"{value:.{min(digits, 12)}f}"
