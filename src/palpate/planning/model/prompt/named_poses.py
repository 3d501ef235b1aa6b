"""Section of the prompt with every name that a pose expression may use: places, patterns of names that
many objects share, and offsets with their directions in the world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import atan2, degrees

from palpate.geometry.pose import Array, Pose
from palpate.scene.named.handles import points_down
from palpate.scene.symbols import Symbols

KINDS: Mapping[str, str] = {
    "temporary": "the grasp of X with it put down on a free spot",
    "top": "above the top of X",
    "across": "a grasp of X a quarter turn on; its x_offset and y_offset turn with it",
    "balance": "where X balances, as its grasps before have shown",
}
"""Poses that objects have besides their grasp, by the end of the name."""

HEAD = (
    "# Named poses\nGripper in the world: x y z in m, direction of its x axis in degrees from world x, counterclockwise"
    " seen from above. Pointing down, its y axis, along which the fingers close, is 90° clockwise from there."
)


def named_poses(symbols: Symbols) -> str:
    """Lines of all named poses, joint configurations and offsets, and of what cannot be grasped."""
    lines = [f"{name}: {position_and_yaw(pose)}" for name, pose in symbols.poses.items()]
    lines += _patterns(symbols)
    lines += [f"{name}: joint configuration" for name in symbols.configurations]
    lines.append("Offsets, as vectors x y z in the world, m:")
    lines += _offsets(symbols)
    lines += [f"{name} cannot be grasped: {why}" for name, why in symbols.ungraspable.items()]
    return "\n".join(lines)


def position_and_yaw(pose: Pose) -> str:
    """Position (m) and direction of the x axis (degrees), or, of a level hand, where its fingers point."""
    x, y, z = (f"{value + 0.0:.3f}" for value in pose.position.round(3))
    if not points_down(pose):
        return f"{x} {y} {z}, fingers level, along {_vector(pose.rotation[:, 2])}"
    direction = degrees(atan2(pose.rotation[1, 0], pose.rotation[0, 0]))
    return f"{x} {y} {z}, {round(direction)}"


def _patterns(symbols: Symbols) -> Iterator[str]:
    """Yield a line for each kind of pose, with the objects that have it."""
    objects = list(symbols.own_offsets)
    for kind, meaning in KINDS.items():
        having = [
            name
            for name in objects
            if f"{name}_{kind}" in symbols.usable and f"{name}_{kind}" not in symbols.poses
        ]
        if having:
            whose = "any object" if having == objects else ", ".join(having)
            yield f"X_{kind}: {meaning}; X: {whose}"


def _offsets(symbols: Symbols) -> Iterator[str]:
    """Yield a line for each set of offsets, with the objects and places that have it."""
    groups: dict[str, list[str]] = {}
    for name in symbols.own_offsets:
        groups.setdefault(_vectors(symbols, f"{name}_pose"), []).append(name)
    places = [
        name for name in symbols.poses if symbols.subjects.get(name) not in symbols.own_offsets
    ]
    for name in places:
        groups.setdefault(_vectors(symbols, name), []).append(name)
    for vectors, names in groups.items():
        yield f"{', '.join(names)}: {vectors}"


def _vectors(symbols: Symbols, pose: str) -> str:
    """Offsets at a pose, in the world."""
    own = symbols.own_offsets.get(symbols.subjects.get(pose, ""), {})
    return ", ".join(
        f"{name} {_vector(symbols.shift(pose, symbols.poses[pose], symbols.offset(name, pose)))}"
        for name in dict.fromkeys([*own, *symbols.offsets])
    )


def _vector(vector: Array) -> str:
    """Components in m, to the millimetre."""
    return " ".join(f"{value + 0.0:.3f}".rstrip("0").rstrip(".") for value in vector.round(3))
