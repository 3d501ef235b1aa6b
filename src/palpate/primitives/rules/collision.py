"""Collisions of the whole arm, its fingers and the held object on a motion, with a remedy.

Shapes are exact and margins small, since poses are believed to a few millimetres. An object that
the hand enters must pass between the open fingers. A held object may rest on its carriers. Only a
probe touches anything else, with the fingertips.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.primitives.rules.arrangement import HIGHER, ShapePart
from palpate.primitives.rules.clearance import (
    ArmPath,
    finger_path,
    is_vertical,
    joint_path,
    straddled_object,
    straight_path,
)
from palpate.primitives.rules.collision_geometry import (
    LINK,
    LOAD,
    arm_sweep,
    hand_sweep,
    is_a_posture,
    opening,
)
from palpate.primitives.rules.solids import SIDES, solids
from palpate.primitives.rules.support import SETTLES, above, footing
from palpate.primitives.rules.sweep import Hit, Sweep
from palpate.primitives.rules.unknown_heights import (
    higher,
    lacks_measurement,
    touched_surfaces,
    vary_heights,
)
from palpate.primitives.state import HOME_CONFIG, SAME_POSE, SymbolicState, Violation
from palpate.scene.load import GUESS

# m, margin between the open fingers and an object between them. Derived grasps leave 2 mm on each
# side (`grasp.SPARE`).
ENTERED = 0.0015
BESIDE = 0.0015  # m between hand or load and any other object: derived grasps leave 2 mm
FIXED = 0.003  # m between hand or load and anything static: derived grasps leave `grasp.GROUND`
ARM = 0.005  # m between the arm's links and everything, each other included
SHOWS = 0.002  # m of a measured rise from which a message mentions it
SHOWN = 3  # Largest number of hits reported of one motion
# Name for the body that a probe from the side touches: the probe ends at the first contact of any.
ANYTHING = ""


@dataclass(frozen=True, slots=True)
class Allowed:
    """Bodies that a motion may touch or come near."""

    between: frozenset[str]  # objects between the open fingers at its start or its end
    # Carriers of the load at its end. The fingers are as high above them as where they took the
    # load.
    carriers: frozenset[str]
    touched: str | None  # the body that a probe touches with the fingers, or `ANYTHING`
    # The surface that a probe touched, which the hand leaves by the way it came.
    left: str | None = None

    @classmethod
    def of(cls, before: SymbolicState, after: SymbolicState) -> Allowed:
        """Bodies of the motion from one state to the other."""
        held = before.holding
        if held is not None:
            carriers = footing(before, held, after.pose_of(held)).owners
            return cls(frozenset(), frozenset(carriers), None)
        poses = (before.pose_world_tcp, after.pose_world_tcp)
        between = frozenset(name for pose in poses if (name := straddled_object(before, pose)))
        touched = (after.contact or ANYTHING) if after.activity == "contact" else None
        left = before.contact if _goes_back(before, after) else None
        return cls(between, frozenset(), touched, left)


def collisions(before: SymbolicState, after: SymbolicState) -> tuple[Violation, ...]:
    """Collisions of the arm between two states, worst first; the start is known."""
    # The result depends on both arrangements and on the bodies that may be touched.
    surfaces = touched_surfaces(before)
    came = (before.contact, before.at if before.contact or surfaces else None, surfaces)
    goal = (after.at, after.contact, after.activity)
    key = ("collisions", *before.arrangement, *came, *after.arrangement, *goal)
    return solids(before.scene).get_or_compute(key, lambda: tuple(_collisions(before, after)))


def finger_collisions(state: SymbolicState, end: float, around: str | None) -> list[Violation]:
    """Collisions of the fingers that open to `end` m from, or close on, the object `around`."""
    pose = state.pose_world_tcp
    if pose is None:
        return []

    def compute() -> list[Violation]:
        free = replace(state, holding=None, pose_tcp_object=None)
        swept = hand_sweep(free, finger_path(pose, opening(state), end), _largest(free))
        allowed = Allowed(frozenset({around or ""}), frozenset(), around)
        found: list[Violation] = []
        for hit in islice(swept.hits(_margins(free, swept, allowed)), SHOWN):
            met = f"the {hit.part.owner} would move into '{hit.other.owner}' at {hit.place}"
            remedy = "choose a grasp clear of it, or carry it away first and back later"
            found.append(Violation("collision", f"at '{state.at}' {met}; {remedy}"))
        return found

    key = ("fingers", *state.arrangement, end, around, state.at)
    return list(solids(state.scene).get_or_compute(key, compute))


def _collisions(before: SymbolicState, after: SymbolicState) -> Iterator[Violation]:
    """Collisions at the believed heights, else at other heights of touched surfaces."""
    found = list(_hits(before, after, higher(before, after)))
    yield from found
    # A collision at the believed heights is enough. Otherwise the motion must suit all heights.
    for start, end, words in () if found else vary_heights(before, after):
        for hit in _hits(start, end, {}):
            yield replace(hit, message=f"if {words} than believed, {hit.message}")
            return


def _hits(
    before: SymbolicState, after: SymbolicState, rises: Mapping[str, float]
) -> Iterator[Violation]:
    """Collisions of one motion; objects in `rises` are also placed higher, by m."""
    allowed = Allowed.of(before, after)
    reported: set[tuple[str, str]] = set()
    # An unknown opening may be either extreme.
    unknown = before.gripper == "unknown" and before.holding is None
    for width in (0.0, before.scene.arm.hand.opening) if unknown else (opening(before),):
        path = _path(before, after, width)
        if path is None:
            return
        swept = arm_sweep(before, path, _largest(before), rises)
        hits = sorted(swept.hits(_margins(before, swept, allowed)), key=lambda hit: hit.distance)
        for hit in hits:
            # Report the deepest hit of each pair of bodies, and at most `SHOWN` pairs.
            pair = (hit.part.owner, hit.other.owner)
            if pair not in reported and len(reported) < SHOWN:
                reported.add(pair)
                yield _violation(hit, before, after, allowed)


def _goes_back(before: SymbolicState, after: SymbolicState) -> bool:
    """True for a straight motion from a touch up, no higher than where the probe began."""
    touch, end = before.pose_world_tcp, after.pose_world_tcp
    if before.contact is None or after.is_bent or touch is None or end is None:
        return False
    try:
        began = before.resolve(before.at or "")
    except InputError:
        return False
    upwards = is_vertical(end, touch) and is_vertical(end, began)
    low, high = float(touch.position[2]), float(began.position[2])
    return upwards and low < end.position[2] <= high + SAME_POSE


def _path(before: SymbolicState, after: SymbolicState, width: float) -> ArmPath | None:
    """Return the path of the arm, joint or straight; None with an end out of reach, another violation."""
    shapes, start, end = solids(before.scene), before.pose_world_tcp, after.pose_world_tcp
    q, bent = before.q, after.q
    if q is None or bent is None or start is None or end is None:
        return None
    if not all(is_a_posture(before.scene.arm, angles) for angles in (q, bent)):
        return None
    if after.is_bent:
        return joint_path(shapes, q, bent, width)
    return straight_path(shapes, start, end, (q, bent), width)


def _largest(state: SymbolicState) -> float:
    """The largest margin, m, that any pair of parts can have."""
    unknown = any(lacks_measurement(state, name) for name in state.scene.surfaces)
    doubts = (body.doubt for body in state.scene.objects.values())
    doubt = solids(state.scene).get_or_compute("doubt", lambda: max(doubts, default=0.0))
    return max(GUESS if unknown else ARM, doubt)


def _margins(state: SymbolicState, swept: Sweep, allowed: Allowed) -> Array:
    """(p,) m, margin of each pair of parts."""
    # Cache the margins: most pairs share a few kinds of parts and a few bodies.
    known: dict[tuple[str, str, str], float] = {}
    margins = np.empty(len(swept.pairs))
    for pair in range(len(margins)):
        part, other = swept.of(pair)
        key = (part.kind, other.kind, other.owner)
        if key not in known:
            known[key] = _margin(state, part, other, allowed)
        margins[pair] = known[key]
    return margins


def _margin(state: SymbolicState, part: ShapePart, other: ShapePart, allowed: Allowed) -> float:
    """Least allowed distance of two parts, m; negative or -inf where contact is allowed."""
    name = other.owner
    if name == allowed.left:
        return -np.inf  # the hand was just there
    # Links never touch anything, each other included.
    if part.kind == LINK or other.kind == LINK:
        return ARM
    # A probe may touch its body with the fingers, and a load may settle on its carriers.
    if allowed.touched in (name, ANYTHING) and part.kind in SIDES:
        return -np.inf
    if part.kind == LOAD and name in allowed.carriers:
        return -SETTLES
    if name in allowed.between:
        return ENTERED
    if name in state.scene.objects:
        return max(BESIDE, state.scene.body(name).doubt)
    if part.kind == LOAD or allowed.between or allowed.touched or name in allowed.carriers:
        return FIXED
    # An approach pose is 0.1 m above its surface, which may be higher than believed.
    return GUESS if lacks_measurement(state, name) else FIXED


def _violation(
    hit: Hit, before: SymbolicState, after: SymbolicState, allowed: Allowed
) -> Violation:
    name, load = hit.other.owner, hit.part.kind == LOAD
    part = f"'{hit.part.owner}' in the hand" if load else f"the arm's {hit.part.owner}"
    where = "joint motion" if after.is_bent else f"path to '{after.at}'"
    how = f"go {-1e3 * hit.distance:.0f} mm into" if hit.distance < 0 else "come too near to"
    rise, measured = before.scene.rises.get(name, 0.0), ""
    if abs(rise) >= SHOWS:
        side = "higher" if rise > 0 else "lower"
        measured = f" (measured {1e3 * abs(rise):.0f} mm {side} than in the scene)"
    met = f"on the {where} {part} would {how} '{name}'{measured} at {hit.place}"
    return _with_remedy(met, hit, before, after, allowed)


def _with_remedy(
    met: str, hit: Hit, before: SymbolicState, after: SymbolicState, allowed: Allowed
) -> Violation:
    """Violation by a hit in words, with the motion to write instead."""
    name, scene = hit.other.owner, after.scene
    detour = "go through 'home_config', or "
    if HOME_CONFIG in (before.at, after.at):
        detour = ""
    if hit.other.kind == HIGHER:
        return Violation(
            "collision",
            f"{met}, which may be up to 50 mm higher than believed until the surface "
            "below it is touched; come from a higher pose",
        )
    if hit.other.kind == LINK or name == scene.arm.base:
        return Violation("self-collision", f"{met}; {detour}choose nearer poses")
    if hit.part.kind == LINK:
        return Violation("collision", f"{met}; {detour}choose another pose")
    # Objects: the margin of entering, or the stated doubt of their pose.
    if name in allowed.between:
        return Violation("collision", f"{met}; {_passing(before, name)}")
    if name in scene.objects:
        # Offer only what the poses of the scene permit.
        away = f", or {carry_away(name)}" if f"{name}_temporary" in scene.symbols.usable else ""
        return Violation("blocked", f"{met}; go around it{away}")
    if hit.part.kind != LOAD and name in scene.surfaces:
        clear = f": '{name}_approach' is clear of it, and"
        clear = clear if f"{name}_approach" in scene.symbols.usable else ";"
        return Violation(
            "collision",
            f"{met}; stay above it{clear} MoveUntilContact touches it where its height is requested",
        )
    return Violation("collision", f"{met}; choose a higher pose, or go around it")


def _passing(before: SymbolicState, name: str) -> str:
    """Remedy for an object that does not pass between the fingers."""
    if before.gripper != "open":
        return "the fingers are not open; OpenGripper first"
    if name in before.scene.symbols.ungraspable:
        return f"it does not fit between them; remove measurements that grasp '{name}', and explain"
    if straddled_object(before, before.pose_world_tcp) == name:
        return f"it is between the fingers; MovePose to '{above(before, before.at)}' first"
    return (
        f"come down with the open fingers on either side of it: write MovePose '{name}_pose', and "
        f"MovePose to '{name}_pose + z_offset' first"
    )


def carry_away(name: str) -> str:
    """Remedy for an object in the way."""
    return f"carry it to '{name}_temporary' first, and back to '{name}_pose' later"
