"""Poses that a run finds out: whatever place in its region each of them turns out to be, the whole plan
may run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from palpate.errors import InputError
from palpate.geometry.line import Line
from palpate.planning.check.case import Form
from palpate.planning.check.finding import Finding
from palpate.planning.check.walk import Reach, Walk
from palpate.planning.plan import Node
from palpate.scene.scene import Scene
from palpate.scene.symbols import Symbols
from palpate.vocabulary.motion.move_pose import MovePose


def somewhere(
    walk: Walk, tree: Node, scene: Scene, reachable: Reach | None = None
) -> Iterator[Finding]:
    """What speaks against a tree that `walk` has judged with its poses where they are believed: one
    finding for every pose whose region does not wholly pass."""
    for name, line in found_out(walk.form, scene.symbols).items():
        for place in line.places():
            other = Walk.over(tree, walk.form, walk.words, scene, reachable, {name: place})
            added = [found for found in other.findings if found.rule not in _rules(walk, found)]
            if added:
                yield _told(added[0], name, line, place, scene.symbols.subjects[name])
                break


def found_out(form: Form, symbols: Symbols) -> dict[str, Line]:
    """The poses that a run of the tree finds out, with where they may be."""
    lines: dict[str, Line] = {}
    for primitive in form.primitives.values():
        if not isinstance(primitive, MovePose):
            continue
        try:
            name = symbols.parse(primitive.pose).name
        except InputError:
            continue
        if name in symbols.lines:
            lines[name] = symbols.lines[name]
    return lines


def _rules(walk: Walk, like: Finding) -> set[str]:
    """The rules that are broken where another walk has a finding, too."""
    return {found.rule for found in walk.findings if found.path == like.path}


def _told(found: Finding, name: str, line: Line, place: float, subject: str) -> Finding:
    """The finding, with where it is."""
    what = found.message.partition("; ")[0]
    message = (
        f"'{name}' is found out by running and may be anywhere from {1e3 * line.least:.0f} to "
        f"{1e3 * line.most:.0f} mm along; {1e3 * place:.0f} mm along {what}; go to '{subject}_pose', "
        "with an offset that is free, in its place"
    )
    return Finding(found.path, replace(found.violation, message=message))
