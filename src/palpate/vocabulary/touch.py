"""Force sensing of a running primitive, and its waiting.

A contact is judged by the median of several ticks: a spike of one tick is no contact, and what
presses for longer than that is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.accuracy import SUSTAINED
from palpate.robots.robot import Robot
from palpate.vocabulary.base import Blackboard, LeafFailure, Steps

SETTLED_SPEED = 0.003
"""m/s."""
DWELL = 0.3
"""s: how long the arm stands still before a motion counts as settled where what it feels may be
compared with what it felt before; still windows feed the estimators."""
BRIEF = 0.1
"""s: likewise, where nothing is compared."""
SETTLE_LIMIT = 3.0
"""s."""
WHILE_FELT = 0.06
"""s that these ticks take."""
MET = 8.0
"""N: change of the contact's force that is something met; five times what the joints' friction and
the sensors' bias do as the arm sets out."""


SETTING_OUT = (0.2, 0.4)
"""s from when a probe begins to when it is under way: its arm no longer swings, and its joints' friction has
turned against the motion."""
GROWS = 1.0
"""N that what presses back grows by meanwhile where something was met already: at 12 mm/s a rigid thing
presses by 3.6 N more on springs of 3000 N/m, and what gives way with 600 N/m by 0.7 N."""
DRIFT = np.array([20.0, 20.0, 20.0, 60.0, 60.0, 60.0])
"""N/m and N m/m that free air may change by with the place: one and a half times as much as an arm did that
nobody calibrated (gains, links, friction; 12 of them, 15 N/m and 40 N m/m)."""
DRIFT_MOST = np.array([1.5, 1.5, 1.5, 6.0, 6.0, 6.0])
"""N and N m that it may change by altogether: the same, over 0.1 m. What gives way is pressed by so much more
than a threshold at most."""


class Feeling:
    """The external wrench as it is felt for several ticks.

    Attributes:
        first: (6,) what was felt first, the convention of `palpate.trace`; not a number before.
    """

    def __init__(self, robot: Robot) -> None:
        self.first: Array = np.full(6, np.nan)
        self._robot = robot
        self._ticks: deque[Array] = deque(maxlen=SUSTAINED)

    def now(self) -> Array:
        """(6,) the median of the last ticks; to be asked once a tick. Not a number in the first
        ones, and so neither more nor less than any threshold."""
        self._ticks.append(self._robot.state.contact)
        if len(self._ticks) < SUSTAINED:
            return np.full(6, np.nan)
        wrench = middle(*self._ticks)
        if np.isnan(self.first).any():
            self.first = wrench
        return wrench


class FreeAir:
    """Baseline of a probe's force in free air; updated once a tick.

    At first that is what the arm felt at rest. Under way its joints rub, which is a step at once, and what
    it feels drifts with the place. A contact is neither: it comes later than the one, and grows more
    steeply than the other.

    Attributes:
        wrench: (6,) the convention of `palpate.trace`; not a number before.
    """

    def __init__(self, robot: Robot, direction: Array) -> None:
        self.wrench: Array = np.full(6, np.nan)
        self._robot, self._direction = robot, direction
        self._begin, self._at = robot.state.t, robot.state.pose_world_tcp
        self._setting_out: list[Array] = []
        self._under_way: Array | None = None

    def follow(self, felt: Array) -> None:
        """After another tick, in which `felt` (6,) was felt."""
        if np.isnan(self.wrench).any():
            self.wrench = felt
        here, since = self._robot.state.pose_world_tcp, self._robot.state.t - self._begin
        if since > SETTING_OUT[1]:
            self._drift(felt, here.distance_to(self._at))
        elif since > SETTING_OUT[0]:
            self._setting_out.append(felt)
        self._at = here

    def _drift(self, felt: Array, travelled: float) -> None:
        if self._under_way is None:
            self._under_way = self.wrench = self._set_out()
        most = DRIFT * travelled
        drifted = self.wrench + np.clip(felt - self.wrench, -most, most)
        since = np.clip(drifted - self._under_way, -DRIFT_MOST, DRIFT_MOST)
        self.wrench = self._under_way + since

    def _set_out(self) -> Array:
        """(6,) what was felt as the arm set out, unless it grew."""
        felt = self._setting_out
        if not felt:
            return self.wrench
        half = len(felt) // 2
        grown = np.median(felt[half:], axis=0) - np.median(felt[: half + 1], axis=0)
        if abs(grown[:3] @ self._direction) > GROWS:
            return self.wrench
        return np.median(felt, axis=0)


def middle(a: Array, b: Array, c: Array) -> Array:
    """The median of three, element by element; not a number where one of them is not."""
    return np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))


def feel(blackboard: Blackboard, ticks: int = SUSTAINED) -> Generator[None, None, Array]:
    """Wait for some ticks; (6,) the median wrench felt meanwhile."""
    felt: list[Array] = []
    for _ in range(ticks):
        felt.append(blackboard.robot.state.contact)
        yield
    return np.median(felt, axis=0)


def settle(blackboard: Blackboard, dwell: float = DWELL) -> Steps:
    """Wait until the arm has stood still for `dwell` s.

    Raises:
        LeafFailure: it does not come to rest.
    """
    start = since = blackboard.robot.state.t
    while blackboard.robot.state.t - since < dwell:
        if np.linalg.norm(blackboard.robot.state.twist[:3]) > SETTLED_SPEED:
            since = blackboard.robot.state.t
        if blackboard.robot.state.t - start > SETTLE_LIMIT + dwell:
            raise LeafFailure(f"the arm does not settle within {SETTLE_LIMIT:g} s")
        yield
    return "settled"


def finish(blackboard: Blackboard) -> Steps:
    """Wait until the arm's commanded motion has ended."""
    yield
    while blackboard.robot.state.moving:
        yield
    return "arrived"


def guarded(blackboard: Blackboard, touching: Callable[[], bool]) -> Generator[None, None, bool]:
    """Wait until the arm's motion touches something, and hold it there; False when the motion ended
    first."""
    yield
    while not touching():
        if not blackboard.robot.state.moving:
            return False
        yield
    blackboard.robot.hold()
    return True


def in_words(force: Array) -> str:
    """A force (3,), N, as people say it: `12 N downwards`."""
    size = float(np.linalg.norm(force))
    names = (("+x", "-x"), ("+y", "-y"), ("upwards", "downwards"))
    axis = int(np.abs(force).argmax())
    direction = names[axis][int(force[axis] < 0)]
    return f"{size:.0f} N {direction}"
