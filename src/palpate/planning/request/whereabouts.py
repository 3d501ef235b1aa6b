"""Which of several things is meant, by where it stands: "the box beside the red one".

Left and right, near and far are as the robot sees them: x of its base points away from it, y to
its left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.errors import PlanRejected
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body
from palpate.planning.request.item import Item
from palpate.planning.request.lexicon import DETERMINERS, EVERY, EVERYTHING, PASSIVE
from palpate.planning.request.wording import english
from palpate.scene.scene import Scene

APART = 0.02
"""m: what is less far to one side is not on that side."""
TOUCHING = 0.02
"""m: what stands no farther above a top stands on it."""
NEARER = 0.8
"""One of several stands beside a thing where its distance is less than this of the next one's."""
LARGER = 1.1
"""One of several is the large one where it is larger than the next by this."""

_AROUND = DETERMINERS | EVERY | {"that", "which"}
_VIEWS = ("left", "right")


def located(items: Sequence[Item], scene: Scene, remarks: list[str]) -> list[Item]:
    """The items; things that are named by where they stand are those things, and what they stand
    beside is not asked about.

    Raises:
        PlanRejected: nothing stands there, or it cannot be told which does.
    """
    found = list(_selected(items, scene, remarks))
    at = len(found) - 1
    while at >= 0:
        span = _landmark(found, at)
        if span is not None and found[at].kind == "deed":
            del found[at + 1 : span[2] + 1]
        elif span is not None:
            relation, marks, end = span
            found[at : end + 1] = [_placed(found[at], relation, marks, scene, remarks)]
        at -= 1
    return found


def _selected(items: Sequence[Item], scene: Scene, remarks: list[str]) -> Iterator[Item]:
    """The items; "the left box" is that of the boxes which stands farthest to the left."""
    for before, item in zip([None, *items], items, strict=False):
        if item.kind == "selector":
            continue
        several = item.kind == "object" and not item.plural and len(item.fitting) > 1
        if before is not None and before.kind == "selector" and several:
            bodies = [scene.bodies[name] for name in item.fitting]
            chosen = _extreme(before.names[0], bodies, scene, before.text, item.text)
            if before.names[0] in _VIEWS:
                remarks.append(f"'{before.text}' is as the robot sees it.")
            yield replace(item, names=(chosen,), fitting=(chosen,))
        else:
            yield item


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
    """Where its middle is as the robot sees it, m."""
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


def _landmark(items: Sequence[Item], at: int) -> tuple[str, tuple[Item, ...], int] | None:
    """What is said of where item `at` stands: the relation, to which things, and where that ends."""
    done = items[at].kind == "deed" and at > 0 and items[at - 1].text in PASSIVE
    if not (done or _may_stand(items[at])):
        return None
    i = at + 1
    while i < len(items) and items[i].text in english().tying:
        i += 1
    if i >= len(items) or items[i].kind != "stop" or not items[i].names:
        return None
    relation = items[i].names[0]
    marks: list[Item] = []
    end = i
    for k in range(i + 1, len(items)):
        if items[k].kind == "object":
            marks.append(items[k])
            end = k
            if relation != "between" or len(marks) == 2:
                break
        elif items[k].text not in _AROUND and not (marks and items[k].kind == "list"):
            break
    wanted = 2 if relation == "between" and not any(mark.plural for mark in marks) else 1
    return (relation, tuple(marks), end) if len(marks) == wanted else None


def _may_stand(item: Item) -> bool:
    if item.kind == "everything" or item.text in ("what", "whatever"):
        return True
    return item.kind == "object" and bool(item.names)


def _placed(
    item: Item, relation: str, marks: Sequence[Item], scene: Scene, remarks: list[str]
) -> Item:
    """The item as the things that it names and that stand so."""
    landmarks = [
        scene.bodies[name] for mark in marks for name in mark.names if name in scene.bodies
    ]
    taken = {body.name for body in landmarks}
    everything = item.kind != "object"
    candidates = list(scene.objects) if everything else list(item.names)
    rest = [scene.bodies[name] for name in candidates if name in scene.bodies]
    rest = [body for body in rest if body.name not in taken]
    if relation in _STANDING and len(candidates) == 1 and not everything:
        return item
    if relation in _STANDING:
        found = _standing(relation, rest, landmarks)
    elif len(rest) <= 1 and not everything:
        found = rest
    else:
        found = _beside(relation, rest, landmarks, scene)
    if relation in _VIEWS and len(rest) > 1:
        remarks.append(f"'{relation}' is as the robot sees it.")
    if not found:
        said = " and ".join(f"'{mark.text}'" for mark in marks)
        raise PlanRejected(f"no '{item.text}' of this scene is {_SAID[relation]} {said}")
    names = tuple(body.name for body in found)
    several = item.plural or (everything and item.text in EVERYTHING | EVERY)
    return Item("object", item.words, names, several or everything, names)


_STANDING = ("on", "under", "in", "off", "over")
_SAID = {
    "on": "on",
    "off": "on",
    "over": "on",
    "under": "under",
    "in": "in",
    "beside": "beside",
    "left": "left of",
    "right": "right of",
    "behind": "behind",
    "front": "in front of",
    "between": "between",
}


def _standing(relation: str, rest: Sequence[Body], landmarks: Sequence[Body]) -> list[Body]:
    """Those of the rest that stand on the landmarks, also by way of others, in them or under them."""
    if relation == "under":
        return [body for body in rest if any(_on(mark, body) for mark in landmarks)]
    if relation == "in":
        return [body for body in rest if any(_in(body, mark) for mark in landmarks)]
    found: list[Body] = []
    below = list(landmarks)
    while below:
        carried = {name for body in below for name in body.carries}
        on = [b for b in rest if b.name in carried or any(_on(b, other) for other in below)]
        below = [body for body in on if body not in found]
        found += below
    return found


def _on(upper: Body, lower: Body) -> bool:
    """Whether one stands on the other."""
    x, y = _middle(upper)[:2]
    near = abs(upper.bottom_z() - lower.top_z()) < TOUCHING
    return upper is not lower and near and lower.covers(x, y)


def _in(inner: Body, outer: Body) -> bool:
    """Whether one is inside the other."""
    x, y, z = _middle(inner)
    between = outer.bottom_z() < z < outer.top_z()
    return inner is not outer and between and outer.covers(x, y)


def _middle(body: Body) -> Array:
    """Of its box, in the world, m."""
    return body.pose_world.rotation @ body.centre + body.pose_world.position


def _beside(
    relation: str, rest: Sequence[Body], landmarks: Sequence[Body], scene: Scene
) -> list[Body]:
    """That of the rest which stands so, the nearest where several do.

    Raises:
        PlanRejected: two are about as near.
    """
    mark = np.mean([_in_base(body, scene) for body in landmarks], axis=0)
    apart = [(_in_base(body, scene) - mark, body) for body in rest]
    so = [(float(np.linalg.norm(way[:2])), body) for way, body in apart if _SIDES[relation](way)]
    so.sort(key=lambda one: one[0])
    if len(so) > 1 and so[0][0] > NEARER * so[1][0]:
        names = " or ".join(f"'{body.name}'" for _, body in so[:2])
        raise PlanRejected(f"{_SAID[relation]} it may stand {names}; name one")
    return [body for _, body in so[:1]]


_SIDES: Mapping[str, Callable[[Array], bool]] = {
    "beside": lambda way: True,
    "between": lambda way: True,
    "left": lambda way: bool(way[1] > APART),
    "right": lambda way: bool(way[1] < -APART),
    "behind": lambda way: bool(way[0] > APART),
    "front": lambda way: bool(way[0] < -APART),
}
