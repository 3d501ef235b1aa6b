"""The two composites of the paper, each declared once."""

from __future__ import annotations

from palpate.vocabulary.primitive import Composite

COMPOSITES: dict[str, Composite] = {
    c.name: c
    for c in (
        Composite(
            "Sequence", "{-}",
            "Runs its children in order and remembers where it is; the first failure stops it.",
            {"tag": "Sequence"},
        ),
        Composite(
            "Parallel", "/_/",
            "Runs all its children at once and succeeds when all have; the first failure stops them all. There is one "
            "arm and one gripper: at most one child may move the arm, at most one the gripper; the others only sense.",
            {"tag": "Parallel", "success_count": "-1", "failure_count": "1"},
        ),
    )
}
