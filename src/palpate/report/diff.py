"""A unified diff as rows to colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

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
    lines = [line for line in diff.splitlines() if not line.startswith(("---", "+++"))][:MAX_LINES]
    blocks = [
        [DiffLine(kind, line if kind == "hunk" else line[1:]) for line in group]
        for kind, group in groupby(lines, key=_kind)
    ]
    for i, (old, new) in enumerate(pairwise(blocks)):
        if (old[0].kind, new[0].kind, len(old)) == ("del", "add", len(new)):
            blocks[i], blocks[i + 1] = _refined(old, new), _refined(new, old)
    return [line for block in blocks for line in block]


def _kind(line: str) -> str:
    return {"+": "add", "-": "del", "@": "hunk"}.get(line[:1], "same")


def _text(line: DiffLine) -> str:
    return line.before + line.middle + line.after


def _refined(block: Sequence[DiffLine], other: Sequence[DiffLine]) -> list[DiffLine]:
    return [
        _apart(mine.kind, _text(mine), _text(theirs))
        for mine, theirs in zip(block, other, strict=True)
    ]


def _apart(kind: str, text: str, other: str) -> DiffLine:
    """The line with its common beginning and end with `other` set off from the middle."""
    limit = min(len(text), len(other))
    head = next((i for i in range(limit) if text[i] != other[i]), limit)
    tail = next((i for i in range(limit - head) if text[-1 - i] != other[-1 - i]), limit - head)
    return DiffLine(kind, text[:head], text[head : len(text) - tail], text[len(text) - tail :])
