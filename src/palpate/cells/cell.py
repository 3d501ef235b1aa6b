"""Cell: a robot, a view of the table, and in simulation the truth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from palpate.parameter import Parameter
from palpate.robots.robot import Robot

if TYPE_CHECKING:
    from palpate.pictures.footage import Footage
    from palpate.scene.poses import CameraEntry


class Cell(Protocol):
    """A workplace with one robot in it, simulated or real.

    A run asks in this order: `picture` before planning, where somebody wants to look; `robot` once
    there is a checked plan; `footage` when the robot has been closed; `truth` when the estimates are
    made, never before.
    """

    @property
    def description(self) -> str:
        """Place of the run, in words, for the report."""
        ...

    @property
    def simulated(self) -> bool:
        """True if no real thing moves."""
        ...

    def picture(self, camera: CameraEntry | None = None) -> bytes | None:
        """The workspace before anything moves, as PNG, seen by `camera` if there is one; None where
        nothing can look."""
        ...

    def robot(self) -> Robot:
        """The robot, at rest with open fingers; whoever asks closes it.

        Raises:
            InputError: the workplace cannot be used.
            Unavailable: the robot is out of reach.
        """
        ...

    def footage(self) -> Footage | None:
        """Footage of the cell's camera since the robot was last requested, or None."""
        ...

    def truth(self, parameter: Parameter) -> tuple[float, ...] | None:
        """True value in the quantity's unit; None if unknown, as with real objects."""
        ...


@runtime_checkable
class Close(Protocol):
    """Optional ability of a cell: show a model closer views."""

    def closer(self) -> bytes | None:
        """The things from nearer, as PNG, with the names that the scene has for them, axes and a
        scale; None where nothing can look."""
        ...
