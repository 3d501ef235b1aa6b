"""Surfaces of unknown height, and the heights that they and the objects on them may have.

Before a surface is touched, the objects on it may be higher than believed. Once a plan has touched
it, its poses follow the measured height. That height is unknown when the plan is checked, so the
plan must hold for all heights.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.primitives.rules.solids import solids
from palpate.primitives.state import SymbolicState
from palpate.scene.load import GUESS, compute_rises, is_open, raise_surface
from palpate.scene.scene import Scene


def lacks_measurement(state: SymbolicState, surface: str) -> bool:
    """True if the height of a surface is open, and no run has measured it."""
    scene = state.scene
    refitted = scene.refit is not None and Parameter(surface, "height") in state.converted
    return is_open(scene, surface) and surface not in scene.rises and not refitted


def touched_surfaces(state: SymbolicState) -> tuple[str, ...]:
    """Unmeasured surfaces that the plan has touched so far: measured by then at run time."""
    if state.scene.refit is not None:
        return ()
    met = {context.support for _, context in state.logged} | {state.contact}
    return tuple(
        name for name in state.scene.surfaces if name in met and lacks_measurement(state, name)
    )


def higher(before: SymbolicState, after: SymbolicState) -> dict[str, float]:
    """Map objects on untouched surfaces to the height, m, by which they may be above their poses.

    It applies on the way to the place where a surface of unknown height is probed, and is empty
    otherwise. After the probe the objects are as near as believed: the probe ends on its surface.
    """
    scene = before.scene
    if after.is_bent or after.at is None:
        return {}
    try:
        goal = scene.symbols.subject(after.at)
    except InputError:  # a third party's primitive may give another description of its place
        return {}
    # Only the way to a probe of an untouched surface matters.
    known = touched_surfaces(before)
    unknown = {name for name in scene.surfaces if lacks_measurement(before, name)}.difference(known)
    if goal not in unknown:
        return {}
    found: dict[str, float] = {}
    for surface in unknown - {after.contact}:
        # Raise the surface, and collect the objects that would rise with it.
        top = scene.body(surface).top_z() + GUESS
        rises = compute_rises(scene, surface, top, before.body_poses())
        found |= {name: GUESS for name in rises if name in scene.objects}
    return found


def vary_heights(
    before: SymbolicState, after: SymbolicState
) -> Iterator[tuple[SymbolicState, SymbolicState, str]]:
    """Both states with touched surfaces higher or lower by `GUESS`, all combinations, and their wording."""
    surfaces = touched_surfaces(before)
    for count in range(len(surfaces) + 1 if surfaces else 0):
        for lower in combinations(surfaces, count):
            rises = {name: -GUESS if name in lower else GUESS for name in surfaces}
            (start, up), (end, shift) = _shift_state(before, rises), _shift_state(after, rises)
            # Over a single surface, hand and objects rise together: nothing changes.
            if len(surfaces) == 1 and up == shift != 0.0:
                continue
            words = " and ".join(
                f"'{name}' is 50 mm {'lower' if name in lower else 'higher'}" for name in surfaces
            )
            yield start, end, words


def _shift_state(state: SymbolicState, rises: Mapping[str, float]) -> tuple[SymbolicState, float]:
    """The state with raised surfaces and objects, and the rise of the hand with them, m."""
    scene, pose, shift = _raise_surfaces(state.scene, rises), state.pose_world_tcp, 0.0
    with suppress(InputError):
        there = scene.symbols.resolve(state.at or "", state.bound)
        shift = round(float((there.position - state.resolve(state.at or "").position)[2]), 6)
    # Objects that the plan moved rise with the surface below them.
    moved = {
        name: there.translate((0.0, 0.0, scene.rises.get(name, 0.0)))
        for name, there in state.moved.items()
    }
    pose = None if pose is None else pose.translate((0.0, 0.0, shift))
    return replace(state, scene=scene, pose_world_tcp=pose, moved=moved), shift


def _raise_surfaces(scene: Scene, rises: Mapping[str, float]) -> Scene:
    """The scene with surfaces higher by so many m."""

    def make() -> Scene:
        made = scene
        for name, rise in rises.items():
            made = raise_surface(made, name, made.body(name).top_z() + rise)
        return made

    # One scene each, as the collision models are cached by scene.
    return solids(scene).get_or_compute(("raised", *sorted(rises.items())), make)
