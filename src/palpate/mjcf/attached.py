"""Content of `<attach>`: models in files of their own.

Its elements stay where they are, in the trees of their models, where values are written; MuJoCo puts
the prefixes of all `<attach>`s that bring an element, the outermost first, before its name.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate.mjcf.document import Document, Element, elements

ATTACH = "attach"


@dataclass(frozen=True, slots=True, eq=False)
class Brought:
    """A part of an attached model.

    Attributes:
        content: a body of it, a frame, or all of its world.
        model: whose it is.
        is_own: whether that is the model that attaches it.
        through: the `<attach>`s that bring it, the outermost first.
    """

    content: Element
    model: Document
    is_own: bool
    through: tuple[Element, ...]

    @property
    def prefix(self) -> str:
        """Prefix of the names of its elements."""
        return prefix(self.through)

    def overlaps(self, other: Brought) -> bool:
        """True if one is a part of the other, or both are the same."""
        mine, its = self.content, other.content
        return mine is its or mine in its.iterancestors() or its in mine.iterancestors()


def brought(attach: Element, model: Document, through: tuple[Element, ...]) -> Brought | None:
    """Attached content of `model`, which itself comes `through` others; None where its names do not
    exist, which MuJoCo reports."""
    called = attach.get("model")
    source = model if called is None else model.models.get(called)
    if source is None:
        return None
    content = _content(attach, source)
    if content is None:
        return None
    return Brought(content, source, called is None, (*through, attach))


def prefix(through: Sequence[Element]) -> str:
    """Prefix of names by nested `<attach>`s."""
    return "".join(attach.get("prefix") or "" for attach in through)


def attached_names(attach: Element, document: Document) -> set[str]:
    """Names that elements of what the scene's own `<attach>` brings have in the scene; those of the rest
    of its model among them."""
    found = brought(attach, document, ())
    if found is None or found.is_own:
        return set()
    parts = elements(found.model.root)
    return {found.prefix + name for part in parts if (name := part.get("name"))}


def around(element: Element, through: Sequence[Element]) -> Iterator[Element]:
    """Everything that an element stands in, from inside out, beyond the model that it comes from."""
    yield from element.iterancestors()
    for attach in reversed(through):
        yield from attach.iterancestors()


def _content(attach: Element, source: Document) -> Element | None:
    for tag in ("body", "frame"):
        name = attach.get(tag)
        if name is not None:
            named = (part for part in source.root.iter(tag) if part.get("name") == name)
            return next(named, None)
    return source.root.find("worldbody") if attach.get("model") else None
