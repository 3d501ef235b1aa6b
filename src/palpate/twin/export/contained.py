"""MJCF with everything that it needs beside it: one folder that loads wherever it is put.

The text stays as it is, but for its includes, which stand in their places, and the names of files,
which lie in `assets/`.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from palpate.mjcf import spans
from palpate.mjcf.document import Document, Element, Texts
from palpate.mjcf.reading import reparsed
from palpate.redaction import redact

SCENE = "scene.xml"
"""The name of the scene among its files."""
ASSETS = "assets"
FOLDERS = ("meshdir", "texturedir", "assetdir", "strippath")
"""Attributes of `<compiler>` that name folders."""


def write_contained(document: Document, folder: Path) -> None:
    """Write the document as `scene.xml`, attached models beside it, and its files as `assets/…`,
    into a folder that is there.

    Raises:
        InputError: a file has gone since the document was read.
    """
    _Packing(folder).pack(document, SCENE)


@dataclass(slots=True)
class _Packing:
    """A folder that is being filled, and the names that files have got in it."""

    folder: Path
    names: dict[Path, str] = field(default_factory=dict[Path, str])

    def pack(self, document: Document, name: str) -> None:
        """Write a model and all that it needs."""
        flat = _flat(document)
        tags = spans.scan(flat.text)
        data = flat.text.encode("utf-8")
        changes: list[spans.Change] = []
        for named in flat.named:
            if named.model != flat.path:
                continue
            packed = self._packed(named.path, named.element, flat)
            tag = tags[flat.index[named.element].number]
            changes.append(spans.set_attribute(tag, named.attribute, packed))
        for tag, attribute in _places(tags):
            changes.append(spans.remove_attribute(data, tag, attribute))
        text = spans.changed(flat.text, changes)
        (self.folder / name).write_text(redact(text), encoding="utf-8", newline="")

    def _packed(self, path: Path, element: Element, document: Document) -> str:
        """The name of a file in the folder, where it is put unless it lies there."""
        if path in self.names:
            return self.names[path]
        is_model = element.tag == "model"
        name = self._free(path, is_model)
        self.names[path] = name
        if is_model:
            self.pack(document.attached()[path], name)
        else:
            target = self.folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
        return name

    def _free(self, path: Path, is_model: bool) -> str:
        """A name that no other file has. An asset's own stays: MuJoCo calls it by that. Models lie
        beside the scene: what they name is found from the same folder."""
        taken = {SCENE, *self.names.values()}
        found, number = (path.name if is_model else f"{ASSETS}/{path.name}"), 1
        while found in taken:
            number += 1
            numbered = f"{path.stem}-{number}{path.suffix}"
            found = numbered if is_model else f"{ASSETS}/{number}/{path.name}"
        return found


def _flat(document: Document) -> Document:
    """The document with what it includes in its text."""
    if not document.includes:
        return document
    text = spans.inline_includes(document.text, document.includes, document.beside, document.texts)
    return reparsed(Texts(text), document)


def _places(tags: list[spans.Tag]) -> Iterator[tuple[spans.Tag, str]]:
    """Folders for the compiler."""
    for tag in tags:
        if tag.name == "compiler":
            for attribute in FOLDERS:
                if attribute in tag.attributes:
                    yield tag, attribute
