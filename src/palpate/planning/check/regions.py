"""Poses that a run finds out: whatever place in its region each of them turns out to be, the whole plan
may run.

One is varied at a time, so no motion leads from one of them to another; whatever else comes of two of
them together, the leaf judges before it moves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from palpate.geometry.line import Line
from palpate.planning.check import end
from palpate.planning.check.case import Case
from palpate.planning.check.finding import Finding
from palpate.planning.check.walk import Reach, Walk
from palpate.scene.scene import Scene
from palpate.vocabulary.motion import MovePose


def somewhere(case: Case, walk: Walk, reachable: Reach | None = None) -> Iterator[Finding]:
    """Findings on a tree that `walk` has judged at the believed poses: one for every pose whose
    region does not pass as a whole."""
    tree, scene = case.plan.tree, case.scene
    if tree is None or scene is None:
        return
    yield from _from_one_to_another(walk, scene)
    known = [*walk.findings, *end.not_restored(case, walk)]
    for name, line in found_out(case).items():
        for place in line.places():
            other = Walk.over(tree, case.form, case.words, scene, reachable, {name: place})
            added = _added(known, [*other.findings, *end.not_restored(case, other)])
            if added is not None:
                yield _told(added, name, line, place, scene.symbols.subjects[name])
                break


def found_out(case: Case) -> dict[str, Line]:
    """The poses that a run of the plan finds out, with where they may be."""
    lines: dict[str, Line] = {}
    if case.scene is None:
        return lines
    symbols = case.scene.symbols
    for primitive in case.form.primitives.values():
        if isinstance(primitive, MovePose):
            name = symbols.found_out(primitive.pose)
            if name is not None:
                lines[name] = symbols.lines[name]
    return lines


def _from_one_to_another(walk: Walk, scene: Scene) -> Iterator[Finding]:
    for action in walk.actions:
        start, goal = (
            scene.symbols.found_out(at or "") for at in (action.before.at, action.after.at)
        )
        if start is not None and goal is not None and start != goal:
            message = (
                f"'{start}' and '{goal}' are both found out by running, so nobody knows the way between "
                f"them; MovePose to '{scene.symbols.subjects[goal]}_pose + z_offset' first"
            )
            yield Finding.of(action.path, "unknown-start", message)


def _added(known: list[Finding], found: list[Finding]) -> Finding | None:
    """The first finding where no known one breaks the same rule."""
    told = {(finding.path, finding.rule) for finding in known}
    return next((one for one in found if (one.path, one.rule) not in told), None)


def _told(found: Finding, name: str, line: Line, place: float, subject: str) -> Finding:
    """The finding, with where it is."""
    what = found.message.partition("; ")[0]
    message = (
        f"'{name}' is found out by running and may be anywhere from {1e3 * line.least:.0f} to "
        f"{1e3 * line.most:.0f} mm along; {1e3 * place:.0f} mm along {what}; go to '{subject}_pose', "
        "with an offset that is free, in its place"
    )
    return Finding(found.path, replace(found.violation, message=message))
