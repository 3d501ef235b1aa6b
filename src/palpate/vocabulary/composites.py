"""The two composites of the paper, each declared once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Composite:
    """A composite's one declaration: `Sequence` and `Parallel` are the two there are."""

    name: str
    symbol: str
    summary: str
    btcpp: Mapping[str, str]
    """Tag and fixed attributes in BT.CPP 4."""


COMPOSITES: dict[str, Composite] = {
    c.name: c
    for c in (
        Composite(
            "Sequence",
            "{-}",
            "Runs its children in order and remembers where it is; the first failure stops it.",
            {"tag": "Sequence"},
        ),
        Composite(
            "Parallel",
            "/_/",
            "Runs all its children at once and succeeds when all have; the first failure stops them all. There is one "
            "arm and one gripper: at most one child may move the arm, at most one the gripper; the others only sense.",
            {"tag": "Parallel", "success_count": "-1", "failure_count": "1"},
        ),
    )
}
