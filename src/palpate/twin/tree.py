"""A twin written where it is wanted, so that it loads there: its own text, the files that it includes
as a tree, and the meshes and pictures that they name."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from palpate.errors import InputError
from palpate.mjcf import spans
from palpate.mjcf.document import Document, Named, Texts, read_text
from palpate.mjcf.reading import parse_document, reparsed


def write_tree(texts: Texts, document: Document | None, path: Path) -> tuple[Path, ...]:
    """Write a twin of `document` to `path`, which must not exist, and what it needs there.

    What lies below the scene's folder comes to lie at the same place below that of `path`, unless it
    is there already. Everything else stays where it is, and what has to be found elsewhere is named
    anew: these names, and the measured numbers, are all that differs from the user's files.

    Returns:
        Every file written, `path` first.

    Raises:
        InputError: a file that exists, or cannot be written, or a twin that does not find its files
            from there.
    """
    path = path.parent.resolve() / path.name
    if path.exists():
        raise InputError(f"'{path}' exists already: choose another name, nothing is overwritten")
    try:
        if document is None or document.folder is None or not document.files:
            return tuple(_written({path: texts.main}))
        texts = _with_folders(texts, document, path)
        tree = _Tree.of(reparsed(texts, document), texts, path)
        made = [*_written(tree.texts()), *_copied(tree.copies())]
    except OSError as error:
        raise InputError(f"cannot write '{error.filename or path}': {error.strerror}") from error
    # Wherever its files lie now, it is to find them.
    parse_document(read_text(path), path.parent, str(path), Path(path.anchor))
    return tuple(made)


def _with_folders(texts: Texts, document: Document, path: Path) -> Texts:
    """The folders that `<compiler>` sets outside of the scene's own, named in full, which leaves the
    names of all their files as they are."""
    after = reparsed(texts, document)
    assert after.folder is not None
    folder = after.folder.resolve()
    made: dict[Path | None, dict[tuple[int, str], str]] = {}
    for compiler in after.root.iterfind("compiler"):
        place = after.index[compiler]
        for attribute in ("assetdir", "meshdir", "texturedir"):
            meant = (folder / (compiler.get(attribute) or "")).resolve()
            found = (path.parent / (compiler.get(attribute) or "")).resolve()
            if not meant.is_relative_to(folder) and found != meant:
                made.setdefault(place.file, {})[place.number, attribute] = str(meant)
    parts = dict(texts.parts)
    for file, names in made.items():
        if file is not None:
            parts[file] = _named_anew(parts.get(file, after.texts[file]), names)
    return Texts(_named_anew(texts.main, made.get(None, {})), parts)


def _named_anew(text: str, names: Mapping[tuple[int, str], str]) -> str:
    """A text with other values of attributes, by number of the element and name."""
    tags = spans.scan(text)
    changes: list[spans.Change] = []
    for (number, attribute), value in names.items():
        changes.append(spans.set_attribute(tags[number], attribute, value))
    return spans.changed(text, changes)


def _written(texts: Mapping[Path, str]) -> Iterator[Path]:
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="")
        yield path


def _copied(copies: Mapping[Path, Path]) -> Iterator[Path]:
    for original, copy in copies.items():
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(original, copy)
        yield copy


@dataclass(slots=True, eq=False)
class _Tree:
    """Layout of a twin's files.

    Attributes:
        after: the twin, read from the user's folder.
        changed: its included files that are not as they lie there.
        path: of its main text.
        places: of every other file, by its original.
    """

    after: Document
    changed: dict[Path, str]
    path: Path
    places: dict[Path, Path] = field(default_factory=dict[Path, Path])

    @classmethod
    def of(cls, after: Document, texts: Texts, path: Path) -> _Tree:
        tree = cls(after, {}, path)
        for original in after.files:
            tree.places[original] = tree._usual_place(original)
        for named in after.named:
            # The files of an attached model are found from its own place.
            apart = (named.element.tag == "model" or named.model) and not tree._is_whole()
            if apart or Path(named.located).is_absolute():
                tree.places[named.path] = named.path
        for original, text in texts.parts.items():
            tree._change(original, text)
        while tree._renames():
            pass
        return tree

    def texts(self) -> dict[Path, str]:
        """The main text and the changed files, by where they come to lie."""
        found = {self.path: self._renamed(None, self.after.text)}
        for original, text in self.changed.items():
            found[self.places[original]] = self._renamed(original, text)
        return found

    def copies(self) -> dict[Path, Path]:
        """Targets of unchanged files that have to be copied."""
        found: dict[Path, Path] = {}
        for original, place in self.places.items():
            if original not in self.changed and not place.exists():
                found[original] = place
        return found

    def _renames(self) -> bool:
        """True if there was an included file yet in which another name makes a change."""
        for named in self.after.named:
            file = self.after.index[named.element].file
            if file is not None and file not in self.changed and self._needs_other_name(named):
                self._change(file, self.after.texts[file])
                return True
        return False

    def _change(self, original: Path, text: str) -> None:
        self.changed[original] = text
        self.places[original] = self._free_place(original)

    def _renamed(self, file: Path | None, text: str) -> str:
        """A text with other names for files that are found elsewhere."""
        names: dict[tuple[int, str], str] = {}
        for named in self.after.named:
            place = self.after.index[named.element]
            if place.file == file and self._needs_other_name(named):
                names[place.number, named.attribute] = self._name(named)
        return _named_anew(text, names)

    def _name(self, named: Named) -> str:
        """The name by which a file is found from where the twin, or the model that names it, lies."""
        place, folder = self.places[named.path], self._folder(named)
        is_bare = named.located == named.name
        if is_bare and place.is_relative_to(folder):
            return place.relative_to(folder).as_posix()
        return str(place)

    def _needs_other_name(self, named: Named) -> bool:
        """True if MuJoCo would not find it: from the main text, else from the file that names it."""
        wanted = self.places[named.path]
        found = Path(os.path.normpath(self._folder(named) / named.located))
        file = self.after.index[named.element].file
        if file is not None and found != wanted and not self._will_exist(found):
            found = Path(os.path.normpath(self.places[file].parent / named.name))
        return found != wanted

    def _folder(self, named: Named) -> Path:
        """Folder to which a name is relative."""
        return (self.path if named.model is None else self.places[named.model]).parent

    def _will_exist(self, path: Path) -> bool:
        return path.exists() or path in self.places.values()

    def _is_whole(self) -> bool:
        """True if all files lie below the scene's folder."""
        return all(self._same_place(original) is not None for original in self.after.files)

    def _usual_place(self, original: Path) -> Path:
        """Place of an unchanged file: below the twin's folder, unless another lies there already,
        else its original place."""
        place = self._same_place(original)
        if place is None or (place.exists() and not _is_same(place, original)):
            return original
        return place

    def _same_place(self, original: Path) -> Path | None:
        """Place below the twin's folder like that below the scene's; None outside of that."""
        assert self.after.folder is not None
        folder = self.after.folder.resolve()
        if not original.is_relative_to(folder):
            return None
        return self.path.parent / original.relative_to(folder)

    def _free_place(self, original: Path) -> Path:
        """Place for a changed file: under its own name, else under the twin's and its own."""
        place = self._same_place(original)
        if place is not None and not place.exists():
            return place
        beside = self.path.parent / original.name if place is None else place
        place = beside.with_name(f"{self.path.stem}_{original.name}")
        if place.exists():
            raise InputError(f"'{place}' exists already: choose another name for the twin")
        return place


def _is_same(one: Path, other: Path) -> bool:
    if one.samefile(other):
        return True
    return one.stat().st_size == other.stat().st_size and one.read_bytes() == other.read_bytes()
