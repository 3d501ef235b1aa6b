"""MJCF files read as untrusted input: bounded in number and size, and nothing outside the folder that
a scene's files may lie in."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path

from lxml import etree

from palpate.errors import InputError
from palpate.files import read as files
from palpate.mjcf.document import (
    COUNTS,
    MAX_ASSET_BYTES,
    MAX_DEPTH,
    Document,
    Element,
    Named,
    Place,
    Texts,
    compiler_settings,
    elements,
    label,
    parse_xml,
    read_text,
    spelled_out,
)
from palpate.mjcf.root import common, is_too_wide

MAX_INCLUDES = 100
"""Most files that a scene includes, and most models that it attaches."""

MAX_ALL_BYTES = 30_000_000
"""Most bytes of all of them together."""

CONVERTED = {
    "robot": "URDF; MuJoCo reads it and saves it as MJCF: mj_saveLastXML after "
    "MjModel.from_xml_path",
    "sdf": "SDF; convert it to MJCF first, e.g. with gz-mujoco's sdformat_mjcf",
}
"""Roots of other formats, and how to come from there to MJCF."""

_READ_AT_ONCE = ("model", "flexcomp")
"""Elements whose files MuJoCo reads while it parses, when it does not know of a folder yet."""

_FILE_ATTRIBUTES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


def read_document(path: Path, home: Path | None = None) -> Document:
    """A scene file with everything it includes. Files are read from below `home` alone: unless given,
    the nearest common folder of the scene and all that it refers to, where that is not too wide
    (`palpate.mjcf.root`).

    Raises:
        InputError: unreadable, malformed, files missing or outside of `home`, or more in it than
            is read.
    """
    return parse_document(read_text(path), path.resolve().parent, str(path), home)


def parse_document(
    text: str,
    folder: Path | None = None,
    where: str = "the scene",
    home: Path | None = None,
    robots: Sequence[str] = (),
    texts: Mapping[Path, str] | None = None,
) -> Document:
    """Parse a document as `read_document`, from text; relative file names start at `folder`,
    `robots` as in `Document`; `texts` replace included files."""
    start = None if folder is None else folder.resolve()
    reader = _Reader(folder, start, home and home.resolve(), given=texts or {})
    return replace(reader.document(text, where), robots=tuple(robots))


def reparsed(texts: Texts, like: Document) -> Document:
    """Another version of a document's text, and of some files that it includes, which finds the same
    other files."""
    parts = {**like.texts, **texts.parts}
    return parse_document(texts.main, like.folder, home=like.home, robots=like.robots, texts=parts)


def _root(start: Path | None, files: Sequence[Path]) -> Path | None:
    """Nearest common folder of the scene's own and of its files; None for a scene without a folder."""
    if start is None:
        return None
    return reduce(common, files, start)


@dataclass(slots=True)
class _Reader:
    """Reader of one scene, with the size of its files so far."""

    folder: Path | None
    start: Path | None
    """Folder of the whole scene, resolved."""
    home: Path | None
    """The only folder from which files are read; None: any that is near the scene (`_inside`)."""
    bytes: int = 0
    asset_bytes: int = 0
    models: int = 0
    within: tuple[Path, ...] = ()
    """The attached models that this one is part of, its own file last."""
    origins: dict[Element, Path] = field(default_factory=dict[Element, Path])
    """The folder of the included file that an element came from."""
    given: Mapping[Path, str] = field(default_factory=dict[Path, str])
    """Texts that are read in the place of included files."""
    index: dict[Element, Place] = field(default_factory=dict[Element, Place])
    texts: dict[Path, str] = field(default_factory=dict[Path, str])
    named: list[Named] = field(default_factory=list[Named])
    attachable: dict[str, Document] = field(default_factory=dict[str, Document])
    """Attached models by name."""
    attached: dict[Path, tuple[Document, int]] = field(
        default_factory=dict[Path, tuple[Document, int]]
    )
    """All of them so far, whoever attaches them, and how many each of them attaches: a file is read
    once, and counted as often as it is attached."""
    beside: dict[str, str] = field(default_factory=dict[str, str])
    """Assets found beside the included file that names them: from the scene's folder, by name."""

    def document(self, text: str, where: str) -> Document:
        root = self.parsed(text, where)
        _require_model(root, where)
        self._number(root, self.path)
        includes = self._expand_includes(root, where)
        found = list(includes.values())
        self._check_assets(root, where, found)
        for element in elements(root):
            for attribute in COUNTS.keys() & set(element.keys()):
                element.set(attribute, spelled_out(attribute, element.get(attribute) or ""))
        return Document(
            text,
            root,
            self.index,
            self.folder,
            self.home or _root(self.start, found),
            tuple(dict.fromkeys(found)),
            includes,
            self.beside,
            self.texts,
            tuple(self.named),
            self.attachable,
            path=self.path,
        )

    @property
    def path(self) -> Path | None:
        """Path of an attached model."""
        return self.within[-1] if self.within else None

    def _number(self, root: Element, file: Path | None) -> None:
        for number, element in enumerate(elements(root)):
            self.index[element] = Place(file, number)

    def parsed(self, text: str, where: str) -> Element:
        """The root of one more text."""
        self.bytes += len(text)
        if self.bytes > MAX_ALL_BYTES:
            raise InputError(
                f"{where}: the scene and what it includes are larger than "
                f"{MAX_ALL_BYTES // 1_000_000} MB together, too large for an MJCF scene"
            )
        return parse_xml(text, where)

    def _expand_includes(self, root: Element, where: str) -> dict[str, Path]:
        """Put every included file in its place; the files, by the names they are included by."""
        found: dict[str, Path] = {}
        while (include := root.find(".//include")) is not None:
            name = include.get("file") or ""
            path = self._file(name, include, where)
            if path in found.values():
                raise InputError(f"{where}: {label(include)} includes {path.name} a second time")
            found[name] = path
            if len(found) > MAX_INCLUDES:
                raise InputError(f"{where} includes more than {MAX_INCLUDES} files")
            text = self.given[path] if path in self.given else read_text(path)
            self.texts[path] = text
            included = self.parsed(text, str(path))
            self._number(included, path)
            self.named.append(Named(include, "file", name, name, path, self.path))
            self.origins |= dict.fromkeys(elements(included), path.parent)
            _replace(include, included, where)
        return found

    def _check_assets(self, root: Element, where: str, found: list[Path]) -> None:
        """Look for every file that is named, and read those that are attached."""
        settings = compiler_settings(root)
        for element in elements(root):
            for attribute in _FILE_ATTRIBUTES:
                name = element.get(attribute)
                if name is None or element.tag == "include":
                    continue
                located = _located(name, element, settings)
                path = self._file(located, element, where, name)
                found.append(path)
                self.named.append(Named(element, attribute, name, located, path, self.path))
                is_there = _exists(self.folder, located)
                if element.tag in _READ_AT_ONCE or not is_there:
                    # MuJoCo would look elsewhere: in the working directory, or nowhere.
                    element.set(attribute, str(path))
                if element.tag == "model" or not is_there:
                    self.beside[name] = os.path.relpath(path, self.folder)
                if element.tag == "model":
                    model = self._attached(path, where)
                    found.extend(model.files)
                    called = element.get("name") or model.root.get("model") or path.stem
                    self.attachable[called] = model
                else:
                    self._take_asset(path, element, where)

    def _file(self, name: str, element: Element, where: str, bare: str = "") -> Path:
        """The file that an element names: from the scene's folder, else from that of the included
        file that it stands in, there without the folders that `<compiler>` sets (`bare`)."""
        origin = self.origins.get(element)
        if origin is not None and not _exists(self.folder, name):
            beside = bare or name
            if _exists(origin, beside):
                name = str(origin / beside)
        what = f"{where}: {label(element)} names the file '{name[:200]}'"
        if self.folder is None or self.start is None:
            raise InputError(f"{what}, but text alone has no folder")
        try:
            path = (self.folder.resolve() / name).resolve()
        except (OSError, RuntimeError, ValueError):
            raise InputError(f"{what}, which is no path") from None
        self._require_near(path, self.start, what)
        if not path.exists():
            raise InputError(f"{what}, which does not exist ({path})")
        files.require_regular(path, MAX_ASSET_BYTES, "a file that a scene may name")
        return path

    def _require_near(self, path: Path, start: Path, what: str) -> None:
        """Raise InputError for a file outside of the root; nobody learns whether it exists."""
        if self.home is not None:
            if not path.is_relative_to(self.home):
                raise InputError(
                    f"{what}, which is outside of '{self.home}', the folder that this scene's files are "
                    f"read from; allow another with root={common(start, path)}, or move the file"
                )
        elif not path.is_relative_to(start) and is_too_wide(root := common(start, path)):
            raise InputError(
                f"{what}; the nearest folder that holds it and the scene is '{root}', in which files are "
                f"only read with root={root}; or move the file beside the scene"
            )

    def _attached(self, path: Path, where: str) -> Document:
        """A model that the scene attaches, which has its own folder and may attach others."""
        if path in self.within:
            raise InputError(f"{where} attaches {path.name}, of which it is a part")
        document, inside = self.attached.get(path, (None, 0))
        self.models += 1 + inside
        if self.models > MAX_INCLUDES:
            raise InputError(f"{where} attaches more than {MAX_INCLUDES} models")
        if document is not None:
            return document
        before = self.models
        text = self.given[path] if path in self.given else read_text(path)
        inner = _Reader(
            path.parent,
            self.start,
            self.home,
            self.bytes,
            self.asset_bytes,
            self.models,
            (*self.within, path),
            given=self.given,
            attached=self.attached,
        )
        document = inner.document(text, str(path))
        self.bytes, self.asset_bytes = inner.bytes, inner.asset_bytes
        self.models = inner.models
        self.index |= inner.index
        self.texts |= {**inner.texts, path: text}
        self.named += inner.named
        self.attached[path] = document, self.models - before
        return document

    def _take_asset(self, path: Path, element: Element, where: str) -> None:
        self.asset_bytes += path.stat().st_size
        if self.asset_bytes > MAX_ASSET_BYTES:
            raise InputError(
                f"{where}: with {label(element)} the scene's meshes and pictures are larger than "
                f"{MAX_ASSET_BYTES // 1_000_000} MB together; use smaller ones"
            )


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
    """Depth of the tree: number of elements from the root to the deepest one."""
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


def _exists(folder: Path | None, name: str) -> bool:
    """True if there is a file of that name, from `folder`."""
    try:
        return folder is not None and (folder / name).exists()
    except (OSError, ValueError):
        return False


def _require_model(root: Element, where: str) -> None:
    """Require a whole MJCF model."""
    if root.tag == "mujocoinclude":
        raise InputError(
            f"{where} is a part that other scenes include (<mujocoinclude>); give a scene that does"
        )
    if (other := CONVERTED.get(str(root.tag))) is not None:
        raise InputError(f"{where} is not MJCF but {other}")
    if root.tag != "mujoco":
        raise InputError(f"{where} is not MJCF: its root is <{root.tag}>, not <mujoco>")
