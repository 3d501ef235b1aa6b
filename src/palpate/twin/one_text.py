"""A twin in as few texts as it takes: one, and those of attached models in which something was measured,
which cannot stand in another."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from palpate.mjcf import spans
from palpate.mjcf.document import Document, Texts

BESIDE = "twin_"
"""Comes before the names of copies of attached models."""


@dataclass(frozen=True, slots=True)
class OneText:
    """A twin's text.

    Attributes:
        main: the scene's, with the content of all included files in it where one of them has changed.
        beside: the texts of attached models that have changed, by the names that `main` and each other
            call them by: they belong into the same folder.
    """

    main: str
    beside: Mapping[str, str] = field(default_factory=dict[str, str])


def in_one(document: Document, texts: Texts) -> OneText:
    """A document's texts as they are after its twin was made, in one."""
    if not texts.parts:
        return OneText(texts.main)
    parts = {**document.texts, **texts.parts}
    models = {model: path for path, model in document.attached().items()}
    changed = [model for model in models if _has_changed(model, texts)]
    names = dict(zip((models[model] for model in changed), _names(changed), strict=True))
    beside: dict[str, str] = {}
    for model in changed:
        path = models[model]
        beside[names[path]] = _one(model, parts[path], parts, texts, names)
    return OneText(_one(document, texts.main, parts, texts, names), beside)


def _has_changed(model: Document, texts: Texts) -> bool:
    """True if something is another in a model, in what it includes or in what it attaches."""
    files = {model.path, *model.includes.values()}
    if not files.isdisjoint(texts.parts):
        return True
    return any(_has_changed(inner, texts) for inner in model.attached().values())


def _names(models: list[Document]) -> Iterator[str]:
    taken: set[str] = set()
    for model in models:
        assert model.path is not None
        name, count = f"{BESIDE}{model.path.name}", 1
        while name in taken:
            count += 1
            name = f"{BESIDE}{model.path.stem}_{count}{model.path.suffix}"
        taken.add(name)
        yield name


def _one(
    document: Document,
    text: str,
    parts: Mapping[Path, str],
    texts: Texts,
    names: Mapping[Path, str],
) -> str:
    """Text of one model, with other names for the models that it attaches."""
    renamed: dict[str, str] = {}
    in_includes = not texts.parts.keys().isdisjoint(document.includes.values())
    for named in document.named:
        is_own = named.element.tag == "model" and named.model == document.path
        if is_own and named.path in names:
            renamed[named.name] = renamed[document.beside[named.name]] = names[named.path]
            in_includes |= document.index[named.element].file != document.path
    if in_includes:
        text = spans.inline_includes(text, document.includes, document.beside, parts)
    return _renamed(text, renamed)


def _renamed(text: str, names: Mapping[str, str]) -> str:
    data = text.encode("utf-8")
    changes: list[spans.Change] = []
    for tag in spans.scan(text):
        name = html.unescape(tag.value(data, "file"))
        if tag.name == "model" and name in names:
            changes.append(spans.set_attribute(tag, "file", names[name]))
    return spans.changed(text, changes)
