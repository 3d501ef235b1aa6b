"""Poses that a run estimates: the whole plan must pass the check for every place in their regions.

Only one pose is varied at a time, so no motion may lead from one of them to another. Every other effect
of two of them together is judged by the leaf before it moves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from palpate.geometry.pose import Line
from palpate.planning.check.case import Case, Finding
from palpate.planning.check.walk import Reach, Walk
from palpate.planning.check.walk_rules import not_restored
from palpate.vocabulary.motion import MovePose


def unpassable_regions(case: Case, walk: Walk, reachable: Reach | None = None) -> Iterator[Finding]:
    """Findings on a tree that `walk` has judged at the believed poses: one for every pose whose
    region does not pass as a whole."""
    assert case.scene is not None
    symbols = case.scene.symbols
    for action in walk.actions:
        start, goal = (symbols.found_out(at or "") for at in (action.before.at, action.after.at))
        if start is not None and goal is not None and start != goal:
            message = (
                f"'{start}' and '{goal}' are both found out by running, so nobody knows the way between "
                f"them; MovePose to '{symbols.subjects[goal]}_pose + z_offset' first"
            )
            yield Finding.of(action.path, "unknown-start", message)
    # A fault at the believed pose is reported already: only rules broken elsewhere in the region count.
    known = {(finding.path, finding.rule) for finding in all_findings(case, walk)}
    for name, line in estimated_poses(case).items():
        for place in line.places():
            other = Walk.over(case, reachable, {name: place})
            added = (f for f in all_findings(case, other) if (f.path, f.rule) not in known)
            if (found := next(added, None)) is not None:
                problem = found.message.partition("; ")[0]
                message = (
                    f"'{name}' is found out by running and may be anywhere from {1e3 * line.least:.0f} to "
                    f"{1e3 * line.most:.0f} mm along; {1e3 * place:.0f} mm along {problem}; go to "
                    f"'{symbols.subjects[name]}_pose', with an offset that is free, in its place"
                )
                yield Finding(found.path, replace(found.violation, message=message))
                break


def estimated_poses(case: Case) -> dict[str, Line]:
    """Poses of the plan that a run estimates, with the line on which each may be."""
    lines: dict[str, Line] = {}
    symbols = case.scene.symbols if case.scene is not None else None
    for primitive in case.form.primitives.values():
        if symbols is not None and isinstance(primitive, MovePose):
            name = symbols.found_out(primitive.pose)
            if name is not None:
                lines[name] = symbols.lines[name]
    return lines


def all_findings(case: Case, walk: Walk) -> list[Finding]:
    """Findings of a walk, and on what it leaves displaced."""
    displaced = [Finding.of(path, "not-restored", m) for path, m in not_restored(case, walk)]
    return [*walk.findings, *displaced]
