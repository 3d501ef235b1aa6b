"""Selection of one of several bodies by its position: "the box beside the red one".

Left and right, near and far are as the robot sees them: x of its base points away from it, y to
its left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from palpate.errors import PlanRejected
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body
from palpate.planning.request.item import Item
from palpate.scene.scene import Scene

APART = 0.02
"""m: what is less far to one side is not on that side."""
TOUCHING = 0.02
"""m: what stands no farther above a top stands on it."""
NEARER = 0.8
"""Ratio of distances below which the nearer of two bodies is the one beside a thing."""
LEVEL = 0.001
"""m: of two things, neither is the nearest where their distances differ by less; scenes state places
in millimetres."""
LARGER = 1.1
"""Ratio of sizes above which the larger of two bodies is the large one."""

_VIEWS = ("left", "right")


def farthest(place: str, names: Sequence[str], scene: Scene, said: str) -> tuple[str, str]:
    """Body that is farthest to one side, or the largest, with a remark.

    Raises:
        PlanRejected: two are.
    """
    chosen = _extreme(place, _bodies(scene, names), scene, place, said)
    return chosen, _as_seen(place, place)


def standing(
    relation: str, item: Item, marks: Sequence[str], scene: Scene, anything: bool
) -> tuple[tuple[str, ...], str]:
    """Bodies of an item that have the relation to the landmarks, with a remark.

    Raises:
        PlanRejected: nothing does, or it cannot be told which does.
    """
    beside = _bodies(scene, marks)
    rest = _bodies(scene, scene.objects if anything else item.names)
    rest = [body for body in rest if all(body is not mark for mark in beside)]
    on_surface = relation in _STANDING and all(name in scene.surfaces for name in marks)
    remark = ""
    if len(item.names) == 1 and on_surface and item.names[0] not in marks:
        # The believed height of a surface may be what is asked for.
        return item.names, remark
    if relation in _STANDING:
        found = _standing(relation, rest, beside)
    elif anything or len(rest) > 1:
        found, remark = _beside(relation, rest, beside, scene)
    else:
        found = _on_that_side(relation, rest, beside, scene)
    if not found:
        said = " and ".join(f"'{mark}'" for mark in marks)
        raise PlanRejected(f"no '{item.text}' of this scene is {_SAID[relation]} {said}")
    return tuple(body.name for body in found), remark


def _on_that_side(
    relation: str, rest: Sequence[Body], marks: Sequence[Body], scene: Scene
) -> Sequence[Body]:
    """The only thing of its name, if it stands so."""
    middle = np.mean([_in_base(mark, scene) for mark in marks], axis=0)
    return [body for body in rest if _SIDES[relation](_in_base(body, scene) - middle)]


def _as_seen(said: str, relation: str) -> str:
    return f"'{said}' is as the robot sees it." if relation in _VIEWS else ""


def _bodies(scene: Scene, names: Iterable[str]) -> list[Body]:
    return [scene.bodies[name] for name in names if name in scene.bodies]


def _extreme(place: str, bodies: Sequence[Body], scene: Scene, said: str, noun: str) -> str:
    """The name of the body that is farthest to one side, or the largest.

    Raises:
        PlanRejected: two are.
    """
    measure = _EXTREMES[place]
    sizes = [measure(body, scene) for body in bodies]
    order: list[int] = np.argsort(sizes)[::-1].tolist()
    first, second = sizes[order[0]], sizes[order[1]]
    apart = first - second > APART
    if place in ("large", "small", "tall", "short"):
        apart = abs(first) > LARGER * abs(second) or abs(second) > LARGER * abs(first)
    if not apart:
        names = " or ".join(f"'{bodies[i].name}'" for i in order[:2])
        raise PlanRejected(f"'the {said} {noun}' may be {names}; name one")
    return bodies[order[0]].name


def _in_base(body: Body, scene: Scene) -> Array:
    """Centre of a body in the robot's base frame, m."""
    base = scene.pose_world_base
    return base.rotation.T @ (_middle(body) - base.position)


_EXTREMES: Mapping[str, Callable[[Body, Scene], float]] = {
    "left": lambda body, scene: float(_in_base(body, scene)[1]),
    "right": lambda body, scene: -float(_in_base(body, scene)[1]),
    "near": lambda body, scene: -float(_in_base(body, scene)[0]),
    "far": lambda body, scene: float(_in_base(body, scene)[0]),
    "large": lambda body, scene: float(np.prod(body.size)),
    "small": lambda body, scene: -float(np.prod(body.size)),
    "tall": lambda body, scene: float(body.size[2]),
    "short": lambda body, scene: -float(body.size[2]),
}


_SAID = {
    "on": "on",
    "off": "on",
    "over": "on",
    "under": "under",
    "in": "in",
    "beside": "beside",
    "nearest": "nearest to",
    "farthest": "farthest from",
    "left": "left of",
    "right": "right of",
    "behind": "behind",
    "front": "in front of",
    "between": "between",
}


def _standing(relation: str, rest: Sequence[Body], marks: Sequence[Body]) -> list[Body]:
    """Bodies that have the relation to one of the landmarks."""
    stands = _STANDING[relation]
    return [body for body in rest if any(stands(body, mark, rest) for mark in marks)]


def _is_upon(body: Body, mark: Body, others: Sequence[Body]) -> bool:
    """Test that one body stands on another, also indirectly."""
    if _on(body, mark):
        return True
    return any(_on(body, other) and _is_upon(other, mark, others) for other in others)


def _on(upper: Body, lower: Body) -> bool:
    """Test that one body stands directly on another."""
    if upper.name in lower.carries:
        return True
    x, y = _middle(upper)[:2]
    near = abs(upper.bottom_z() - lower.top_z()) < TOUCHING
    return upper is not lower and near and lower.covers(x, y)


def _in(inner: Body, outer: Body) -> bool:
    """Test that one body is inside another."""
    x, y, z = _middle(inner)
    between = outer.bottom_z() < z < outer.top_z()
    return inner is not outer and between and outer.covers(x, y)


_STANDING: Mapping[str, Callable[[Body, Body, Sequence[Body]], bool]] = {
    "on": _is_upon,
    "off": _is_upon,
    "over": _is_upon,
    "under": lambda body, mark, _: _on(mark, body),
    "in": lambda body, mark, _: _in(body, mark),
}


def _middle(body: Body) -> Array:
    """Of its box, in the world, m."""
    return body.pose_world.rotation @ body.centre + body.pose_world.position


def _beside(
    relation: str, rest: Sequence[Body], marks: Sequence[Body], scene: Scene
) -> tuple[list[Body], str]:
    """Body that has the relation, the nearest of several, with a remark.

    Raises:
        PlanRejected: two are about as near.
    """
    middle = np.mean([_in_base(mark, scene) for mark in marks], axis=0)
    ways = [(_in_base(body, scene) - middle, body) for body in rest]
    so = [(float(np.hypot(*way[:2])), body) for way, body in ways if _SIDES[relation](way)]
    so.sort(key=lambda one: one[0], reverse=relation == "farthest")
    found = [body for _, body in so[:1]]
    if len(so) < 2:
        return found, _as_seen(relation, relation)
    (first, nearest), (second, other) = so[:2]
    told_apart, remark = first < NEARER * second, _as_seen(relation, relation)
    if relation in ("nearest", "farthest"):
        apart = abs(second - first)
        told_apart = apart > LEVEL
        remark = f"The {relation} is '{nearest.name}', by {1e3 * apart:.0f} mm."
    if told_apart:
        return found, remark
    names = f"'{nearest.name}' or '{other.name}'"
    raise PlanRejected(f"{_SAID[relation]} it may stand {names}; name one")


_SIDES: Mapping[str, Callable[[Array], bool]] = {
    "beside": lambda way: True,
    "nearest": lambda way: True,
    "farthest": lambda way: True,
    "between": lambda way: True,
    "left": lambda way: bool(way[1] > APART),
    "right": lambda way: bool(way[1] < -APART),
    "behind": lambda way: bool(way[0] > APART),
    "front": lambda way: bool(way[0] < -APART),
}
