"""Surfaces of unknown height: what of the cell may be higher or lower than believed.

Before a surface is touched, what stands on it may be higher than believed. Once a plan has touched it,
its poses go by the measured height, which nobody knows on paper: the plan must hold for all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations

from palpate.errors import InputError
from palpate.parameter import Parameter
from palpate.scene.raised import GUESS, is_open, raised, risen
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.state import SymbolicState


def is_unmeasured(state: SymbolicState, surface: str) -> bool:
    """True if the height of a surface is open, and no run has measured it."""
    scene = state.scene
    seen_anew = scene.refit is not None and Parameter(surface, "height") in state.converted
    return is_open(scene, surface) and surface not in scene.rises and not seen_anew


def touched(state: SymbolicState) -> tuple[str, ...]:
    """Unmeasured surfaces that the plan has touched so far: at run time they are measured by then."""
    if state.scene.refit is not None:
        return ()
    met = {context.support for _, context in state.logged} | {state.contact}
    return tuple(
        name for name in state.scene.surfaces if name in met and is_unmeasured(state, name)
    )


def higher(before: SymbolicState, after: SymbolicState) -> dict[str, float]:
    """m by which objects may be higher than believed on the way to where a surface of unknown height is
    to be probed: those on surfaces that have not been touched. A probe ends on its surface however high
    that is, and what stands on it is as near as believed then."""
    scene = before.scene
    if after.is_bent or after.at is None:
        return {}
    unknown = [name for name in scene.surfaces if is_unmeasured(before, name)]
    known = touched(before)
    try:
        goal = scene.symbols.subject(after.at)
    except InputError:  # a primitive of another package says in its own words where it is
        return {}
    if goal not in set(unknown).difference(known):
        return {}
    found: dict[str, float] = {}
    for surface in set(unknown).difference(known, (after.contact,)):
        top = scene.body(surface).top_z() + GUESS
        rises = risen(scene, surface, top, before.pose_of)
        found |= {name: GUESS for name in rises if name in scene.objects}
    return found


def supposed(
    before: SymbolicState, after: SymbolicState
) -> Iterator[tuple[SymbolicState, SymbolicState, str]]:
    """The same two states with the touched surfaces as much higher and lower as they may be, and that in
    words; none where the hand stays over one surface, and everything near moves with it."""
    surfaces = touched(before)
    for count in range(len(surfaces) + 1 if surfaces else 0):
        for lower in combinations(surfaces, count):
            rises = {name: -GUESS if name in lower else GUESS for name in surfaces}
            start, end = _shift(before, rises), _shift(after, rises)
            if len(surfaces) == 1 and start == end != 0.0:
                continue
            words = " and ".join(
                f"'{name}' is 50 mm {'lower' if name in lower else 'higher'}" for name in surfaces
            )
            yield _shifted(before, rises, start), _shifted(after, rises, end), words


def _shift(state: SymbolicState, rises: Mapping[str, float]) -> float:
    """m by which the place where the hand is rises."""
    try:
        there = _raised(state.scene, rises).symbols.resolve(state.at or "", state.bound)
        return round(float((there.position - state.resolve(state.at or "").position)[2]), 6)
    except InputError:
        return 0.0


def _shifted(state: SymbolicState, rises: Mapping[str, float], shift: float) -> SymbolicState:
    scene, pose = _raised(state.scene, rises), state.pose_world_tcp
    return replace(
        state,
        scene=scene,
        pose_world_tcp=None if pose is None else pose.translated((0.0, 0.0, shift)),
        moved={
            name: there.translated((0.0, 0.0, scene.rises.get(name, 0.0)))
            for name, there in state.moved.items()
        },
    )


def _raised(scene: Scene, rises: Mapping[str, float]) -> Scene:
    """The scene with surfaces higher by so many m, made once."""

    def make() -> Scene:
        made = scene
        for name, rise in rises.items():
            made = raised(made, name, made.body(name).top_z() + rise)
        return made

    return solids(scene).remembered(("supposed", *sorted(rises.items())), make)
