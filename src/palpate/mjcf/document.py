"""A parsed MJCF file with the models that it attaches, and safe parsing of its XML: no DTD, no entities, no
network.

A `Document` is the main file with its includes expanded. It knows the position of each element in its
text. `mjcf.reading` reads it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from lxml import etree

from palpate.common import files
from palpate.common.errors import InputError

Element = etree._Element  # pyright: ignore[reportPrivateUsage]
MAX_BYTES = 10_000_000  # Largest MJCF file
MAX_DEPTH = 200  # Deepest nesting of elements. MuJoCo's own models stay below 50.
# Most bytes of all meshes, textures and height fields of a scene in total.
MAX_ASSET_BYTES = 200_000_000
UNKNOWN = "?"  # Placeholder of a number that is to be measured
# Number of values that a single `?` represents.
COUNTS = {"pos": 3, "diaginertia": 3, "fullinertia": 6, "range": 2}


@dataclass(frozen=True, slots=True)
class Place:
    """File of an element, None for the main text, and the number of start tags before it."""

    file: Path | None
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class FileReference:
    """A file that an element names."""

    element: Element
    # attribute, name: as written
    attribute: str
    name: str
    # The name relative to the scene's folder (or that of the attached model), below the folder that
    # `<compiler>` sets for its kind.
    located: str
    path: Path  # the file, absolute
    model: Path | None = None  # the attached model that names it; None for the scene


@dataclass(frozen=True, slots=True)
class Texts:
    """A scene's own text, and changed texts of included files and attached models."""

    main: str
    parts: Mapping[Path, str] = field(default_factory=dict[Path, str])


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A parsed MJCF file."""

    text: str  # the main file
    root: Element  # its elements, with included files expanded in place
    # Position of each element, including `<include>` elements and those of attached models.
    index: Mapping[Element, Place]
    folder: Path | None  # start of relative file names, None for text without files
    home: Path | None  # the only folder from which files are read, None for text without files
    files: tuple[Path, ...]  # every other file it needs, absolute
    # Included files by the names in `<include>`.
    includes: Mapping[str, Path] = field(default_factory=dict[str, Path])
    # Asset files found in the folder of an included file, relative to `folder`, by their names in
    # the included file.
    asset_paths: Mapping[str, str] = field(default_factory=dict[str, str])
    # Text of each included file and attached model.
    texts: Mapping[Path, str] = field(default_factory=dict[Path, str])
    named: tuple[FileReference, ...] = ()  # all references to files in them
    # Models that it attaches itself, by the names in `<attach>`.
    models: Mapping[str, Document] = field(default_factory=lambda: dict[str, Document]())
    robots: tuple[str, ...] = ()  # root bodies of robots as named by the user
    path: Path | None = None  # file of an attached model; None for a scene

    @property
    def worldbody(self) -> Element:
        """Return the (first) worldbody; an `InputError` if there is none."""
        worldbody = self.root.find("worldbody")
        if worldbody is None:
            raise InputError("the scene has no <worldbody>, so it is empty")
        return worldbody

    def attached(self) -> dict[Path, Document]:
        """Return all models that it attaches, directly or through others, by path."""
        models: dict[Path, Document] = {}
        pending = list(self.models.values())  # breadth first, each model once
        while pending:
            model = pending.pop(0)
            assert model.path is not None
            if model.path not in models:
                models[model.path] = model
                pending += model.models.values()
        return models


def read_text(path: Path) -> str:
    """Read an XML file of at most `MAX_BYTES`."""
    return files.read_text(path, MAX_BYTES, "an MJCF scene")


def parse_xml(text: str, where: str) -> Element:
    """Parse a well-formed document without a DTD; `where` names it in messages.

    Raises InputError: malformed (with line and column), a DTD or entities, too deep, too large.
    """
    # Check size, DTD and depth before lxml parses the text.
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
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        line, column = error.position
        raise InputError(
            f"{where}, line {line}, column {column}: malformed XML: {error.msg}"
        ) from None


def _refuse_dtd_and_depth(data: bytes, where: str) -> None:
    """Scan a text with expat for a DTD, and for excessive depth."""
    # Expat calls the handlers before it expands any entity; lxml would parse the DTD first.
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
    """Return the compiler settings of a model; later elements overrule earlier ones."""
    settings: dict[str, str] = {}
    for compiler in root.iterfind("compiler"):
        settings.update({str(name): str(value) for name, value in compiler.items()})
    return settings


def elements(root: Element) -> Iterator[Element]:
    """Iterate over `root` and all elements below it, in document order, without comments and instructions."""
    return root.iter(etree.Element)  # pyright: ignore[reportUnknownMemberType, reportArgumentType, reportReturnType]


def children(element: Element) -> Iterator[Element]:
    """Iterate over the child elements, without comments and instructions."""
    return (child for child in element if isinstance(child.tag, str))


def label(element: Element) -> str:
    """Return the label of an element in messages: `<geom name="top"> (line 12)`."""
    name = element.get("name")
    shown = f'<{element.tag} name="{name[:60]}">' if name else f"<{element.tag}>"
    return f"{shown} (line {element.sourceline})"


def tokens(value: str | None) -> list[str]:
    """Split an attribute at white space."""
    return (value or "").split()


def expand_unknown(attribute: str, value: str) -> str:
    """Expand a single `?` to one for each number of the attribute; keep other values."""
    if attribute in COUNTS and value.strip() == UNKNOWN:
        return " ".join([UNKNOWN] * COUNTS[attribute])
    return value


def with_tokens(value: str, changes: Mapping[int, str]) -> str:
    """Replace the i-th parts of `value`, and keep every other character; an `InputError` for fewer parts."""
    parts = re.split(r"(\S+)", value)  # white space and numbers alternate: number i is part 2 i + 1
    if 2 * max(changes, default=-1) + 1 >= len(parts):
        raise InputError(
            f"'{value[:60]}' has too few numbers: {max(changes) + 1} or more are needed"
        )
    for i, new in changes.items():
        parts[2 * i + 1] = new
    return "".join(parts)


def has_unknown(element: Element | None, attribute: str, *indices: int) -> bool:
    """Test if one of the attribute's numbers (any, when no index is given) is `?`."""
    if element is None:
        return False
    unknown = [part == UNKNOWN for part in tokens(element.get(attribute))]
    if not indices:
        return any(unknown)
    return any(unknown[i] for i in indices if i < len(unknown))


ATTACH = "attach"


@dataclass(frozen=True, slots=True, eq=False)
class AttachedPart:
    """A part of an attached model."""

    content: Element  # a body, a frame, or the whole worldbody of the model
    model: Document  # the model that it is part of
    is_own: bool  # True if the same model attaches it
    # The `<attach>` elements that bring it, the outermost first. MuJoCo puts their prefixes before
    # the names of its elements.
    attachments: tuple[Element, ...]

    @property
    def prefix(self) -> str:
        return prefix(self.attachments)

    def overlaps(self, other: AttachedPart) -> bool:
        """Test if one contains the other, or both are the same."""
        own, its = self.content, other.content
        return own is its or own in its.iterancestors() or its in own.iterancestors()


def find_attached(
    attach: Element, model: Document, attachments: tuple[Element, ...]
) -> AttachedPart | None:
    """Find the content of an `<attach>` in `model`, which `attachments` attach; None without it."""
    called = attach.get("model")
    source = model if called is None else model.models.get(called)
    if source is None:
        return None
    # Without a body or a frame, `<attach>` brings the whole world of another model.
    content = source.root.find("worldbody") if called else None
    for tag in ("body", "frame"):
        name = attach.get(tag)
        if name is not None:
            named = (part for part in source.root.iter(tag) if part.get("name") == name)
            content = next(named, None)
            break
    if content is None:
        return None
    return AttachedPart(content, source, called is None, (*attachments, attach))


def prefix(attachments: Sequence[Element]) -> str:
    """Return the prefix of names by nested `<attach>` elements, the outermost first."""
    return "".join(attach.get("prefix") or "" for attach in attachments)


def attached_names(attach: Element, document: Document) -> set[str]:
    """Return the names in the scene of all elements of the model that an `<attach>` brings."""
    content = find_attached(attach, document, ())
    if content is None or content.is_own:
        return set()
    parts = elements(content.model.root)
    return {content.prefix + name for part in parts if (name := part.get("name"))}


def iter_ancestors(element: Element, attachments: Sequence[Element]) -> Iterator[Element]:
    """Yield the ancestors of an element from inside out, including those of the `<attach>` elements."""
    yield from element.iterancestors()
    for attach in reversed(attachments):
        yield from attach.iterancestors()
