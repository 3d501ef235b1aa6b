"""Teaching of object poses, by hand guiding or with a ruler: a `poses.yaml` for a scene.

A person guides the hand to the grasp pose of an object, pointing down, or to a place. This gives an
object's x, y and yaw; its height is taken from the scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from palpate.errors import InputError, unknown_name
from palpate.geometry.pose import Pose
from palpate.scene.scene import Scene

DECIMALS = 4
"""0.1 mm, and 0.1 mrad: finer than a hand can be led."""
LEVEL = math.cos(math.radians(10.0))
"""Of how far a hand may lean that points down."""
APART = 0.003
"""m by which a width may differ from the believed one: what `CloseGripper` lets pass."""


class GuidedHand(Protocol):
    """A hand that somebody leads."""

    def where(self) -> tuple[Pose, float]:
        """Pose of the TCP in the world, and m between the fingers.

        Raises:
            Unavailable: it does not answer.
        """
        ...

    def close(self) -> None:
        """Let go of the connection."""
        ...


@dataclass(slots=True)
class Lesson:
    """Poses taught for a scene so far.

    Attributes:
        scene: D.
        objects, places: entries of poses.yaml.
        others: what its other sections say.
    """

    scene: Scene
    objects: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    places: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    others: dict[str, Any] = field(default_factory=dict[str, Any])

    @property
    def names(self) -> tuple[str, ...]:
        """Names that can be taught: objects, and approaches to surfaces."""
        approaches = [f"{name}_approach" for name in self.scene.surfaces]
        return (*self.scene.objects, *approaches)

    @property
    def missing(self) -> tuple[str, ...]:
        """The objects that nobody has shown yet."""
        return tuple(name for name in self.scene.objects if name not in self.objects)

    @property
    def content(self) -> dict[str, Any]:
        """Of the poses.yaml."""
        sections = {"objects": self.objects, "places": self.places}
        return {name: said for name, said in sections.items() if said} | self.others

    def shown(self, name: str, pose_world_tcp: Pose, width: float | None = None) -> str:
        """Note that the hand is at an object, or at a place; returns what was understood.

        Raises:
            InputError: the hand does not point down, or the object cannot be grasped from above.
        """
        if pose_world_tcp.rotation[2, 2] > -LEVEL:
            raise InputError("the hand leans: lead it until it points straight down")
        if name not in self.scene.objects:
            self.places[name] = _entry(pose_world_tcp, _heading(pose_world_tcp))
            return f"{name}: the hand at {_spot(pose_world_tcp)}"
        grasp = self.scene.symbols.resolve(f"{name}_pose")
        turned = _heading(pose_world_tcp) - _heading(grasp)
        # A hand grasps as well turned by half a turn.
        turned -= math.pi * round(turned / math.pi)
        body = self.scene.body(name).pose_world
        spot = grasp.inverse() @ body
        level = Pose.top_down(
            (*pose_world_tcp.position[:2], grasp.position[2]), _heading(grasp) + turned
        )
        self.objects[name] = _entry(level @ spot, None)
        told = f"{name} at {_spot(level @ spot)}, turned by {math.degrees(turned):+.0f}° from the scene's"
        return told + self._compared(name, width)

    def measured(self, name: str, x: float, y: float, yaw: float = 0.0) -> str:
        """Note where an object's middle is, from the arm's foot: m ahead of it, m to its left, and
        rad by which it is turned from how the scene has it.

        Raises:
            InputError: the scene has no such object.
        """
        if name not in self.scene.objects:
            raise unknown_name("object", name, self.scene.objects)
        base, body = self.scene.pose_world_base, self.scene.body(name).pose_world
        spot = base.apply(np.array([x, y, 0.0]))
        half = Pose.of((0.0, 0.0, 0.0), (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)))
        turned = half @ Pose(np.zeros(3), body.quaternion)
        middle = self.scene.body(name).centre
        away = turned.apply(middle)
        place = np.array([spot[0] - away[0], spot[1] - away[1], body.position[2]])
        pose = Pose(place, turned.quaternion)
        self.objects[name] = _entry(pose, None)
        return f"{name} at {_spot(pose)}, turned by {math.degrees(yaw):+.0f}° from the scene's"

    def _compared(self, name: str, width: float | None) -> str:
        """Compare the measured finger width with the object's size in the scene, as a clause for the user."""
        arm, body = self.scene.arm, self.scene.body(name)
        if width is None or width > arm.hand.opening - APART:
            return ""
        near = [float(size) for size in body.size[:2] if abs(size - width) <= APART]
        if near:
            return f"; {1e3 * width:.0f} mm wide, as in the scene"
        sizes = " × ".join(f"{1e3 * size:.0f}" for size in body.size[:2])
        return f"; {1e3 * width:.0f} mm wide, where the scene has {sizes} mm: is it the same thing?"


def _entry(pose: Pose, yaw: float | None) -> dict[str, Any]:
    place = [round(float(part), DECIMALS) for part in pose.position]
    if yaw is not None:
        return {"pos": place, "yaw": round(yaw, DECIMALS)}
    return {"pos": place, "quat": [round(float(part), 6) for part in pose.quaternion]}


def _heading(pose_world_tcp: Pose) -> float:
    """rad: the yaw of `Pose.top_down` for a hand that points about down."""
    reference = Pose.top_down((0.0, 0.0, 0.0), 0.0).rotation[:, 0]
    x, y = pose_world_tcp.rotation[:2, 0]
    return math.atan2(y, x) - math.atan2(reference[1], reference[0])


def _spot(pose: Pose) -> str:
    x, y, z = pose.position
    return f"({x:.3f}, {y:.3f}, {z:.3f}) m"
