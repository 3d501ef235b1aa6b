"""Selection of a body by its position: "the box next to the red one".

Left and right, near and far are relative to the robot. The x axis of its base points away from it,
the y axis to its left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from palpate.common.parameter import PlanRejected
from palpate.common.pose import Array
from palpate.mjcf.body import Body
from palpate.scene.scene import Scene

APART = 0.02
"""m. Minimum distance to one side for a body to be on that side."""
TOUCHING = 0.02
"""m. Maximum height above a top for a body to stand on it."""
NEARER = 0.8
"""Ratio of distances below which the nearer of two bodies is unambiguous."""
LEVEL = 0.001
"""m. Minimum difference in distance for one body to be the nearest: scenes state millimetres."""
LARGER = 1.1
"""Ratio of sizes above which the larger of two bodies is unambiguous."""
_AXES = (
    {"left": ("y", 1), "right": ("y", -1), "large": ("volume", 1), "small": ("volume", -1)}
    | {"far": ("x", 1), "near": ("x", -1), "tall": ("height", 1), "short": ("height", -1)}
    | {"behind": ("x", 1), "front": ("x", -1)}
)
"""Compared measure, and its sign, by word."""
_PREPOSITIONS = {"nearest": " to", "farthest": " from", "left": " of", "right": " of"}


def farthest(place: str, names: Sequence[str], scene: Scene, said: str) -> tuple[str, str]:
    """Return the outermost body to one side, or the largest, with a remark.

    Raises PlanRejected: two bodies are equally far or large.
    """
    axis, sign = _AXES[place]
    # Rank by the signed measure and compare the best two: positions by difference, sizes by ratio.
    ranked = sorted(
        ((sign * _measure(axis, body, scene), body.name) for body in _bodies(scene, names)),
        key=lambda one: -one[0],
    )
    (first, name), (second, other) = ranked[:2]
    apart = max(abs(first), abs(second)) > LARGER * min(abs(first), abs(second))
    if axis in ("x", "y"):
        apart = first - second > APART
    if not apart:
        raise PlanRejected(f"'the {place} {said}' may be '{name}' or '{other}'; name one")
    return name, _as_seen(place)


def _measure(axis: str, body: Body, scene: Scene) -> float:
    if axis in ("x", "y"):
        return float(_in_base(body, scene)["xy".index(axis)])
    return float(np.prod(body.size) if axis == "volume" else body.size[2])


def standing(
    relation: str, said: str, names: Sequence[str], marks: Sequence[str], scene: Scene
) -> tuple[tuple[str, ...], str]:
    """Return the bodies of `names` with a relation to the landmarks, with a remark.

    Raises PlanRejected: no body has the relation, or the choice is ambiguous.
    """
    beside = _bodies(scene, marks)
    rest = _bodies(scene, [name for name in names if name not in marks])
    on_surface = relation in _STANDING and all(name in scene.surfaces for name in marks)
    if len(names) == 1 and on_surface and rest:
        # The height of a surface may be unknown, so a single body on it is not tested.
        return tuple(names), ""
    # Vertical relations compare boxes; horizontal ones compare distances and directions.
    if relation in _STANDING:
        stands = _STANDING[relation]
        found = [body for body in rest if any(stands(body, mark, rest) for mark in beside)]
        remark = ""
    else:
        found, remark = _bodies_in_relation(relation, rest, beside, scene)
    if not found:
        places = " and ".join(f"'{mark}'" for mark in marks)
        raise PlanRejected(f"no '{said}' of this scene is {_say(relation)} {places}")
    return tuple(body.name for body in found), remark


def _bodies_in_relation(
    relation: str, rest: Sequence[Body], marks: Sequence[Body], scene: Scene
) -> tuple[list[Body], str]:
    """Return the bodies with a horizontal relation; the nearest of several."""
    # Vectors from the centre of the landmarks to each body, in the base frame.
    middle = np.mean([_in_base(mark, scene) for mark in marks], axis=0)
    ways = [(_in_base(body, scene) - middle, body) for body in rest]
    axis, sign = _AXES.get(relation, ("x", 0))
    so = [
        (float(np.hypot(*way[:2])), body)
        for way, body in ways
        if not sign or sign * way["xy".index(axis)] > APART
    ]
    # Nearest first, or farthest first.
    so.sort(key=lambda one: one[0], reverse=relation == "farthest")
    remark = _as_seen(relation)
    if len(rest) < 2 or len(so) < 2:
        return [body for _, body in so], remark if len(rest) > 1 else ""
    # The choice needs a clear margin to the second body.
    (first, nearest), (second, other) = so[:2]
    clear = first < NEARER * second
    if relation in ("nearest", "farthest"):
        apart = abs(second - first)
        clear = apart > LEVEL
        remark = f"The {relation} is '{nearest.name}', by {1e3 * apart:.0f} mm."
    if clear:
        return [nearest], remark
    said = _say(relation)
    raise PlanRejected(f"{said} it may stand '{nearest.name}' or '{other.name}'; name one")


def _say(relation: str) -> str:
    said = {"front": "in front of", "off": "on", "over": "on"}.get(relation, relation)
    return said + _PREPOSITIONS.get(relation, "")


def _as_seen(relation: str) -> str:
    return f"'{relation}' is as the robot sees it." if relation in ("left", "right") else ""


def _bodies(scene: Scene, names: Iterable[str]) -> list[Body]:
    return [scene.bodies[name] for name in names if name in scene.bodies]


def _middle(body: Body) -> Array:
    """Centre of a body's box in the world, m."""
    return body.pose_world.rotation @ body.centre + body.pose_world.position


def _in_base(body: Body, scene: Scene) -> Array:
    """Centre of a body in the robot's base frame, m."""
    base = scene.pose_world_base
    return base.rotation.T @ (_middle(body) - base.position)


def _is_upon(body: Body, mark: Body, others: Sequence[Body]) -> bool:
    """True if a body stands on another, directly or indirectly."""
    if _on(body, mark):
        return True
    return any(_on(body, other) and _is_upon(other, mark, others) for other in others)


def _on(upper: Body, lower: Body) -> bool:
    """True if a body stands directly on another."""
    # Bottom at the height of the top, and centre above the footprint.
    x, y = _middle(upper)[:2]
    near = abs(upper.bottom_z() - lower.top_z()) < TOUCHING
    return upper.name in lower.carries or (upper is not lower and near and lower.covers(x, y))


def _in(inner: Body, outer: Body) -> bool:
    """True if the centre of a body lies between bottom and top of another, within its footprint."""
    x, y, z = _middle(inner)
    return inner is not outer and outer.bottom_z() < z < outer.top_z() and outer.covers(x, y)


_STANDING: Mapping[str, Callable[[Body, Body, Sequence[Body]], bool]] = {
    **dict.fromkeys(("on", "off", "over"), _is_upon),
    "under": lambda body, mark, _: _on(mark, body),
    "in": lambda body, mark, _: _in(body, mark),
}
