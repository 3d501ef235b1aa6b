"""Interfaces of a workplace, and of the driver that makes those of one kind of real robot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from palpate.parameter import Parameter
from palpate.robots.robot import Robot

if TYPE_CHECKING:
    from palpate.cells.teach import GuidedHand
    from palpate.pictures.film import Footage
    from palpate.robots.description import RobotDescription
    from palpate.scene.poses import CameraEntry
    from palpate.scene.scene import Scene

Finding = tuple[bool, str, str]
"""Result of one diagnostic check: passed, name of the check, and its value or the remedy."""


class Cell(Protocol):
    """A workplace with one robot in it, simulated or real. A class that inherits from this one has a
    real robot, and no camera.

    A run calls in this order: `picture` before planning, where a picture is wanted; `robot` once there
    is a checked plan; `footage` when the robot has been closed; `truth` when the estimates are made,
    never before.
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
        """The workspace before anything moves, as PNG, seen by `camera` if there is one; None without
        a camera."""
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
    """Factory of the cells of one kind of robot: public in a module that an entry point of the
    group `palpate.cells` names.

    Attributes:
        scheme: of the robot's URLs, e.g. `franky` for `franky://HOST`.
        connect: makes the cell at a URL, for a scene. Without a scene (a plan is made from a picture
            alone) only the cell's `picture` is called.
        examine: yields what `palpate doctor --robot` reports of the robot at a URL with this
            description; the last argument asks whether the robot may hold a position for some seconds.
            None without diagnostics.
        guided: the hand of the robot at a URL, for guiding by a person; None where it cannot be
            guided.
    """

    scheme: str
    connect: Callable[[str, Scene | None], Cell]
    examine: Callable[[str, RobotDescription, Callable[[], bool]], Iterator[Finding]] | None = None
    guided: Callable[[str, Scene], GuidedHand] | None = None
