"""MJCF files read as untrusted input: no DTD, no entities, no network, nothing outside the scene's
folder.

A `Document` is the parsed main file with its includes expanded, which remembers what stood in the
main text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
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

MAX_INCLUDES = 100
"""Most files that a scene includes, and most models that it attaches."""

MAX_ALL_BYTES = 30_000_000
"""Most bytes of all of them together."""

MAX_ASSET_BYTES = 200_000_000
"""Most bytes of all meshes, textures and height fields of a scene together."""

UNKNOWN = "?"
"""Written in place of a number that is to be measured."""

_COUNTS = {"pos": 3, "diaginertia": 3, "fullinertia": 6}
"""How many numbers a single `?` stands for."""

_FILE_ATTRIBUTES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """An MJCF file, parsed.

    Attributes:
        text: the main file.
        root: its elements, included files expanded in place.
        index: for every element of the main text, how many start tags come before its own.
        folder: where relative file names start, None for text without files.
        files: every other file it needs, absolute.
        attached: roots of the models that it attaches, and of those that these do.
    """

    text: str
    root: Element
    index: Mapping[Element, int]
    folder: Path | None
    files: tuple[Path, ...]
    attached: tuple[Element, ...] = ()

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


def read_text(path: Path) -> str:
    """The content of an XML file.

    Raises:
        InputError: not a regular file, not readable, too large or not utf-8.
    """
    return files.read_text(path, MAX_BYTES, "an MJCF scene")


def parse_xml(text: str, where: str) -> Element:
    """The root of a well-formed document without a DTD; `where` names it in messages.

    Raises:
        InputError: malformed (with line and column), a DTD or entities, too deep, too large, not
            `<mujoco>`.
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
    if root.tag != "mujoco":
        raise InputError(f"{where} is not MJCF: its root is <{root.tag}>, not <mujoco>")
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


def read_document(path: Path) -> Document:
    """A scene file with everything it includes.

    Raises:
        InputError: unreadable, malformed, files missing or outside the scene's folder, or more in
            it than is read.
    """
    return parse_document(read_text(path), path.resolve().parent, str(path))


def parse_document(text: str, folder: Path | None = None, where: str = "the scene") -> Document:
    """As `read_document`, from text; `folder` is where relative file names start."""
    return _Reader(folder).document(text, where)


def compiler_settings(root: Element) -> dict[str, str]:
    """What a model tells MuJoCo's compiler; later elements overrule earlier ones."""
    found: dict[str, str] = {}
    for compiler in root.iterfind("compiler"):
        found.update({str(name): str(value) for name, value in compiler.items()})
    return found


@dataclass(slots=True)
class _Reader:
    """What reading one scene has taken so far: of its files, and of those that they name."""

    folder: Path | None
    bytes: int = 0
    asset_bytes: int = 0
    models: int = 0
    within: tuple[Path, ...] = ()
    """The attached models that this one is part of."""

    def document(self, text: str, where: str) -> Document:
        root = self.parsed(text, where)
        index = {element: i for i, element in enumerate(elements(root))}
        found: list[Path] = []
        self._expand_includes(root, where, found)
        attached = self._check_assets(root, where, found)
        for element in elements(root):
            for attribute in _COUNTS.keys() & set(element.keys()):
                element.set(attribute, spelled_out(attribute, element.get(attribute) or ""))
        files = tuple(dict.fromkeys(found))
        return Document(text, root, index, self.folder, files, tuple(attached))

    def parsed(self, text: str, where: str) -> Element:
        """The root of one more text."""
        self.bytes += len(text)
        if self.bytes > MAX_ALL_BYTES:
            raise InputError(
                f"{where}: the scene and what it includes are larger than "
                f"{MAX_ALL_BYTES // 1_000_000} MB together, too large for an MJCF scene"
            )
        return parse_xml(text, where)

    def _expand_includes(self, root: Element, where: str, found: list[Path]) -> None:
        while (include := root.find(".//include")) is not None:
            path = _inside(self.folder, include.get("file") or "", include, where)
            if path in found:
                raise InputError(f"{where}: {label(include)} includes {path.name} a second time")
            found.append(path)
            if len(found) > MAX_INCLUDES:
                raise InputError(f"{where} includes more than {MAX_INCLUDES} files")
            _replace(include, self.parsed(read_text(path), str(path)), where)

    def _check_assets(self, root: Element, where: str, found: list[Path]) -> list[Element]:
        """Look for every file that is named; the roots of the attached models."""
        attached: list[Element] = []
        settings = compiler_settings(root)
        for element in elements(root):
            for attribute in _FILE_ATTRIBUTES:
                name = element.get(attribute)
                if name is None or element.tag == "include":
                    continue
                path = _inside(self.folder, _located(name, element, settings), element, where)
                found.append(path)
                if element.tag == "model":
                    model = self._attached(path, where)
                    found.extend(model.files)
                    attached += [model.root, *model.attached]
                else:
                    self._take_asset(path, element, where)
        return attached

    def _attached(self, path: Path, where: str) -> Document:
        """A model that the scene attaches, which has its own folder and may attach others."""
        if path in self.within:
            raise InputError(f"{where} attaches {path.name}, of which it is a part")
        self.models += 1
        if self.models > MAX_INCLUDES:
            raise InputError(f"{where} attaches more than {MAX_INCLUDES} models")
        within = (*self.within, path)
        inner = _Reader(path.parent, self.bytes, self.asset_bytes, self.models, within)
        document = inner.document(read_text(path), str(path))
        self.bytes, self.asset_bytes = inner.bytes, inner.asset_bytes
        self.models = inner.models
        return document

    def _take_asset(self, path: Path, element: Element, where: str) -> None:
        self.asset_bytes += path.stat().st_size
        if self.asset_bytes > MAX_ASSET_BYTES:
            raise InputError(
                f"{where}: with {label(element)} the scene's meshes and pictures are larger than "
                f"{MAX_ASSET_BYTES // 1_000_000} MB together; use smaller ones"
            )


def elements(root: Element) -> Iterator[Element]:
    """All elements below and including `root`, in document order, without comments and
    instructions."""
    return root.iter(etree.Element)  # pyright: ignore[reportUnknownMemberType, reportArgumentType, reportReturnType]


def children(element: Element) -> Iterator[Element]:
    """Child elements without comments and instructions."""
    return (child for child in element if isinstance(child.tag, str))


def label(element: Element) -> str:
    """How messages call an element: `<geom name="top"> (line 12)`."""
    name = element.get("name")
    shown = f'<{element.tag} name="{name[:60]}">' if name else f"<{element.tag}>"
    return f"{shown} (line {element.sourceline})"


def tokens(value: str | None) -> list[str]:
    """The whitespace-separated parts of an attribute."""
    return (value or "").split()


def spelled_out(attribute: str, value: str) -> str:
    """A single `?` as one for each number it stands for; other values as they are."""
    return (
        " ".join([UNKNOWN] * _COUNTS[attribute])
        if attribute in _COUNTS and value.strip() == UNKNOWN
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
    """Whether one of the attribute's numbers (all, when no index is given) is written `?`."""
    parts = tokens(element.get(attribute)) if element is not None else []
    chosen = indices or range(len(parts))
    return any(i < len(parts) and parts[i] == UNKNOWN for i in chosen)


def _replace(include: Element, included: Element, where: str) -> None:
    parent = include.getparent()
    if parent is None:
        raise InputError("<include> cannot be the root of a scene")
    if len(list(include.iterancestors())) + _depth(included) > MAX_DEPTH:
        raise InputError(
            f"{where}: {label(include)} makes the scene's elements nested deeper than {MAX_DEPTH}"
        )
    at = parent.index(include)
    parent[at : at + 1] = list(included)


def _depth(root: Element) -> int:
    """How many elements there are from the root to the deepest one, both counted."""
    depth = deepest = 0
    for event, _ in etree.iterwalk(root, events=("start", "end")):
        depth += 1 if event == "start" else -1
        deepest = max(deepest, depth)
    return deepest


def _located(name: str, element: Element, settings: Mapping[str, str]) -> str:
    """A file name below the folder that `<compiler>` sets for its kind of asset."""
    if element.tag == "model":
        return name
    if settings.get("strippath") == "true":
        name = re.split(r"[/\\]", name)[-1]
    kind = "texturedir" if element.tag == "texture" else "meshdir"
    return str(Path(settings.get(kind) or settings.get("assetdir") or "", name))


def _inside(folder: Path | None, name: str, element: Element, where: str) -> Path:
    """An existing file below `folder`, links resolved."""
    if folder is None:
        raise InputError(
            f"{where}: {label(element)} names the file '{name[:200]}', but text alone has no folder"
        )
    home = folder.resolve()
    try:
        path = (home / name).resolve()
    except (OSError, RuntimeError, ValueError):
        raise InputError(
            f"{where}: {label(element)} names the file '{name[:200]}', which is no path"
        ) from None
    if not path.is_relative_to(home):
        raise InputError(
            f"{where}: {label(element)} names the file '{name[:200]}', which is outside the scene's "
            "folder; move it beside the scene"
        )
    if not path.exists():
        raise InputError(
            f"{where}: {label(element)} names the file '{name[:200]}', which does not exist ({path})"
        )
    files.require_regular(path, MAX_ASSET_BYTES, "a file that a scene may name")
    return path


def copy_root(document: Document) -> tuple[Element, dict[Element, Element]]:
    """A deep copy of the document's root, and which element each original became."""
    twin = deepcopy(document.root)
    return twin, dict(zip(elements(document.root), elements(twin), strict=True))
