"""The side door: what tests ask of a served robot, and do to it, that no client can.

One line of JSON each way, over a socket that only the process that started the server has.
"""

from __future__ import annotations

import json
import os
import socket
from typing import Any

import numpy as np

from palpate.common.parameter import Parameter

from .believed import Body
from .bench import Workbench
from .wire import Error


class Door:
    """Answers what is asked at the door of a workbench. Every public method is a question."""

    def __init__(self, bench: Workbench, line: socket.socket) -> None:
        self._bench, self._line = bench, line
        self._reader = line.makefile("rb")
        self._over = False

    def visit(self) -> bool:
        """Answer one question; whether to go on serving."""
        asked = self._reader.readline()
        if not asked:
            return False
        question = json.loads(asked)
        answer = getattr(self, question["ask"])(**question["with"])
        self._line.sendall(json.dumps(answer).encode() + b"\n")
        return not self._over

    def ready(self) -> bool:
        """Whether it serves."""
        return True

    def stop(self) -> None:
        """Stop serving."""
        self._over = True

    def kill(self) -> None:
        """Die without a word."""
        os._exit(9)

    def hang_up(self) -> None:
        """Cut the connections."""
        self._bench.server.hang_up()

    def freeze(self, frozen: bool) -> None:
        """Neither hear nor say anything."""
        self._bench.server.frozen = frozen

    def lose(self, share: float) -> None:
        """So many of the client's commands do not arrive."""
        self._bench.robot.loses = share

    def user_stop(self, pressed: bool) -> None:
        """Press the button, or release it."""
        self._bench.robot.user_stop(pressed)

    def brakes(self, closed: bool) -> None:
        """Close them in Desk, or open them."""
        self._bench.robot.lock(closed)

    def guide(self, q: list[float]) -> None:
        """Take the arm by hand, to joint angles (7,), rad."""
        self._bench.robot.guide(np.array(q))

    def reflex(self) -> None:
        """Something hits the arm."""
        if self._bench.robot.moving:
            self._bench.robot.reflex(Error.CARTESIAN_REFLEX)

    def recover(self) -> None:
        """Somebody clears the errors in Desk."""
        self._bench.robot.recover()

    def hand_refuses(self, refuses: bool) -> None:
        """The hand does nothing any more."""
        self._bench.hand.refuses = refuses

    def end_effector(self, mass: float, centre: list[float] | None = None) -> None:
        """What is configured in Desk. kg, and (3,) m in the flange's frame."""
        believed = self._bench.believed
        nominal = believed.nominal_ee
        middle = nominal.centre if centre is None else np.array(centre)
        self._bench.robot.configure(Body(mass, middle, nominal.inertia))

    def truth(self, name: str) -> list[float] | None:
        """What is so, by the name of a parameter such as `bottle.mass`."""
        value = self._bench.cell.truth(Parameter(*name.rsplit(".", 1)))
        return None if value is None else list(value)

    def pose(self, body: str) -> list[float]:
        """(7,) of a body, world."""
        pose = self._bench.plant.true_poses([body])[body]
        return [*pose.position.tolist(), *pose.quaternion.tolist()]

    def counts(self) -> dict[str, Any]:
        """Cycles in all and in command, those lost, ms of a processor that one took, the mode, the
        largest force so far, N, mean of 5 ms, and the fastest that any object went down, m/s."""
        robot, server = self._bench.robot, self._bench.server
        return {
            "cycles": server.cycles,
            "commanded": robot.commanded,
            "lost": robot.lost,
            "ms": 1e3 * server.seconds / max(server.cycles, 1),
            "mode": robot.mode.name,
            "peak": self._bench.sensing.peak,
            "fell": self._bench.plant.fell,
        }

    def touching(self) -> float:
        """N, the largest contact force on the arm now."""
        return self._bench.plant.touching()
