"""Reading of MJCF files as untrusted input: bounded in number and size, and only from the root folder.

A scene file could name any file that its reader can access. The root folder is the nearest common folder
of the scene and all files that it refers to. If that folder also holds unrelated files (a whole home, a
system folder, the root of a file system), the user must name it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path

from lxml import etree

from palpate.common import files
from palpate.common.errors import InputError
from palpate.mjcf.document import (
    COUNTS,
    MAX_ASSET_BYTES,
    MAX_DEPTH,
    Document,
    Element,
    FileReference,
    Place,
    Texts,
    compiler_settings,
    elements,
    expand_unknown,
    label,
    parse_xml,
    read_text,
)

MAX_INCLUDES = 100  # Most files that a scene includes, and most models that it attaches
MAX_ALL_BYTES = 30_000_000  # Most bytes of all of them in total
# Root elements of other formats, and their conversion to MJCF.
CONVERTED = {
    "robot": "URDF; MuJoCo reads it and saves it as MJCF: mj_saveLastXML after "
    "MjModel.from_xml_path",
    "sdf": "SDF; convert it to MJCF first, e.g. with gz-mujoco's sdformat_mjcf",
}
# Elements whose files MuJoCo reads while it parses, before it knows the folder.
_READ_AT_ONCE = ("model", "flexcomp")
_FILE_ATTRIBUTES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


def read_document(path: Path, home: Path | None = None) -> Document:
    """Read a scene file with all files that it includes.

    Files are read only from below `home`, by default the root folder.
    Raises InputError: unreadable, malformed, too large, or with files missing or outside of `home`.
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
    """Parse a document from text, as `read_document`.

    Relative file names start at `folder`. `robots` is that of `Document`. `texts` replace included files.
    """
    start = None if folder is None else folder.resolve()
    reader = _Reader(folder, start, home and home.resolve(), given=texts or {})
    return replace(reader.document(text, where), robots=tuple(robots))


def reparse(texts: Texts, like: Document) -> Document:
    """Parse another version of a document's text and of some included files, with its other files."""
    parts = {**like.texts, **texts.parts}
    return parse_document(texts.main, like.folder, home=like.home, robots=like.robots, texts=parts)


@dataclass(slots=True)
class _Reader:
    """Reader of one scene or attached model, with the size of its files so far."""

    folder: Path | None
    start: Path | None  # Folder of the whole scene, resolved
    home: Path | None  # The only folder from which files are read; None: any folder near the scene
    bytes: int = 0
    asset_bytes: int = 0
    models: int = 0
    # Files of the attached models that contain this one, its own last.
    within: tuple[Path, ...] = ()
    # Folder of the included file that an element came from.
    origins: dict[Element, Path] = field(default_factory=dict[Element, Path])
    # Texts in place of included files.
    given: Mapping[Path, str] = field(default_factory=dict[Path, str])
    index: dict[Element, Place] = field(default_factory=dict[Element, Place])
    texts: dict[Path, str] = field(default_factory=dict[Path, str])
    named: list[FileReference] = field(default_factory=list[FileReference])
    # Attached models by name.
    attachable: dict[str, Document] = field(default_factory=dict[str, Document])
    # All attached models so far, with the number of models that each attaches. A file is read once,
    # and counted as often as it is attached.
    attached: dict[Path, tuple[Document, int]] = field(
        default_factory=dict[Path, tuple[Document, int]]
    )
    # Assets found in the folder of the included file that names them, relative to `folder`, by
    # name.
    asset_paths: dict[str, str] = field(default_factory=dict[str, str])

    def document(self, text: str, where: str) -> Document:
        root = self.parse_text(text, where, self.path)
        if root.tag == "mujocoinclude":
            raise InputError(
                f"{where} is a part that scenes include (<mujocoinclude>); give a scene that includes it"
            )
        if (other := CONVERTED.get(str(root.tag))) is not None:
            raise InputError(f"{where} is not MJCF but {other}")
        if root.tag != "mujoco":
            raise InputError(f"{where} is not MJCF: its root is <{root.tag}>, not <mujoco>")
        # Expand the includes, then find and check the assets.
        includes = self._expand_includes(root, where)
        files = list(includes.values())
        self._check_assets(root, where, files)
        for element in elements(root):
            for attribute in COUNTS.keys() & set(element.keys()):
                element.set(attribute, expand_unknown(attribute, element.get(attribute) or ""))
        # The root folder holds the scene and all files found.
        common_root = None if self.start is None else reduce(common, files, self.start)
        return Document(
            text=text,
            root=root,
            index=self.index,
            folder=self.folder,
            home=self.home or common_root,
            files=tuple(dict.fromkeys(files)),
            includes=includes,
            asset_paths=self.asset_paths,
            texts=self.texts,
            named=tuple(self.named),
            models=self.attachable,
            path=self.path,
        )

    @property
    def path(self) -> Path | None:
        """Path of an attached model."""
        return self.within[-1] if self.within else None

    def parse_text(self, text: str, where: str, file: Path | None) -> Element:
        """Parse one more text, and index its elements; `file` is that of `Place`."""
        self.bytes += len(text)
        if self.bytes > MAX_ALL_BYTES:
            raise InputError(
                f"{where}: the scene and what it includes are larger than "
                f"{MAX_ALL_BYTES // 1_000_000} MB together, too large for an MJCF scene"
            )
        root = parse_xml(text, where)
        for number, element in enumerate(elements(root)):
            self.index[element] = Place(file, number)
        return root

    def _expand_includes(self, root: Element, where: str) -> dict[str, Path]:
        """Expand each `<include>` in place; return the files by their names in it."""
        paths: dict[str, Path] = {}
        while (include := root.find(".//include")) is not None:
            name = include.get("file") or ""
            path = self._file(name, include, where)
            if path in paths.values():
                raise InputError(f"{where}: {label(include)} includes {path.name} a second time")
            paths[name] = path
            if len(paths) > MAX_INCLUDES:
                raise InputError(f"{where} includes more than {MAX_INCLUDES} files")
            text = self.given[path] if path in self.given else read_text(path)
            self.texts[path] = text
            included = self.parse_text(text, str(path), path)
            self.named.append(FileReference(include, "file", name, name, path, self.path))
            # Includes in the included file are relative to its own folder.
            self.origins |= dict.fromkeys(elements(included), path.parent)
            _replace(include, included, where)
        return paths

    def _check_assets(self, root: Element, where: str, files: list[Path]) -> None:
        """Find all named files, and read the attached models."""
        # Each attribute that names a file, in document order.
        settings = compiler_settings(root)
        for element in elements(root):
            for attribute in _FILE_ATTRIBUTES:
                name = element.get(attribute)
                if name is None or element.tag == "include":
                    continue
                located = _locate_file(name, element, settings)
                path = self._file(located, element, where, name)
                files.append(path)
                self.named.append(FileReference(element, attribute, name, located, path, self.path))
                is_there = _exists(self.folder, located)
                if element.tag in _READ_AT_ONCE or not is_there:
                    # MuJoCo would look in the working directory, or not find it at all.
                    element.set(attribute, str(path))
                if element.tag == "model" or not is_there:
                    self.asset_paths[name] = os.path.relpath(path, self.folder)
                if element.tag == "model":
                    model = self._read_attachment(path, where)
                    files.extend(model.files)
                    called = element.get("name") or model.root.get("model") or path.stem
                    self.attachable[called] = model
                    continue
                self.asset_bytes += path.stat().st_size
                if self.asset_bytes > MAX_ASSET_BYTES:
                    raise InputError(
                        f"{where}: with {label(element)} the scene's meshes and pictures are larger "
                        f"than {MAX_ASSET_BYTES // 1_000_000} MB together; use smaller ones"
                    )

    def _file(self, name: str, element: Element, where: str, bare: str = "") -> Path:
        """Return the path of the file that an element names."""
        # It is relative to the scene's folder, else to the folder of the included file that has the
        # element. In the latter it has its `bare` name, without the folders set by `<compiler>`.
        # MuJoCo looks first in the scene's folder, then in that of the included file.
        origin = self.origins.get(element)
        if origin is not None and not _exists(self.folder, name):
            located = bare or name
            if _exists(origin, located):
                name = str(origin / located)
        what = f"{where}: {label(element)} names the file '{name[:200]}'"
        if self.folder is None or self.start is None:
            raise InputError(f"{what}, but a scene from text has no folder")
        try:
            path = (self.folder.resolve() / name).resolve()
        except (OSError, RuntimeError, ValueError):
            raise InputError(f"{what}, which is not a valid path") from None
        # Checked before the file's existence: a scene must not probe for files elsewhere.
        if self.home is not None:
            if not path.is_relative_to(self.home):
                raise InputError(
                    f"{what}, which is outside of the scene's root folder '{self.home}'; "
                    f"allow another with root={common(self.start, path)}, or move the file"
                )
        elif not path.is_relative_to(self.start):
            root = common(self.start, path)
            if is_too_wide(root):
                raise InputError(
                    f"{what}; the nearest common folder with the scene is '{root}', which is only read with "
                    f"root={root}; or move the file next to the scene"
                )
        if not path.exists():
            raise InputError(f"{what}, which does not exist ({path})")
        files.require_regular(path, MAX_ASSET_BYTES, "a file that a scene may name")
        return path

    def _read_attachment(self, path: Path, where: str) -> Document:
        """Read an attached model, with its own folder and the models that it attaches."""
        if path in self.within:
            raise InputError(f"{where} attaches {path.name}, which contains it")
        # Models that attach one another double at each level: count every copy, read each file once.
        document, inside = self.attached.get(path, (None, 0))
        self.models += 1 + inside
        if self.models > MAX_INCLUDES:
            raise InputError(f"{where} attaches more than {MAX_INCLUDES} models")
        if document is not None:
            return document
        before = self.models
        text = self.given[path] if path in self.given else read_text(path)
        # A reader of the attached model, with the amounts so far.
        inner = _Reader(
            folder=path.parent,
            start=self.start,
            home=self.home,
            bytes=self.bytes,
            asset_bytes=self.asset_bytes,
            models=self.models,
            within=(*self.within, path),
            given=self.given,
            attached=self.attached,
        )
        document = inner.document(text, str(path))
        self.bytes, self.asset_bytes, self.models = inner.bytes, inner.asset_bytes, inner.models
        # Take over its elements, texts and file references.
        self.index |= inner.index
        self.texts |= {**inner.texts, path: text}
        self.named += inner.named
        self.attached[path] = document, self.models - before
        return document


def _replace(include: Element, included: Element, where: str) -> None:
    """Replace an `<include>` by the content of its file."""
    # Check the depth before the content is inserted.
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
    """Return the depth of the tree: number of elements from the root to the deepest one."""
    depth = deepest = 0
    for event, _ in etree.iterwalk(root, events=("start", "end")):
        depth += 1 if event == "start" else -1
        deepest = max(deepest, depth)
    return deepest


def _locate_file(name: str, element: Element, settings: Mapping[str, str]) -> str:
    """Return a file name below the folder that `<compiler>` sets for its kind of asset."""
    if element.tag == "model":
        return name
    if settings.get("strippath") == "true":
        name = re.split(r"[/\\]", name)[-1]
    kind = "texturedir" if element.tag == "texture" else "meshdir"
    return str(Path(settings.get(kind) or settings.get("assetdir") or "", name))


def _exists(folder: Path | None, name: str) -> bool:
    """Test if a file of that name exists, relative to `folder`."""
    try:
        return folder is not None and (folder / name).exists()
    except (OSError, ValueError):
        return False


HOMES = ("/home", "/Users")  # Folders of homes: each folder in them is a home
# System folders of Linux and macOS; of `/usr` and `/var` also each folder in them.
SYSTEM = (
    *("/bin", "/boot", "/dev", "/etc", "/lib", "/lib64", "/media", "/mnt", "/opt", "/private"),
    *("/proc", "/root", "/run", "/sbin", "/srv", "/sys", "/tmp", "/usr", "/var", "/var/tmp"),
    *("/Applications", "/Library", "/System", "/Volumes"),
)


def common(folder: Path, path: Path) -> Path:
    """Return the nearest folder that holds a resolved folder and a resolved file."""
    return Path(os.path.commonpath([folder, path.parent]))


def is_too_wide(root: Path) -> bool:
    """Test for a home, a system folder or a file system's root, which the user must name."""
    # The user's home, and all folders above it.
    own = Path.home().resolve()
    if root == root.parent or root in (own, *own.parents):
        return True
    name, above = root.as_posix(), root.parent.as_posix()
    return name in (*SYSTEM, *HOMES) or above in (*HOMES, "/usr", "/var", "/private")
