"""Estimates as they stand in the twin's `<custom>`:

- numeric `palpate_<object>_<quantity>`: value, standard deviation, low and high end of the 95 %
  interval; with several components all values come first, then all deviations, and so on;
- numeric `palpate_<object>_<quantity>_<component>`: value and deviation of a further result (static
  friction);
- text `palpate_<object>_<quantity>_method`: how it was found;
- text `palpate_<object>_<quantity>_verdict`: how far it is to be trusted, where it is not identified.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from palpate.estimation.estimate import Estimate
from palpate.mjcf import spans

MAX_SENTENCE = 1000
"""Characters of a method that are kept."""


@dataclass(frozen=True, slots=True)
class _Entry:
    """An element of `<custom>`."""

    tag: str
    name: str
    data: str

    @property
    def text(self) -> str:
        return spans.element(self.tag, {"name": self.name, "data": self.data})


def recorded(text: str, records: Sequence[Estimate]) -> str:
    """The MJCF with `records` in its `<custom>`: what is there gets new data, the rest is added."""
    if not records:
        return text
    tags = spans.scan(text)
    data = text.encode("utf-8")
    present: dict[str, spans.Tag] = {}
    for tag in tags:
        if tag.name in ("numeric", "text") and tag.depth == 2:
            present[tag.value(data, "name")] = tag
    made: list[spans.Change] = []
    added: list[str] = []
    for entry in _entries(records):
        if entry.name in present:
            made.append(spans.set_attribute(present[entry.name], "data", entry.data))
        else:
            added.append(entry.text)
    if added:
        custom = next((tag for tag in tags if tag.name == "custom" and tag.depth == 1), None)
        made.append(_added(data, tags, custom, added))
    return spans.changed(text, made)


def _entries(records: Iterable[Estimate]) -> Iterator[_Entry]:
    for record in records:
        name = f"palpate_{record.parameter.object}_{record.parameter.quantity}"
        low, high = record.intervals.T
        yield _Entry("numeric", name, as_text([*record.values, *record.stds, *low, *high]))
        for further, part in record.parts.items():
            numbers = as_text([part.value, part.std])
            yield _Entry("numeric", f"{name}_{further.replace(' ', '_')}", numbers)
        yield _Entry("text", f"{name}_method", _printable(record.method) or "measured")
        if not record.identified:
            yield _Entry("text", f"{name}_verdict", record.verdict)


def as_text(values: Iterable[float]) -> str:
    """Numbers with seven significant digits."""
    return " ".join(f"{value:.7g}" for value in values)


def _printable(text: str) -> str:
    characters = [c if c.isprintable() else " " for c in text]
    return " ".join("".join(characters).split())[:MAX_SENTENCE]


def _added(
    data: bytes, tags: list[spans.Tag], custom: spans.Tag | None, added: list[str]
) -> spans.Change:
    line = _line_break(data, tags)
    step = line.lstrip("\r\n") or "  "
    deeper = line + step if line else ""
    inner = "".join(deeper + element for element in added)
    if custom is None:
        return spans.last_children(data, tags[0], [f"<custom>{inner}{line}</custom>"], line)
    if custom.empty:
        return spans.Change(custom.start, custom.last, f"<custom>{inner}{line}</custom>")
    return spans.last_children(data, custom, added, deeper)


def _line_break(data: bytes, tags: list[spans.Tag]) -> str:
    """Line break and indentation before the first element inside the root; nothing in a text of one
    line."""
    before = data[tags[0].end : tags[1].start]
    space = before[len(before.rstrip(b" \t")) :].decode("utf-8")
    if b"\n" not in before:
        return ""
    return ("\r\n" if b"\r\n" in before else "\n") + space
