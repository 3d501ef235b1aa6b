"""A scene with a thing where touch found it."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from palpate.geometry.pose import Array, Pose
from palpate.scene.raised import TEMPORARY
from palpate.scene.scene import Scene


def corrected(scene: Scene, name: str, step: Pose, covariance: Array | None = None) -> Scene:
    """The scene with a body, and the named poses that belong to it, moved by `step` in the world, and as sure as a
    `covariance` (6, 6) says, if one is given. A place where it is put down meanwhile stays: only its height
    follows."""
    body = scene.bodies[name]
    there = step @ body.pose_world
    moved = replace(
        body,
        pose_world=there,
        tipped=step @ body.tipped @ step.inverse(),
        covariance=body.covariance if covariance is None else covariance,
    )
    rise = (0.0, 0.0, float(there.position[2] - body.pose_world.position[2]))

    def to(symbol: str, pose: Pose) -> Pose:
        if scene.symbols.subjects.get(symbol) != name:
            return pose
        return pose.translated(rise) if symbol.endswith(TEMPORARY) else step @ pose

    return replace(
        scene,
        bodies=MappingProxyType({**scene.bodies, name: moved}),
        symbols=scene.symbols.moved(to),
        as_given=scene.as_given or scene,
    )
