"""Findings as lines of text, those with one cause and one remedy together."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterable

from palpate.planning.check.case import Finding

SHOWN = 4
"""Further places that one line names."""
_OBSTACLE = re.compile(r" into ('[^']+')")


def digest(findings: Iterable[Finding]) -> list[str]:
    """A line for each cause, with all places where it is found, in the order of the findings."""
    groups: dict[Hashable, list[Finding]] = {}
    for finding in findings:
        groups.setdefault(cause(finding), []).append(finding)
    return [line(group[0], [each.path for each in group]) for group in groups.values()]


def cause(finding: Finding) -> Hashable:
    """Key of what mends a finding: the object to be carried away, else its rule and message."""
    problem, _, remedy = finding.message.partition("; ")
    obstacle = _OBSTACLE.search(problem)
    if obstacle is not None and "carry it " in remedy:
        return obstacle[1]
    return finding.rule, finding.message


def line(finding: Finding, paths: Iterable[str]) -> str:
    """A finding with the other paths at which it is found."""
    others = [path for path in dict.fromkeys(paths) if path != finding.path]
    text = f"{finding.path}, {finding.rule}: {finding.message}"
    if not others:
        return text
    more = f" and {len(others) - SHOWN} more" if len(others) > SHOWN else ""
    return f"{text} (the same at {', '.join(others[:SHOWN])}{more})"
