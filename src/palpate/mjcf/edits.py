"""Changes of an MJCF: numbers of an attribute, or a new first child; applied to a parsed tree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from lxml import etree

from palpate.mjcf.document import UNKNOWN, Element, spelled_out, tokens, with_tokens


@dataclass(frozen=True, slots=True)
class Edit:
    """Change of some of an attribute's numbers.

    Attributes:
        numbers: position in the attribute to new text; None removes the attribute.
        base: the attribute's text where the element has none.
    """

    element: Element
    attribute: str
    numbers: Mapping[int, str] | None
    base: str = "?"

    def value(self, stated: str | None) -> str | None:
        """The attribute's new text, from its text `stated`."""
        if self.numbers is None:
            return None
        return with_tokens(
            spelled_out(self.attribute, self.base if stated is None else stated), self.numbers
        )

    def apply(self, element: Element) -> None:
        """Make the change in `element`, which may be a copy."""
        value = self.value(element.get(self.attribute))
        if value is None:
            element.attrib.pop(self.attribute, None)
        else:
            element.set(self.attribute, value)


@dataclass(frozen=True, slots=True)
class Insert:
    """Insertion of `<tag attributes…/>` as the first child of an element."""

    parent: Element
    tag: str
    attributes: Mapping[str, str]


Change = Edit | Insert


@dataclass(frozen=True, slots=True)
class Slot:
    """A place in the file where a `?` may stand.

    Attributes:
        numbers: positions in the attribute; None for all of them.
        stand_in: text for each open number until it is measured.
        whole: text of the entire attribute until then, where open numbers are incompatible with
            stated ones.
        required: numbers that MuJoCo requires; all are open where the attribute is left out.
    """

    element: Element
    attribute: str
    stand_in: str
    numbers: tuple[int, ...] | None = None
    whole: tuple[str, ...] | None = None
    required: int = 0

    def covers(self, number: int) -> bool:
        """True if a `?` may stand at this position."""
        return self.numbers is None or number in self.numbers

    def open_numbers(self, stated: str | None) -> list[int]:
        """Positions of the `?` in the attribute's text `stated`."""
        parts = [UNKNOWN] * self.required if stated is None else tokens(stated)
        return [i for i, part in enumerate(parts) if part == UNKNOWN and self.covers(i)]

    def placeholder(self) -> Iterator[Edit]:
        """Yield the change that lets the scene compile before a measurement."""
        unknown = self.open_numbers(self.element.get(self.attribute))
        if unknown and self.whole is not None:
            yield Edit(self.element, self.attribute, dict(enumerate(self.whole)))
        elif unknown:
            base = " ".join([UNKNOWN] * max(self.required, 1))
            numbers = dict.fromkeys(unknown, self.stand_in)
            yield Edit(self.element, self.attribute, numbers, base)


def unknown_only(element: Element, attribute: str, texts: Mapping[int, str]) -> dict[int, str]:
    """Entries of `texts` whose number is `?`; all where none is, for a value measured again."""
    parts = tokens(element.get(attribute))
    unknown = {i: text for i, text in texts.items() if i < len(parts) and parts[i] == UNKNOWN}
    return unknown or dict(texts)


def apply(edits: Iterable[Change], twin_of: Mapping[Element, Element]) -> None:
    """Make the changes in a copy; `twin_of` maps each element to its copy."""
    for edit in edits:
        if isinstance(edit, Insert):
            twin_of[edit.parent].insert(0, etree.Element(edit.tag, dict(edit.attributes)))
        else:
            edit.apply(twin_of[edit.element])


def number(value: float, std: float | None = None) -> str:
    """A number as text: rounded to a tenth of its standard deviation, without one to seven
    significant digits."""
    if std is None or not 0 < std < float("inf"):
        return f"{value:.7g}"
    digits = max(0, -int(f"{std:e}".split("e")[1]) + 1)  # one more than the first digit of std
    return f"{value:.{min(digits, 12)}f}"
