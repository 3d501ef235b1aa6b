"""Interfaces of a workplace and of its driver, and the teaching of poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.robots.description import RobotDescription
from palpate.robots.robot import Robot
from palpate.scene.poses import CameraEntry
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.perception.film import Footage


DECIMALS = 4  # Decimals of taught values: 0.1 mm and 0.1 mrad, finer than a hand can be guided
LEVEL = math.cos(math.radians(10.0))  # Cosine of the largest tilt of a hand that points down
APART = 0.003  # m, largest difference of a measured width from the scene's, as in `CloseGripper`


class GuidedHand(Protocol):
    """A hand that a person guides."""

    def where(self) -> tuple[Pose, float]:
        """Pose of the TCP in the world, and m between the fingers. Raises Unavailable: it does not answer."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


@dataclass(slots=True)
class Lesson:
    """Poses taught for a scene so far."""

    scene: Scene  # D
    # objects, places: entries of poses.yaml.
    objects: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    places: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    others: dict[str, Any] = field(default_factory=dict[str, Any])  # other sections of the file

    @property
    def names(self) -> tuple[str, ...]:
        """Names that can be taught: objects, and approaches to surfaces."""
        # Places are taught for surfaces only.
        approaches = [f"{name}_approach" for name in self.scene.surfaces]
        return (*self.scene.objects, *approaches)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the objects that are not taught yet."""
        return tuple(name for name in self.scene.objects if name not in self.objects)

    @property
    def content(self) -> dict[str, Any]:
        """Content of the poses.yaml."""
        sections = {"objects": self.objects, "places": self.places}
        return {name: entries for name, entries in sections.items() if entries} | self.others

    def shown(self, name: str, pose_world_tcp: Pose, width: float | None = None) -> str:
        """Enter an object or a place at the pose of the hand; return the entry as text.

        `width` is the opening of the fingers, m.
        Raises InputError: the hand does not point down, or the object cannot be grasped from above.
        """
        # Only poses of a hand that points down can be compared with top-down grasps.
        if pose_world_tcp.rotation[2, 2] > -LEVEL:
            raise InputError("the hand leans: lead it until it points straight down")
        yaw = _heading(pose_world_tcp)
        if name not in self.scene.objects:
            place = [round(float(part), DECIMALS) for part in pose_world_tcp.position]
            self.places[name] = {"pos": place, "yaw": round(yaw, DECIMALS)}
            return f"{name}: the hand at {_coordinates(pose_world_tcp)}"
        grasp = self.scene.symbols.resolve(f"{name}_pose")
        turned = yaw - _heading(grasp)
        # The two fingers are equal: a grasp turned by half a turn is the same grasp.
        turned -= math.pi * round(turned / math.pi)
        # The object keeps the pose in the hand that it has in the scene's grasp.
        pose_tcp_body = grasp.inverse() @ self.scene.body(name).pose_world
        level = Pose.top_down(
            (*pose_world_tcp.position[:2], grasp.position[2]), _heading(grasp) + turned
        )
        return self._enter(name, level @ pose_tcp_body, turned) + self._compare_width(name, width)

    def measured(self, name: str, x: float, y: float, yaw: float = 0.0) -> str:
        """Enter the middle of an object; return the entry as text.

        `x` and `y` are m ahead of the arm's base and to its left. `yaw` is the turn in rad from the
        object's pose in the scene. Raises InputError: the scene has no such object.
        """
        if name not in self.scene.objects:
            raise unknown_name("object", name, self.scene.objects)
        body = self.scene.body(name)
        middle = self.scene.pose_world_base.apply(np.array([x, y, 0.0]))
        # Rotation about the vertical by `yaw`, applied to the scene's attitude.
        half = Pose.of((0.0, 0.0, 0.0), (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)))
        turned = half @ Pose(np.zeros(3), body.pose_world.quaternion)
        # Convert from the middle of its shapes to the origin of its frame.
        away = turned.apply(body.centre)
        place = [middle[0] - away[0], middle[1] - away[1], body.pose_world.position[2]]
        return self._enter(name, Pose(np.array(place), turned.quaternion), yaw)

    def _enter(self, name: str, pose: Pose, turned: float) -> str:
        self.objects[name] = {
            "pos": [round(float(part), DECIMALS) for part in pose.position],
            "quat": [round(float(part), 6) for part in pose.quaternion],
        }
        angle = f"{math.degrees(turned):+.0f}°"
        return f"{name} at {_coordinates(pose)}, turned by {angle} from the scene's"

    def _compare_width(self, name: str, width: float | None) -> str:
        """Text that compares the finger width, m, with the object's size in the scene."""
        size = self.scene.body(name).size[:2]
        # Fully open fingers hold nothing, so their width says nothing about the object.
        if width is None or width > self.scene.arm.hand.opening - APART:
            return ""
        # The fingers may hold the object across either side.
        if (abs(size - width) <= APART).any():
            return f"; {1e3 * width:.0f} mm wide, as in the scene"
        sizes = " × ".join(f"{1e3 * side:.0f}" for side in size)
        return f"; {1e3 * width:.0f} mm wide, where the scene has {sizes} mm: is it the same thing?"


def _heading(pose_world_tcp: Pose) -> float:
    """The yaw of `Pose.top_down`, rad, for a hand that points about down."""
    # Angle of the tool's x axis in the plane, relative to that of yaw 0.
    reference = Pose.top_down((0.0, 0.0, 0.0), 0.0).rotation[:, 0]
    x, y = pose_world_tcp.rotation[:2, 0]
    return math.atan2(y, x) - math.atan2(reference[1], reference[0])


def _coordinates(pose: Pose) -> str:
    x, y, z = pose.position
    return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


# Interfaces of a workplace, and of the driver of one kind of real robot.


# Result of one diagnostic check: passed, name of the check, value or remedy.
Finding = tuple[bool, str, str]


class Cell(Protocol):
    """A workplace with one robot in it, simulated or real.

    By default a subclass has a real robot and no camera. Lifecycle in a run: `picture` before planning,
    if a picture is wanted; `robot` with a checked plan; `footage` after the robot was closed; `truth`
    after the estimates are made, never before.
    """

    @property
    def description(self) -> str:
        """Name of the workplace in the report."""
        ...

    @property
    def simulated(self) -> bool:
        """True if no real robot moves."""
        return False

    def picture(self, camera: CameraEntry | None = None) -> bytes | None:
        """The workspace before any motion, as PNG; None without a camera.

        A given `camera` is the viewpoint.
        """
        return None

    def robot(self) -> Robot:
        """Return the robot, at rest with open fingers; the caller closes it.

        Raises:
            InputError: the workplace cannot be used.
            Unavailable: the robot is out of reach.
        """
        ...

    def footage(self) -> Footage | None:
        """Return the camera's recording since the last call of `robot`, or None."""
        return None

    def truth(self, parameter: Parameter) -> tuple[float, ...] | None:
        """Return the true value in the quantity's unit; None if unknown, as for a real workplace."""
        return None


@runtime_checkable
class Close(Protocol):
    """Optional ability of a cell: a close-up of the objects for a vision model."""

    def closer(self) -> bytes | None:
        """Return a close-up of the objects as PNG, labelled with their names in the scene, axes and
        a scale; None without a camera."""
        ...


@dataclass(frozen=True, slots=True)
class Driver:
    """Factory of the cells of one kind of robot.

    It is public in a module that an entry point of the group `palpate.cells` names.
    """

    scheme: str  # scheme of the robot's URLs, e.g. `franky` for `franky://HOST`.
    # Makes the cell at a URL, for a scene. Without a scene (the plan is made from a picture alone)
    # only the cell's `picture` is called.
    connect: Callable[[str, Scene | None], Cell]
    # Yields the findings of `palpate doctor --robot` on the robot at a URL with this description.
    # The last argument asks for permission to hold a position for some seconds. None without
    # diagnostics.
    examine: Callable[[str, RobotDescription, Callable[[], bool]], Iterator[Finding]] | None = None
    # The hand of the robot at a URL, for guiding by a person; None if it cannot be guided.
    guided: Callable[[str, Scene], GuidedHand] | None = None
