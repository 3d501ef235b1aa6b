"""Positions of tags and attributes in an XML text, for changes without rewriting it."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from palpate.errors import InputError
from palpate.mjcf.document import parse_xml, read_text

_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')")


@dataclass(slots=True)
class Tag:
    """Position of an element, in bytes.

    Attributes:
        start, end: of its start tag.
        attributes: name to the span between the quotes.
        attributes_end: where a further attribute goes.
        close: where its end tag starts; for an empty tag where it starts.
        last: where its whole element ends.
    """

    name: str
    depth: int
    start: int
    end: int
    attributes: dict[str, tuple[int, int]]
    attributes_end: int
    close: int = -1
    last: int = -1

    @property
    def empty(self) -> bool:
        """Written `<tag/>`."""
        return self.close == self.start

    def value(self, data: bytes, name: str) -> str:
        """Text of an attribute between the quotes in `data`; empty without the attribute."""
        start, end = self.attributes.get(name, (0, 0))
        return data[start:end].decode("utf-8")


@dataclass(slots=True)
class Change:
    """Replace the bytes from `start` to `end` by `new`."""

    start: int
    end: int
    new: str


def scan(text: str) -> list[Tag]:
    """Positions of every element in the order of its start tag; the text must be well-formed."""
    # Expat counts bytes, so positions are in bytes, not characters.
    data, tags, unclosed = text.encode("utf-8"), list[Tag](), list[Tag]()
    parser = expat.ParserCreate("utf-8")

    def started(name: str, _: Mapping[str, str]) -> None:
        start = parser.CurrentByteIndex
        position = start + 1 + len(name.encode("utf-8"))
        attributes: dict[str, tuple[int, int]] = {}
        while (match := _ATTRIBUTE.match(data, position)) is not None:
            attributes[match[1].decode("utf-8")] = (match.start(2) + 1, match.end(2) - 1)
            position = match.end()
        end = data.index(b">", position) + 1
        tag = Tag(name, len(unclosed), start, end, attributes, attributes_end=position)
        tags.append(tag)
        unclosed.append(tag)

    def ended(_: str) -> None:
        tag = unclosed.pop()
        at = parser.CurrentByteIndex
        if data[tag.end - 2 : tag.end] == b"/>":  # an empty tag ends where it starts
            tag.close, tag.last = tag.start, tag.end
        else:
            tag.close, tag.last = at, data.index(b">", at) + 1

    parser.StartElementHandler = started
    parser.EndElementHandler = ended
    parser.Parse(data, True)
    return tags


def set_attribute(tag: Tag, name: str, value: str) -> Change:
    """Replace the value of an attribute within its quotes, or add the attribute after the others."""
    from xml.sax.saxutils import quoteattr

    if name not in tag.attributes:
        return Change(tag.attributes_end, tag.attributes_end, f" {name}={quoteattr(value)}")
    start, end = tag.attributes[name]
    return Change(start, end, escaped(value))


def remove_attribute(data: bytes, tag: Tag, name: str) -> Change:
    """Remove an attribute and the white space before it."""
    first, end = tag.attributes[name]
    before = data.rindex(name.encode("utf-8"), tag.start, first)
    start = len(data[:before].rstrip())
    return Change(start, end + 1, "")


def escaped(value: str) -> str:
    """Escape an attribute's text for either kind of quotes."""
    return (
        value.replace("&", "&amp;")
        .replace("<", "&lt;")
        .replace('"', "&quot;")
        .replace("'", "&apos;")
    )


def element(name: str, attributes: Mapping[str, str]) -> str:
    """Write an empty element."""
    text = f"<{name}"
    for attribute, value in attributes.items():
        text += f' {attribute}="{escaped(value)}"'
    return f"{text}/>"


def first_child(data: bytes, tag: Tag, content: str) -> Change:
    """Insert a first child, indented as the one that it precedes."""
    rest = data[tag.end :]
    space = rest[: len(rest) - len(rest.lstrip())].decode("utf-8")
    indent = space if "\n" in space else ""
    return Change(tag.end, tag.end, indent + content)


def last_children(data: bytes, tag: Tag, contents: Sequence[str], indent: str) -> Change:
    """Insert last children; `indent` is the line break and space before each."""
    at = len(data[: tag.close].rstrip())
    return Change(at, at, "".join(indent + content for content in contents))


def changed(text: str, changes: Iterable[Change]) -> str:
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
    # Included files may include others, so until none is left.
    while tags := [tag for tag in scan(text) if tag.name == "include"]:
        data = text.encode("utf-8")
        parts: list[Change] = []
        for tag in tags:
            path = includes[html.unescape(tag.value(data, "file"))]
            included = (texts or {}).get(path)
            if included is None:
                included = read_text(path)
            parse_xml(included, str(path))
            root = scan(included)[0]
            content = included.encode("utf-8")[root.end : root.close].decode("utf-8").strip()
            parts.append(Change(tag.start, tag.last, _with_names(content, renamed or {})))
        text = changed(text, parts)
    return text


def _with_names(content: str, renamed: Mapping[str, str]) -> str:
    """Rename the files that an included file's content names."""
    data = f"<mujoco>{content}</mujoco>".encode()
    changes: list[Change] = []
    for tag in scan(data.decode("utf-8")):
        start, end = tag.attributes.get("file", (0, 0))
        name = html.unescape(tag.value(data, "file"))
        if tag.name != "include" and name in renamed:
            changes.append(Change(start, end, html.escape(renamed[name])))
    if not changes:
        return content
    text = changed(data.decode("utf-8"), changes)
    return text.removeprefix("<mujoco>").removesuffix("</mujoco>")
