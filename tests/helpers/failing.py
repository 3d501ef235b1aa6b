"""A robot of which one member fails, from some moment on or only once."""

from __future__ import annotations

from typing import Any

from palpate.robots.robot import RobotState


class Failing:
    """As `robot`, but `member` raises from `moment` (s of robot time) on, `times` times."""

    def __init__(
        self,
        robot: Any,
        member: str,
        moment: float,
        times: int = 10**9,
        error: BaseException | None = None,
    ) -> None:
        self.robot, self.member, self.moment, self.left = robot, member, moment, times
        self.error = error or ConnectionError("no answer")

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.robot, name)
        if name != self.member:
            return found
        if isinstance(found, RobotState):
            self.fail()
            return found

        def called(*args: Any) -> Any:
            self.fail()
            return found(*args)

        return called

    def fail(self) -> None:
        """Raise, where it is time to."""
        if self.robot.state.t >= self.moment and self.left:
            self.left -= 1
            raise self.error
