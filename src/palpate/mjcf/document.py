"""A parsed MJCF file, and its XML, which is untrusted input: no DTD, no entities, no network.

A `Document` is the main file with its includes expanded, which remembers what stood in the main
text; `mjcf.reading` reads it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from lxml import etree

from palpate.errors import InputError
from palpate.files import read as files

Element = etree._Element  # pyright: ignore[reportPrivateUsage]

MAX_BYTES = 10_000_000
"""Largest MJCF file."""

MAX_DEPTH = 200
"""Deepest nesting of elements, MuJoCo's own models stay below 50."""

MAX_ASSET_BYTES = 200_000_000
"""Most bytes of all meshes, textures and height fields of a scene together."""

UNKNOWN = "?"
"""Written in place of a number that is to be measured."""

COUNTS = {"pos": 3, "diaginertia": 3, "fullinertia": 6}
"""Number of values that a single `?` stands for."""


@dataclass(frozen=True, slots=True)
class Place:
    """Place of an element: an included file or an attached model, or the main text (None), and the
    number of start tags before its own there."""

    file: Path | None
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A file that an element names.

    Attributes:
        attribute, name: as written.
        located: the name from the scene's folder (from that of the attached model), below the
            folder that `<compiler>` sets for its kind.
        path: the file, absolute.
        model: the attached model that names it; None for the scene.
    """

    element: Element
    attribute: str
    name: str
    located: str
    path: Path
    model: Path | None = None


@dataclass(frozen=True, slots=True)
class Texts:
    """A scene's own text, and those of included files and attached models that are not as they lie
    there."""

    main: str
    parts: Mapping[Path, str] = field(default_factory=dict[Path, str])


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """An MJCF file, parsed.

    Attributes:
        text: the main file.
        root: its elements, included files expanded in place.
        index: where each element stands, those of `<include>` that it was expanded from among them,
            and those of the models that it attaches.
        folder: where relative file names start, None for text without files.
        home: the folder outside of which nothing is read, None for text without files.
        files: every other file it needs, absolute.
        includes: those of them that are included, by the names that they are included by.
        beside: the asset files of these that lie beside them, from `folder`, by the names that they
            have there.
        texts: the text of each included file, and of all of the attached models.
        named: what names a file in all of them.
        models: those that it attaches itself, by the names that `<attach>` calls them by.
        robots: names of the bodies that robots begin with, where somebody said so.
        path: where it lies, of an attached model; None for a scene.
    """

    text: str
    root: Element
    index: Mapping[Element, Place]
    folder: Path | None
    home: Path | None
    files: tuple[Path, ...]
    includes: Mapping[str, Path] = field(default_factory=dict[str, Path])
    beside: Mapping[str, str] = field(default_factory=dict[str, str])
    texts: Mapping[Path, str] = field(default_factory=dict[Path, str])
    named: tuple[Named, ...] = ()
    models: Mapping[str, Document] = field(default_factory=lambda: dict[str, Document]())
    robots: tuple[str, ...] = ()
    path: Path | None = None

    @property
    def worldbody(self) -> Element:
        """The (first) worldbody.

        Raises:
            InputError: there is none.
        """
        found = self.root.find("worldbody")
        if found is None:
            raise InputError("the scene has no <worldbody>, so there is nothing in it")
        return found

    def attached(self) -> dict[Path, Document]:
        """The models that it attaches, and those that these do, by where they lie."""
        found: dict[Path, Document] = {}
        pending = list(self.models.values())
        while pending:
            model = pending.pop(0)
            assert model.path is not None
            if model.path not in found:
                found[model.path] = model
                pending += model.models.values()
        return found


def read_text(path: Path) -> str:
    """The content of an XML file.

    Raises:
        InputError: not a regular file, not readable, too large or not utf-8.
    """
    return files.read_text(path, MAX_BYTES, "an MJCF scene")


def parse_xml(text: str, where: str) -> Element:
    """The root of a well-formed document without a DTD; `where` names it in messages.

    Raises:
        InputError: malformed (with line and column), a DTD or entities, too deep, too large.
    """
    data = text.encode("utf-8")
    if len(data) > MAX_BYTES:
        raise InputError(
            f"{where} is larger than {MAX_BYTES // 1_000_000} MB, too large for an MJCF scene"
        )
    _refuse_dtd_and_depth(data, where)
    parser = etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        load_dtd=False,
        no_network=True,
        huge_tree=False,
        remove_comments=False,
        remove_pis=False,
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        line, column = error.position
        raise InputError(
            f"{where}, line {line}, column {column}: malformed XML: {error.msg}"
        ) from None
    return root


def _refuse_dtd_and_depth(data: bytes, where: str) -> None:
    parser = expat.ParserCreate("utf-8")
    depth = 0

    def place() -> str:
        return f"{where}, line {parser.CurrentLineNumber}, column {parser.CurrentColumnNumber + 1}"

    def doctype(*_: object) -> None:
        raise InputError(f"{place()}: a DOCTYPE or entity declaration is not accepted; remove it")

    def start(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"{place()}: elements are nested deeper than {MAX_DEPTH}")

    def end(*_: object) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = doctype
    parser.EntityDeclHandler = doctype
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages.get(error.code, "not well-formed")
        raise InputError(
            f"{where}, line {error.lineno}, column {error.offset + 1}: malformed XML: {reason}"
        ) from None


def compiler_settings(root: Element) -> dict[str, str]:
    """Compiler settings of a model; later elements overrule earlier ones."""
    found: dict[str, str] = {}
    for compiler in root.iterfind("compiler"):
        found.update({str(name): str(value) for name, value in compiler.items()})
    return found


def elements(root: Element) -> Iterator[Element]:
    """All elements below and including `root`, in document order, without comments and
    instructions."""
    return root.iter(etree.Element)  # pyright: ignore[reportUnknownMemberType, reportArgumentType, reportReturnType]


def children(element: Element) -> Iterator[Element]:
    """Child elements without comments and instructions."""
    return (child for child in element if isinstance(child.tag, str))


def label(element: Element) -> str:
    """Label of an element in messages: `<geom name="top"> (line 12)`."""
    name = element.get("name")
    shown = f'<{element.tag} name="{name[:60]}">' if name else f"<{element.tag}>"
    return f"{shown} (line {element.sourceline})"


def tokens(value: str | None) -> list[str]:
    """The whitespace-separated parts of an attribute."""
    return (value or "").split()


def spelled_out(attribute: str, value: str) -> str:
    """A single `?` as one for each number it stands for; other values as they are."""
    return (
        " ".join([UNKNOWN] * COUNTS[attribute])
        if attribute in COUNTS and value.strip() == UNKNOWN
        else value
    )


def with_tokens(value: str, changes: Mapping[int, str]) -> str:
    """`value` with the i-th parts replaced, every other character kept.

    Raises:
        InputError: it has fewer parts.
    """
    parts = re.split(r"(\S+)", value)
    if 2 * max(changes, default=-1) + 1 >= len(parts):
        raise InputError(
            f"'{value[:60]}' has too few numbers: {max(changes) + 1} or more are needed"
        )
    for i, new in changes.items():
        parts[2 * i + 1] = new
    return "".join(parts)


def has_unknown(element: Element | None, attribute: str, *indices: int) -> bool:
    """True if one of the attribute's numbers (all, when no index is given) is written `?`."""
    if element is None:
        return False
    unknown = [part == UNKNOWN for part in tokens(element.get(attribute))]
    if not indices:
        return any(unknown)
    return any(unknown[i] for i in indices if i < len(unknown))


def copy_root(document: Document) -> tuple[Element, dict[Element, Element]]:
    """A deep copy of the document's root, without those of attached models, and which element each
    original became."""
    twin = deepcopy(document.root)
    return twin, dict(zip(elements(document.root), elements(twin), strict=True))
