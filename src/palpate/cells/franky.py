"""The cell of a Franka arm: `franky://HOST`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell, Driver, Finding
from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.robots.franky.control_box import (
    SCHEME,
    Address,
    clear,
    read_address,
    require_answer,
)

if TYPE_CHECKING:
    from palpate.cells.teach import GuidedHand
    from palpate.robots.description import RobotDescription
    from palpate.robots.franky.robot import FrankyRobot
    from palpate.scene.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class FrankyCell(Cell):
    """A real workplace with a Franka in it. Implements `palpate.robots.robot.Recoverable` for an arm
    that is stopped before it is connected."""

    address: Address
    scene: Scene | None

    @property
    def description(self) -> str:
        """See `Cell`."""
        return f"Franka at {self.address}"

    def robot(self) -> FrankyRobot:
        """See `Cell`."""
        from palpate.robots.franky.robot import FrankyRobot
        from palpate.robots.franky.session import Session

        scene = self.scene
        if scene is None:
            raise InputError("a robot needs a scene to work in: give scene=D.xml")
        session = Session(self.address)
        # A robot that cannot be made leaves no session open.
        try:
            return FrankyRobot(session, scene.arm.real(), scene.pose_world_base, scene.gravity)
        except BaseException:
            session.close()
            raise

    def recover(self) -> None:
        """See `Recoverable`."""
        clear(self.address)


def connect(url: str, scene: Scene | None) -> FrankyCell:
    """The cell at a URL, whose control box answers.

    Raises:
        InputError: no such URL.
        Unavailable: it is out of reach.
    """
    address = read_address(url)
    require_answer(address)
    return FrankyCell(address, scene)


def examine(url: str, arm: RobotDescription, may_hold: Callable[[], bool]) -> Iterator[Finding]:
    """Run the diagnostic checks of the arm at a URL; see `Driver`.

    Raises:
        InputError: no such URL.
    """
    from palpate.robots.franky import doctor

    origin = arm.stands(Pose.of((0.0, 0.0, 0.0)))
    return doctor.examine(read_address(url), arm, origin, may_hold)


def guided(url: str, scene: Scene) -> GuidedHand:
    """The hand at a URL, for guiding by a person.

    Raises:
        InputError: no such URL.
        Unavailable: it is out of reach.
    """
    from palpate.robots.franky.session import Guided, Session

    return Guided(Session(read_address(url)), scene.arm.stands(scene.pose_world_base))


driver = Driver(SCHEME, connect, examine, guided)
