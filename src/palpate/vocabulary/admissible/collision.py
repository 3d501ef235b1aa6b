"""Collisions of the whole arm, its fingers and the held object on a motion, with the motion to
write instead.

Shapes are real, margins small: poses are believed to a few millimetres. What is entered must pass
between the open fingers; what is held may rest on what carries it; nothing else is touched but by a
probe, with the fingers' ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.scene.raised import GUESS
from palpate.vocabulary.admissible.clearance import STEEP, straddled
from palpate.vocabulary.admissible.footing import SETTLES, footing
from palpate.vocabulary.admissible.guessed import higher, is_unmeasured, supposed, touched
from palpate.vocabulary.admissible.solids import SIDES, solids
from palpate.vocabulary.admissible.sweep.collision_geometry import (
    HIGHER,
    LINK,
    LOAD,
    arm_sweep,
    hand_sweep,
    opening,
)
from palpate.vocabulary.admissible.sweep.sweep import Hit, Part, Sweep
from palpate.vocabulary.admissible.sweep.way import Way, of_fingers, of_joints, straight
from palpate.vocabulary.state import HOME_CONFIG, SAME_POSE, SymbolicState
from palpate.vocabulary.violation import Violation

ENTERED = 0.0015
"""m that the open fingers keep from an object between them: `grasp.SPARE` leaves 2 mm each side."""
BESIDE = 0.0015
"""m that hand and load keep from any other object: derived grasps leave 2 mm."""
FIXED = 0.003
"""m that they keep from what never moves: derived grasps leave `grasp.GROUND`."""
ARM = 0.005
"""m that the arm's links keep from everything, and from each other."""
UNSURE = GUESS
"""m by which a surface of unknown height may be higher than believed, and what stands on it, until it is
touched; an approach pose is 0.1 m above its surface."""
SHOWS = 0.002
"""m: a smaller measured rise is not worth a word."""
SHOWN = 3
"""Hits that are told of one motion."""


@dataclass(frozen=True, slots=True)
class Passing:
    """A motion of the arm from one state to another, as far as it matters who may be near.

    Attributes:
        between: objects between the open fingers at its start or its end.
        carriers: what the load stands on at its end. As high as that is, so high are the fingers that
            hold it: as high above it as where they took it.
        touched: what a probe touches.
        left: the surface that the hand came down on, and that it leaves by the way it came: the hand has
            just been there.
    """

    between: frozenset[str]
    carriers: frozenset[str]
    touched: str | None
    left: str | None = None


def collisions(before: SymbolicState, after: SymbolicState) -> tuple[Violation, ...]:
    """Collisions of the arm between two states, worst first; the start is known."""
    goal = (after.at, after.contact, after.activity)
    came = (before.contact, before.at if before.contact or touched(before) else None)
    key = ("collisions", *before.arrangement, *came, touched(before), *after.arrangement, *goal)
    return solids(before.scene).remembered(key, lambda: tuple(_collisions(before, after)))


def finger_collisions(state: SymbolicState, end: float, around: str | None) -> list[Violation]:
    """Collisions of the fingers on their way to an opening of `end` m; `around` is the object that
    they open from or close on."""
    key = ("fingers", *state.arrangement, end, around, state.at)
    return list(
        solids(state.scene).remembered(key, lambda: tuple(_finger_hits(state, end, around)))
    )


def _finger_hits(state: SymbolicState, end: float, around: str | None) -> Iterator[Violation]:
    if state.pose_world_tcp is None:
        return
    free = replace(state, holding=None, pose_tcp_object=None)
    fingers = of_fingers(state.pose_world_tcp, opening(state), end)
    swept = hand_sweep(free, fingers).within(UNSURE)
    passing = Passing(frozenset({around or ""}), frozenset(), around)
    for hit in islice(swept.hits(_margins(free, swept, passing)), SHOWN):
        yield Violation(
            "collision",
            f"at '{state.at}' the {hit.part.owner} would move into '{hit.other.owner}' at "
            f"{hit.place}; choose a grasp clear of it, or carry it away first and back later",
        )


def _collisions(before: SymbolicState, after: SymbolicState) -> Iterator[Violation]:
    found = list(_hits(before, after, higher(before, after)))
    yield from found
    for start, end, words in () if found else supposed(before, after):
        for hit in _hits(start, end, {}):
            yield replace(hit, message=f"if {words} than guessed, {hit.message}")
            return


def _hits(
    before: SymbolicState, after: SymbolicState, rises: Mapping[str, float]
) -> Iterator[Violation]:
    passing = _passing(before, after)
    told: set[tuple[str, str]] = set()
    for width in _widths(before):
        way = _way(before, after, width)
        if way is None:
            return
        swept = arm_sweep(before, way, rises).within(UNSURE)
        hits = sorted(swept.hits(_margins(before, swept, passing)), key=lambda hit: hit.distance)
        for hit in hits:
            pair = (hit.part.owner, hit.other.owner)
            if pair not in told and len(told) < SHOWN:
                told.add(pair)
                yield _told(hit, before, after, passing)


def _passing(before: SymbolicState, after: SymbolicState) -> Passing:
    held, pose = before.holding, after.pose_world_tcp
    if held is not None:
        lying = footing(before, held, after.pose_of(held)).carriers
        carriers = frozenset(top.owner for top in lying)
        return Passing(frozenset(), carriers, None)
    ends = {straddled(before, before.pose_world_tcp), straddled(before, pose)} - {None}
    between = frozenset(name for name in ends if name)
    touched = after.contact if after.activity == "contact" else None
    left = before.contact if _goes_back(before, after) else None
    return Passing(between, frozenset(), touched, left)


def _goes_back(before: SymbolicState, after: SymbolicState) -> bool:
    """True if a straight way leads from a touch straight up, no higher than where the probe began."""
    touch, end = before.pose_world_tcp, after.pose_world_tcp
    if before.contact is None or after.is_bent or touch is None or end is None:
        return False
    try:
        began = before.resolve(before.at or "")
    except InputError:
        return False
    aside = max(_aside(end, touch), _aside(end, began))
    low, high = float(touch.position[2]), float(began.position[2])
    return aside < STEEP and low < end.position[2] <= high + SAME_POSE


def _aside(one: Pose, other: Pose) -> float:
    x, y, _ = (one.position - other.position).tolist()
    return math.hypot(x, y)


def _way(before: SymbolicState, after: SymbolicState, width: float) -> Way | None:
    """The way as the robot takes it: joints evenly, or the TCP straight; None where one of its ends
    is out of the arm's reach, which is another finding."""
    shapes, start, end = solids(before.scene), before.pose_world_tcp, after.pose_world_tcp
    q, bent = before.q, after.q
    if q is None or bent is None or start is None or end is None:
        return None
    if after.is_bent:
        return of_joints(shapes, q, bent, width)
    return straight(shapes, start, end, (q, bent), width)


def _widths(state: SymbolicState) -> tuple[float, ...]:
    """Possible openings of the fingers: both extremes where the opening is unknown."""
    if state.gripper == "unknown" and state.holding is None:
        return 0.0, state.scene.arm.hand.opening
    return (opening(state),)


def _margins(state: SymbolicState, swept: Sweep, passing: Passing) -> Array:
    """(p,) m that each pair of parts keeps."""
    heights = {name: _unsure(state, name) for name in state.scene.surfaces}
    # Shapes of one thing keep the same: few margins, many pairs.
    alike: dict[tuple[str, str], Part] = {}
    for part in swept.parts:
        alike.setdefault((part.kind, part.owner), part)
    number = {called: i for i, called in enumerate(alike)}
    numbers = np.array([number[part.kind, part.owner] for part in swept.parts])
    first, second = numbers[swept.pairs[:, 0]], numbers[swept.pairs[:, 1]]
    codes, which = np.unique(first * len(alike) + second, return_inverse=True)
    things = list(alike.values())
    found: list[float] = []
    for code in map(int, codes):
        one, other = divmod(code, len(things))
        found.append(_margin(state, things[one], things[other], passing, heights))
    return np.array(found, dtype=np.float64)[which]


def _margin(
    state: SymbolicState, part: Part, other: Part, passing: Passing, heights: dict[str, float]
) -> float:
    name = other.owner
    if name == passing.left:
        return -np.inf
    if part.kind == LINK or other.kind == LINK:
        return ARM
    if name == passing.touched and part.kind in SIDES:
        return -np.inf
    if part.kind == LOAD and name in passing.carriers:
        return -SETTLES
    if name in passing.between:
        return ENTERED
    if name in state.scene.objects:
        return BESIDE
    if part.kind == LOAD or passing.between or passing.touched or name in passing.carriers:
        return FIXED
    return max(FIXED, heights.get(name, 0.0))


def _unsure(state: SymbolicState, name: str) -> float:
    """m that the top of a surface may be higher than believed."""
    return UNSURE if is_unmeasured(state, name) else 0.0


def _told(hit: Hit, before: SymbolicState, after: SymbolicState, passing: Passing) -> Violation:
    part, name = _called(hit.part), hit.other.owner
    where = "joint motion" if after.is_bent else f"way to '{after.at}'"
    how = f"run {-1e3 * hit.distance:.0f} mm into" if hit.distance < 0 else "come too near to"
    met = f"on the {where} {part} would {how} '{name}'{_measured(before, name)} at {hit.place}"
    if hit.other.kind == HIGHER:
        return Violation(
            "collision",
            f"{met}, which may be up to 50 mm higher than believed until the surface "
            "below it is touched; come from a higher pose",
        )
    detour = _detour(before, after)
    if hit.other.kind == LINK or name == after.scene.arm.base:
        return Violation("self-collision", f"{met}; {detour}choose nearer poses")
    if hit.part.kind == LINK:
        return Violation("collision", f"{met}; {detour}choose another pose")
    if name in passing.between:
        return Violation("collision", f"{met}; {_entering(before, name)}")
    if name in after.scene.objects:
        return Violation("blocked", f"{met}; go around it, or {carry_away(name)}")
    if hit.part.kind == LOAD:
        return Violation("collision", f"{met}; choose a higher pose, or go around it")
    return Violation("collision", f"{met}; {_instead(after, name)}")


def _measured(state: SymbolicState, name: str) -> str:
    """A measured rise of an object or a surface, in words."""
    rise = state.scene.rises.get(name, 0.0)
    if abs(rise) < SHOWS:
        return ""
    side = "higher" if rise > 0 else "lower"
    return f" (measured {1e3 * abs(rise):.0f} mm {side} than the scene has it)"


def _detour(before: SymbolicState, after: SymbolicState) -> str:
    """The remedy of going by way of home, in words; none where the way begins or ends there."""
    return "" if HOME_CONFIG in (before.at, after.at) else "go by way of 'home_config', or "


def _entering(before: SymbolicState, name: str) -> str:
    """Description of an object that enters between the fingers."""
    if before.gripper != "open":
        return "the fingers are not open; OpenGripper first"
    if name in before.scene.symbols.ungraspable:
        return (
            f"it does not fit between them; leave out what needs '{name}' in the hand, and explain"
        )
    return (
        f"come down with the open fingers on either side of it: write MovePose '{name}_pose', and "
        f"MovePose to '{name}_pose + z_offset' first"
    )


def carry_away(name: str) -> str:
    """Advice about an object in the way."""
    return f"carry it to '{name}_temporary' first, and back to '{name}_pose' later"


def _instead(after: SymbolicState, name: str) -> str:
    if name in after.scene.surfaces:
        return (
            f"stay above it: '{name}_approach' is clear of it, and MoveUntilContact touches it "
            "slowly where its height is asked for"
        )
    return "choose a higher pose, or go around it"


def _called(part: Part) -> str:
    return f"'{part.owner}' in the hand" if part.kind == LOAD else f"the arm's {part.owner}"
