"""Interface of a workplace: a robot, a view of the table, and ground truth if it is simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from palpate.parameter import Parameter
from palpate.robots.robot import Robot

if TYPE_CHECKING:
    from palpate.pictures.film import Footage
    from palpate.scene.poses import CameraEntry


class Cell(Protocol):
    """A workplace with one robot in it, simulated or real.

    A run asks in this order: `picture` before planning, where somebody wants to look; `robot` once
    there is a checked plan; `footage` when the robot has been closed; `truth` when the estimates are
    made, never before.
    """

    @property
    def description(self) -> str:
        """Name of the workplace in the report."""
        ...

    @property
    def simulated(self) -> bool:
        """True if no real robot moves."""
        ...

    def picture(self, camera: CameraEntry | None = None) -> bytes | None:
        """The workspace before anything moves, as PNG, seen by `camera` if there is one; None where
        nothing can look."""
        ...

    def robot(self) -> Robot:
        """Return the robot, at rest with open fingers; the caller closes it.

        Raises:
            InputError: the workplace cannot be used.
            Unavailable: the robot is out of reach.
        """
        ...

    def footage(self) -> Footage | None:
        """Return the camera's recording since the last call of `robot`, or None."""
        ...

    def truth(self, parameter: Parameter) -> tuple[float, ...] | None:
        """Return the true value in the quantity's unit; None if unknown, as for a real workplace."""
        ...


@runtime_checkable
class Close(Protocol):
    """Optional ability of a cell: a close-up of the objects for a vision model."""

    def closer(self) -> bytes | None:
        """Return a close-up of the objects as PNG, labelled with their names in the scene, axes and
        a scale; None without a camera."""
        ...
