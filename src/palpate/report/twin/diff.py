"""A unified diff as rows to colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, groupby, pairwise

MAX_LINES = 4000


@dataclass(frozen=True, slots=True)
class DiffLine:
    """A line of the diff: `add`, `del`, `hunk` or `same`; `middle` is what changed within it."""

    kind: str
    before: str
    middle: str = ""
    after: str = ""


def diff_lines(diff: str) -> list[DiffLine]:
    """Line by line, without the file names; where a line replaces another, what changed within it
    is set apart."""
    lines = [line for line in diff.splitlines() if not line.startswith(("---", "+++"))]
    blocks: list[list[DiffLine]] = []
    for kind, group in groupby(lines[:MAX_LINES], key=_kind):
        blocks.append([_plain(kind, line) for line in group])
    for i, (old, new) in enumerate(pairwise(blocks)):
        if (old[0].kind, new[0].kind, len(old)) == ("del", "add", len(new)):
            blocks[i], blocks[i + 1] = _refined(old, new), _refined(new, old)
    return list(chain.from_iterable(blocks))


def _plain(kind: str, line: str) -> DiffLine:
    """A line without its sign; a hunk's head has none."""
    return DiffLine(kind, line if kind == "hunk" else line[1:])


def _kind(line: str) -> str:
    return {"+": "add", "-": "del", "@": "hunk"}.get(line[:1], "same")


def _text(line: DiffLine) -> str:
    return line.before + line.middle + line.after


def _refined(block: Sequence[DiffLine], other: Sequence[DiffLine]) -> list[DiffLine]:
    pairs = zip(block, other, strict=True)
    return [_apart(mine.kind, _text(mine), _text(theirs)) for mine, theirs in pairs]


def _apart(kind: str, text: str, other: str) -> DiffLine:
    """The line with its common beginning and end with `other` set off from the middle."""
    head = _shared(text, other)
    tail = _shared(text[head:][::-1], other[head:][::-1])
    end = len(text) - tail
    return DiffLine(kind, text[:head], text[head:end], text[end:])


def _shared(text: str, other: str) -> int:
    """Length of the common prefix."""
    for i, (mine, theirs) in enumerate(zip(text, other, strict=False)):
        if mine != theirs:
            return i
    return min(len(text), len(other))
