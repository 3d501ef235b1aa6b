"""Requests in five languages that the reader was not tuned on: sure, proposed and refused readings."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

from palpate.common.errors import InputError
from palpate.common.files import plain_yaml
from palpate.common.parameter import PlanRejected
from palpate.planning.request.grounding import ground
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene

FOLDER = Path(__file__).parent
SCENARIOS = Path(__file__).parents[2] / "src/palpate/studies/scenarios"


@cache
def bundled_scene(name: str) -> Scene:
    """Scene of `scenes/`, or of a bundled scenario."""
    own = FOLDER / "scenes" / f"{name}.xml"
    return load_scene(own if own.exists() else SCENARIOS / name / "scene.xml")


def read(row: dict[str, Any]) -> tuple[str, bool]:
    """Return how a request is read, and True if the reading is right.

    A request without expected parameters is right if it is refused.
    """
    try:
        found, how = ground(row["text"], bundled_scene(row["scene"])).asked, "sure"
    except PlanRejected as rejection:
        found, how = rejection.proposal, "proposal"
    except InputError:
        found, how = (), "refused"
    names = {str(parameter) for parameter in found}
    right = names in (set(row["expects"]), set(row.get("or", row["expects"])))
    return how if names else "refused", right


def judge(file: str) -> dict[str, Counter[str]]:
    """Count the readings of a file of requests by language: `sure right`, `proposal wrong`, …"""
    counts: dict[str, Counter[str]] = {}
    for row in plain_yaml((FOLDER / file).read_text(encoding="utf-8"), file):
        how, right = read(row)
        kind = f"{how} {'right' if right else 'wrong'}"
        counts.setdefault(row["language"], Counter())[kind] += 1
    return counts
