"""Changes of an MJCF: numbers of an attribute, or a new first child. Applied here to a parsed
tree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lxml import etree

from palpate.mjcf.document import Element, spelled_out, with_tokens


@dataclass(frozen=True, slots=True)
class Edit:
    """Sets some of an attribute's numbers.

    Attributes:
        numbers: position in the attribute to new text; None removes the attribute.
        base: what the attribute is when the element does not have it yet.
    """

    element: Element
    attribute: str
    numbers: Mapping[int, str] | None
    base: str = "?"

    def value(self, stated: str | None) -> str | None:
        """The attribute's new text, given what it is now."""
        if self.numbers is None:
            return None
        return with_tokens(
            spelled_out(self.attribute, self.base if stated is None else stated), self.numbers
        )


@dataclass(frozen=True, slots=True)
class Insert:
    """Makes `<tag attributes…/>` the first child of an element."""

    parent: Element
    tag: str
    attributes: Mapping[str, str]


def apply(edits: Iterable[Edit | Insert], twin_of: Mapping[Element, Element]) -> None:
    """Make the changes in a copy; `twin_of` says which element of the copy stands for each one
    named."""
    for edit in edits:
        if isinstance(edit, Insert):
            twin_of[edit.parent].insert(0, etree.Element(edit.tag, dict(edit.attributes)))
            continue
        element = twin_of[edit.element]
        value = edit.value(element.get(edit.attribute))
        if value is None:
            element.attrib.pop(edit.attribute, None)
        else:
            element.set(edit.attribute, value)


def number(value: float, std: float | None = None) -> str:
    """A number as text: to a tenth of its standard deviation, or to seven significant digits
    without one."""
    if std is None or not 0 < std < float("inf"):
        return f"{value:.7g}"
    digits = max(0, -int(f"{std:e}".split("e")[1]) + 1)
    return f"{value:.{min(digits, 12)}f}"
