"""Positions of tags and attributes in an XML text, for changes without rewriting it."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
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
        """An attribute's text in `data`, as it stands between the quotes; empty without one."""
        start, end = self.attributes.get(name, (0, 0))
        return data[start:end].decode("utf-8")


@dataclass(slots=True)
class Change:
    """Replace the bytes from `start` to `end` by `new`."""

    start: int
    end: int
    new: str


@dataclass(slots=True)
class _Scan:
    data: bytes
    tags: list[Tag] = field(default_factory=list[Tag])
    open: list[Tag] = field(default_factory=list[Tag])


def scan(text: str) -> list[Tag]:
    """Every element in the order of its start tag. The text must be well-formed."""
    state = _Scan(text.encode("utf-8"))
    parser = expat.ParserCreate("utf-8")

    def start(name: str, _: Mapping[str, str]) -> None:
        tag = _start_tag(state.data, name, len(state.open), parser.CurrentByteIndex)
        state.tags.append(tag)
        state.open.append(tag)

    def end(_: str) -> None:
        tag = state.open.pop()
        at = parser.CurrentByteIndex
        if state.data[tag.end - 2 : tag.end] == b"/>":
            tag.close, tag.last = tag.start, tag.end
        else:
            tag.close, tag.last = at, state.data.index(b">", at) + 1

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.Parse(state.data, True)
    return state.tags


def _start_tag(data: bytes, name: str, depth: int, start: int) -> Tag:
    position = start + 1 + len(name.encode("utf-8"))
    attributes: dict[str, tuple[int, int]] = {}
    while (match := _ATTRIBUTE.match(data, position)) is not None:
        attributes[match[1].decode("utf-8")] = (match.start(2) + 1, match.end(2) - 1)
        position = match.end()
    return Tag(name, depth, start, data.index(b">", position) + 1, attributes, position)


def set_attribute(tag: Tag, name: str, value: str) -> Change:
    """Give an attribute another value, in its own quotes, or add it after the others."""
    from xml.sax.saxutils import quoteattr

    if name not in tag.attributes:
        return Change(tag.attributes_end, tag.attributes_end, f" {name}={quoteattr(value)}")
    start, end = tag.attributes[name]
    return Change(start, end, escaped(value))


def remove_attribute(data: bytes, tag: Tag, name: str) -> Change:
    """Take an attribute out, with the white space before it."""
    first, end = tag.attributes[name]
    before = data.rindex(name.encode("utf-8"), tag.start, first)
    start = len(data[:before].rstrip())
    return Change(start, end + 1, "")


def escaped(value: str) -> str:
    """Attribute text that is safe in either kind of quotes."""
    return (
        value.replace("&", "&amp;")
        .replace("<", "&lt;")
        .replace('"', "&quot;")
        .replace("'", "&apos;")
    )


def element(name: str, attributes: Mapping[str, str]) -> str:
    """An empty element."""
    text = f"<{name}"
    for attribute, value in attributes.items():
        text += f' {attribute}="{escaped(value)}"'
    return f"{text}/>"


def first_child(data: bytes, tag: Tag, content: str) -> Change:
    """Put an element first into another, indented as the one it precedes."""
    rest = data[tag.end :]
    space = rest[: len(rest) - len(rest.lstrip())].decode("utf-8")
    indent = space if "\n" in space else ""
    return Change(tag.end, tag.end, indent + content)


def last_children(data: bytes, tag: Tag, contents: Sequence[str], indent: str) -> Change:
    """Put elements last into another; `indent` is the line break and space before each."""
    at = len(data[: tag.close].rstrip())
    return Change(at, at, "".join(indent + content for content in contents))


def changed(text: str, changes: Iterable[Change]) -> str:
    """The text with all changes made; those at one place in the order given."""
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
    """The text with every included file's content in its place.

    Args:
        includes: the files by the names that they are included by.
        texts: what is read in the place of some of them.
        renamed: other names for files that their content names.
    """
    while tags := [tag for tag in scan(text) if tag.name == "include"]:
        data = text.encode("utf-8")
        parts: list[Change] = []
        for tag in tags:
            content = _content(includes, texts or {}, data, tag)
            parts.append(Change(tag.start, tag.last, _with_names(content, renamed or {})))
        text = changed(text, parts)
    return text


def _with_names(content: str, renamed: Mapping[str, str]) -> str:
    """An included file's content with other names for the files that it names."""
    data = f"<mujoco>{content}</mujoco>".encode()
    changes: list[Change] = []
    for tag in scan(data.decode("utf-8")):
        start, end = tag.attributes.get("file", (0, 0))
        name = html.unescape(data[start:end].decode("utf-8"))
        if tag.name != "include" and name in renamed:
            changes.append(Change(start, end, html.escape(renamed[name])))
    if not changes:
        return content
    text = changed(data.decode("utf-8"), changes)
    return text.removeprefix("<mujoco>").removesuffix("</mujoco>")


def _content(
    includes: Mapping[str, Path], texts: Mapping[Path, str], data: bytes, include: Tag
) -> str:
    start, end = include.attributes["file"]
    path = includes[html.unescape(data[start:end].decode("utf-8"))]
    included = texts[path] if path in texts else read_text(path)
    parse_xml(included, str(path))
    root = scan(included)[0]
    return included.encode("utf-8")[root.end : root.close].decode("utf-8").strip()
