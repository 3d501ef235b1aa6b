"""Drivers of real robots by URL, and the cell of a Franka."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from palpate.common.errors import InputError, Unavailable
from palpate.common.extensions import Registry, iter_entry_points
from palpate.common.pose import Pose
from palpate.execution.cell import Cell, Driver, Finding, GuidedHand
from palpate.robots.description import RobotDescription
from palpate.robots.franky import doctor
from palpate.robots.franky.control_box import SCHEME, Address, clear, read_address, require_answer
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.robots.franky.robot import FrankyRobot


@dataclass(frozen=True, slots=True, eq=False)
class FrankyCell(Cell):
    """A real workplace with a Franka in it.

    Implements `palpate.robots.robot.Recoverable` for an arm that is stopped before it is connected.
    """

    address: Address
    scene: Scene | None

    @property
    def description(self) -> str:
        return f"Franka at {self.address}"

    def robot(self) -> FrankyRobot:
        from palpate.robots.franky.robot import FrankyRobot
        from palpate.robots.franky.session import FrankySession

        scene = self.scene
        if scene is None:
            raise InputError("a robot needs a scene to work in: give scene=D.xml")
        session = FrankySession(self.address)
        # Close the session if the robot cannot be made.
        try:
            return FrankyRobot(session, scene.arm.real(), scene.pose_world_base, scene.gravity)
        except BaseException:
            session.close()
            raise

    def recover(self) -> None:
        clear(self.address)


def connect(url: str, scene: Scene | None) -> FrankyCell:
    """Cell at a URL, after its control box has answered."""
    address = read_address(url)
    require_answer(address)
    return FrankyCell(address, scene)


def examine(url: str, arm: RobotDescription, may_hold: Callable[[], bool]) -> Iterator[Finding]:
    """Run the diagnostic checks of the arm at a URL; see `Driver`."""
    # Without a scene, the arm's base is the origin of the world.
    origin = arm.stands(Pose.of((0.0, 0.0, 0.0)))
    return doctor.examine(read_address(url), arm, origin, may_hold)


def open_guided_hand(url: str, scene: Scene) -> GuidedHand:
    """Hand at a URL, for guiding by a person.

    Raises:
        InputError: no such URL.
        Unavailable: it is out of reach.
    """
    from palpate.robots.franky.session import FrankySession, Guided

    return Guided(FrankySession(read_address(url)), scene.arm.stands(scene.pose_world_base))


driver = Driver(SCHEME, connect, examine, open_guided_hand)


# Registry of robot drivers by URL scheme.


class Drivers(Registry[Driver]):
    """Known drivers, by scheme."""

    kind = "driver"

    def connect(self, url: str, scene: Scene | None) -> Cell:
        """The cell at `url`."""
        return self.of(url).connect(url, scene)

    def of(self, url: str) -> Driver:
        """The driver for a URL."""
        scheme = url.partition("://")[0]
        if scheme not in self:
            have = ", ".join(sorted(self)) or "none"
            raise Unavailable(
                f"no driver for '{url}': leave robot= out to use the embedded one; drivers: {have}"
            )
        return self[scheme]


@cache
def drivers() -> Drivers:
    """Palpate's own drivers and those of the entry-point group `palpate.cells`."""
    others = (part for part in iter_entry_points("palpate.cells") if isinstance(part, Driver))
    return Drivers([(one.scheme, one) for one in (driver, *others)])
