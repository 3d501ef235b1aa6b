"""Files of a twin: written to a path, packed into one folder, or in one text."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from palpate.common.errors import InputError
from palpate.mjcf.document import Document, FileReference, Texts, read_text
from palpate.mjcf.edits import (
    TextChange,
    apply_changes,
    inline_includes,
    remove_attribute,
    scan,
    set_attribute,
)
from palpate.mjcf.reading import parse_document, reparse

TWIN = "twin.xml"  # Name of a twin in the folder of a run
MODEL_PREFIX = "twin_"  # Prefix of the names of attached models in the same folder
ASSETS = "assets"  # Folder of copies of meshes, pictures and height fields
# Attributes of `<compiler>` that name the folders of files.
FOLDERS = ("meshdir", "texturedir", "assetdir", "strippath")
# New values, by the number of the element and the name of the attribute.
Attributes = Mapping[tuple[int, str], str]


def one_text(document: Document, texts: Texts) -> str:
    """Return the main text of a twin; a changed include puts the contents of all in place of the includes."""
    if texts.parts.keys().isdisjoint(document.includes.values()):
        return texts.main
    return inline_parts(document, texts)


def inline_parts(document: Document, texts: Texts) -> str:
    """Return the main text with the contents of all included files."""
    parts = {**document.texts, **texts.parts}
    return inline_includes(texts.main, document.includes, document.asset_paths, parts)


def pack(document: Document, folder: Path, name: str = TWIN) -> dict[str, str]:
    """Copy the files of a document into an existing `folder`, so that it loads there.

    Includes are replaced by their contents. Meshes, pictures and height fields are copied to
    `assets/`, and the names that refer to them are changed. The rest of the texts stays.

    Returns:
        The texts to write into the folder, by their names: `name`, and those of attached models.

    Raises:
        InputError: a file is missing that the document had when it was read.
        OSError: a file cannot be copied.
    """
    packing = _Packing(folder, name)
    packing.pack(document, name)
    return packing.texts


@dataclass(slots=True)
class _Packing:
    """Files that are packed into a folder."""

    folder: Path  # existing
    main: str  # name of the main text
    # Name in the folder of each file.
    names: dict[Path, str] = field(default_factory=dict[Path, str])
    # Texts of models by their names in the folder.
    texts: dict[str, str] = field(default_factory=dict[str, str])

    def pack(self, document: Document, name: str) -> None:
        """Add the text of a model, and copy its files."""
        flat = document
        if document.includes:
            flat = reparse(Texts(inline_parts(document, Texts(document.text))), document)
        tags = scan(flat.text)
        data = flat.text.encode("utf-8")
        # Change the names of files to those in the folder.
        changes: list[TextChange] = []
        for named in flat.named:
            if named.model == flat.path:
                if named.path not in self.names:
                    self.add(named.path, named.element.tag == "model", flat)
                tag = tags[flat.index[named.element].number]
                packed = self.names[named.path]
                changes.append(set_attribute(tag, named.attribute, packed))
        # Remove the folders of the compiler: all names are relative to the main text.
        for tag in tags:
            for attribute in FOLDERS if tag.name == "compiler" else ():
                if attribute in tag.attributes:
                    changes.append(remove_attribute(data, tag, attribute))
        self.texts[name] = apply_changes(flat.text, changes)

    def add(self, path: Path, is_model: bool, document: Document) -> None:
        """Pack a file under a free name: an asset under its own, a model in the folder of the main text."""
        # Add a number until the name is free.
        taken = {self.main, *self.names.values()}
        name, number = (f"{MODEL_PREFIX}{path.name}" if is_model else f"{ASSETS}/{path.name}"), 1
        while name in taken:
            number += 1
            numbered = f"{MODEL_PREFIX}{path.stem}-{number}{path.suffix}"
            name = numbered if is_model else f"{ASSETS}/{number}/{path.name}"
        self.names[path] = name
        if is_model:
            self.pack(document.attached()[path], name)
        else:
            target = self.folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)


def write_files(texts: Texts, document: Document | None, path: Path) -> tuple[Path, ...]:
    """Write a twin of `document` to `path`, which must not exist, with the files that it needs
    there.

    Files below the scene's folder are written to the same places below the folder of `path`, unless
    they exist there. All others stay in their places. Names that MuJoCo would not find are changed.
    These names and the measured numbers are the only differences from the user's files.

    Returns:
        Every file written, `path` first.

    Raises:
        InputError: a file that exists, or cannot be written, or a twin that does not find its files
            from there.
    """
    path = path.parent.resolve() / path.name
    if path.exists():
        raise InputError(f"'{path}' exists already: choose another name, nothing is overwritten")
    layout: _Layout | None = None
    # Plan the layout, then write the changed files and copy the others.
    try:
        if document is not None and document.folder is not None and document.files:
            texts = with_absolute_folders(texts, document, path)
            layout = _Layout(reparse(texts, document), texts, path)
        written = {path: texts.main} if layout is None else layout.texts()
        for file, text in written.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8", newline="")
        copies = {} if layout is None else layout.copies()
        for original, copy in copies.items():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(original, copy)
    except OSError as error:
        raise InputError(f"cannot write '{error.filename or path}': {error.strerror}") from error
    if layout is not None:
        # Read the twin back: its files must be found from their new places.
        parse_document(read_text(path), path.parent, str(path), Path(path.anchor))
    return (*written, *copies.values())


def with_absolute_folders(texts: Texts, document: Document, path: Path) -> Texts:
    """Make the `<compiler>` folders outside of the scene's folder absolute, so that names stay valid."""
    after = reparse(texts, document)
    assert after.folder is not None
    folder = after.folder.resolve()
    values_of: dict[Path | None, dict[tuple[int, str], str]] = {}
    # Change a folder only if it would be another one from the new path.
    for compiler in after.root.iterfind("compiler"):
        place = after.index[compiler]
        for attribute in ("assetdir", "meshdir", "texturedir"):
            name = compiler.get(attribute) or ""
            intended, located = (folder / name).resolve(), (path.parent / name).resolve()
            if not intended.is_relative_to(folder) and located != intended:
                values_of.setdefault(place.file, {})[place.number, attribute] = str(intended)
    parts = dict(texts.parts)
    for file, values in values_of.items():
        if file is not None:
            parts[file] = with_values(parts.get(file, after.texts[file]), values)
    return Texts(with_values(texts.main, values_of.get(None, {})), parts)


def with_values(text: str, values: Attributes) -> str:
    """Change values of attributes in a text."""
    tags = scan(text)
    changes: list[TextChange] = []
    for (number, attribute), value in values.items():
        changes.append(set_attribute(tags[number], attribute, value))
    return apply_changes(text, changes)


class _Layout:
    """Layout of a twin's files around the `path` of its main text.

    Attributes:
        after: the twin, read from the user's folder.
        changed: its included files that differ from those in the user's folder.
        places: place of every file except the main text, by its original.
    """

    def __init__(self, after: Document, texts: Texts, path: Path) -> None:
        self.after, self.path = after, path
        self.changed: dict[Path, str] = {}
        self.places: dict[Path, Path] = {}
        for original in after.files:
            # Copy an unchanged file, unless a different one has its place already.
            place = self.same_place(original)
            taken = place is not None and place.exists() and not same_file(place, original)
            self.places[original] = original if place is None or taken else place
        below = all(self.same_place(original) is not None for original in after.files)
        for named in after.named:
            # Files of an attached model are found relative to its own place.
            separate = (named.element.tag == "model" or named.model) and not below
            if separate or Path(named.located).is_absolute():
                self.places[named.path] = named.path
        for original, text in texts.parts.items():
            self.change(original, text)
        # Repeat: the new place of a changed file may change the file that includes it.
        while self.rename_one():
            pass

    def texts(self) -> dict[Path, str]:
        """The main text and the changed files, by their new places."""
        texts = {self.path: self.with_new_names(None, self.after.text)}
        for original, text in self.changed.items():
            texts[self.places[original]] = self.with_new_names(original, text)
        return texts

    def copies(self) -> dict[Path, Path]:
        """New places of the unchanged files that must be copied."""
        copies: dict[Path, Path] = {}
        for original, place in self.places.items():
            if original not in self.changed and not place.exists():
                copies[original] = place
        return copies

    def rename_one(self) -> bool:
        """Change the first unchanged file whose text needs a new name; return False if there is none."""
        for named in self.after.named:
            file = self.after.index[named.element].file
            if file is not None and file not in self.changed and self.needs_new_name(named):
                self.change(file, self.after.texts[file])
                return True
        return False

    def change(self, original: Path, text: str) -> None:
        """Assign a free place to a changed file: its own, else one with the twin's name as a prefix."""
        self.changed[original] = text
        place = self.same_place(original)
        if place is None or place.exists():
            target = self.path.parent / original.name if place is None else place
            place = target.with_name(f"{self.path.stem}_{original.name}")
            if place.exists():
                raise InputError(f"'{place}' exists already: choose another name for the twin")
        self.places[original] = place

    def with_new_names(self, file: Path | None, text: str) -> str:
        """Change the names of files that would not be found: relative ones below their folder, else absolute ones."""
        values: dict[tuple[int, str], str] = {}
        for named in self.after.named:
            index = self.after.index[named.element]
            if index.file == file and self.needs_new_name(named):
                place, folder = self.places[named.path], self.folder_of(named)
                relative = named.located == named.name and place.is_relative_to(folder)
                name = place.relative_to(folder).as_posix() if relative else str(place)
                values[index.number, named.attribute] = name
        return with_values(text, values)

    def needs_new_name(self, named: FileReference) -> bool:
        """True if MuJoCo would not find a file, relative to the main text or to the file that names it."""
        # Resolve the name as MuJoCo does: first relative to the main text.
        wanted = self.places[named.path]
        located = Path(os.path.normpath(self.folder_of(named) / named.located))
        file = self.after.index[named.element].file
        will_exist = located.exists() or located in self.places.values()
        if file is not None and located != wanted and not will_exist:
            located = Path(os.path.normpath(self.places[file].parent / named.name))
        return located != wanted

    def folder_of(self, named: FileReference) -> Path:
        """Folder to which a name is relative."""
        return (self.path if named.model is None else self.places[named.model]).parent

    def same_place(self, original: Path) -> Path | None:
        """Place below the twin's folder that corresponds to the one below the scene's; None outside of it."""
        assert self.after.folder is not None
        folder = self.after.folder.resolve()
        if not original.is_relative_to(folder):
            return None
        return self.path.parent / original.relative_to(folder)


def same_file(first: Path, other: Path) -> bool:
    if first.samefile(other):
        return True
    return first.stat().st_size == other.stat().st_size and first.read_bytes() == other.read_bytes()
