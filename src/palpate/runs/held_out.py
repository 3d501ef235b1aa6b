"""Held-out validation in `result.json`, written and read back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from palpate.estimation.agreement import FitTest
from palpate.twin.held_out.judged import Curve, HeldOut, Motion


def held_out_json(held: HeldOut | None) -> dict[str, Any] | None:
    """All motions together, and one by one."""
    if held is None:
        return None
    together = _together(held.motions)
    each = [_motion_json(motion) for motion in held.motions]
    return {**together, "notes": list(held.notes), "motions": each}


def _together(motions: Sequence[Motion]) -> dict[str, Any]:
    """All motions as one: the least probable of them counts, and one that disagrees."""
    words: list[str] = []
    findings: list[str] = []
    probable: list[float] = []
    for motion in motions:
        words.append(motion.motion)
        probable.append(motion.p)
        if motion.disagreement:
            findings.append(motion.disagreement)
    return {
        "motion": "; ".join(words) or None,
        "chi2": sum(motion.chi2 for motion in motions),
        "dof": sum(motion.dof for motion in motions),
        "p": min(probable, default=None),
        "agrees": all(motion.agrees for motion in motions) if motions else None,
        "disagreement": " ".join(findings) or None,
    }


def _motion_json(motion: Motion) -> dict[str, Any]:
    content = asdict(motion)
    content["tests"] = [asdict(test) | {"passed": test.passed} for test in motion.tests]
    return content | {"agrees": motion.agrees}


def held_out_from(document: Mapping[str, Any] | None) -> HeldOut | None:
    """Read the output of `held_out_json`."""
    if document is None:
        return None
    motions = tuple(_motion(motion) for motion in document["motions"])
    return HeldOut(motions, tuple(document["notes"]))


def fit_test(document: Mapping[str, Any]) -> FitTest:
    """A test as `result.json` has it; null stands for what is no number."""
    statistic = math.nan if document["statistic"] is None else document["statistic"]
    return FitTest(document["name"], statistic, document["limit"], document["finding"])


def _motion(document: Mapping[str, Any]) -> Motion:
    parts = {name: part for name, part in document.items() if name != "agrees"}
    parts["tests"] = tuple(fit_test(test) for test in document["tests"])
    parts["curve"] = _curve(document["curve"])
    return Motion(**parts)


def _curve(document: Mapping[str, Any]) -> Curve:
    grids = ("measured", "std", "twin", "template")
    rows = {name: tuple(tuple(row) for row in document[name]) for name in grids}
    return Curve(tuple(document["signals"]), tuple(document["t"]), **rows)
