"""Contact forces and waiting of a running primitive.

A contact is detected by the median wrench of several ticks: a spike of one tick is none, a longer
press is one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.accuracy import SUSTAINED
from palpate.robots.robot import Robot
from palpate.vocabulary.base import Blackboard, LeafFailure, Wait

SETTLED_SPEED = 0.003  # m/s
CREEPING = 0.01
"""rad/s: the elbow of an arm with a faster joint still moves, though the TCP rests. Friction turns round with
it, and where the arm is folded near its base, that changes the sensed force by newtons. At rest an FR3 reports
up to 0.004 rad/s (a recording at 1 kHz)."""
DWELL = 0.3
"""s at rest until a motion counts as settled where the wrench is compared with an earlier one; windows
at rest also feed the estimators."""
BRIEF = 0.1  # s, likewise, where nothing is compared
SETTLE_LIMIT = 3.0  # s
MEDIAN_TIME = 0.06  # s that the ticks of a median wrench take
MET = 8.0
"""N: change of the contact force that is a contact; five times the effect of the joints' friction and
the sensors' bias as the arm sets out."""
SETTING_OUT = (0.2, 0.4)
"""s from the begin of a probe in which it sets out: then the arm no longer swings, and its joints'
friction has reversed."""
GROWS = 1.0
"""N by which the reaction force grows meanwhile in contact: at 12 mm/s a rigid body presses by 3.6 N
more on springs of 3000 N/m, and one of 600 N/m by 0.7 N."""
DRIFT = np.array([20.0, 20.0, 20.0, 60.0, 60.0, 60.0])
"""N/m and N m/m, largest change of the free-air wrench with position: one and a half times that of an
uncalibrated arm (gains, links, friction; 12 arms, 15 N/m and 40 N m/m)."""
DRIFT_MOST = np.array([1.5, 1.5, 1.5, 6.0, 6.0, 6.0])
"""N and N m, its largest change altogether: the same, over 0.1 m. A soft body is pressed by so much more
than a threshold at most."""


class WrenchFilter:
    """Median filter of the external wrench over the last ticks.

    Attributes:
        first: (6,) the first median, in the convention of `palpate.trace`; nan before.
    """

    def __init__(self, robot: Robot) -> None:
        self.first: Array = np.full(6, np.nan)
        self._robot = robot
        self._ticks: deque[Array] = deque(maxlen=SUSTAINED)

    def now(self) -> Array:
        """(6,) median of the last ticks; to be called once a tick. nan in the first ones, which
        neither exceeds nor falls below any threshold."""
        self._ticks.append(self._robot.state.contact)
        if len(self._ticks) < SUSTAINED:
            return np.full(6, np.nan)
        a, b, c = self._ticks
        # The median of three; np.median takes ten times as long.
        wrench = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
        if np.isnan(self.first).any():
            self.first = wrench
        return wrench


class FreeAir:
    """Baseline of a probe's wrench in free air; updated once a tick.

    At first it is the wrench at rest. On the way the joints' friction adds a step, and the wrench
    drifts with position. A contact comes later than the step, and grows more steeply than the drift.

    Attributes:
        wrench: (6,) in the convention of `palpate.trace`; nan before the first tick.
    """

    def __init__(self, robot: Robot, direction: Array) -> None:
        self.wrench: Array = np.full(6, np.nan)
        self._robot, self._direction = robot, direction
        self._begin, self._at = robot.state.t, robot.state.pose_world_tcp
        self._setting_out: list[Array] = []
        self._under_way: Array | None = None

    @property
    def known(self) -> bool:
        """True once the arm has set out."""
        return self._under_way is not None

    def follow(self, wrench: Array) -> None:
        """Update with the median wrench (6,) of a tick."""
        if np.isnan(self.wrench).any():
            self.wrench = wrench
        here, since = self._robot.state.pose_world_tcp, self._robot.state.t - self._begin
        if since > SETTING_OUT[1]:
            if self._under_way is None:
                self._under_way = self.wrench = self._set_out()
            # Follow the wrench no faster than free air can drift, and no farther.
            most = DRIFT * here.distance_to(self._at)
            drifted = self.wrench + np.clip(wrench - self.wrench, -most, most)
            total = np.clip(drifted - self._under_way, -DRIFT_MOST, DRIFT_MOST)
            self.wrench = self._under_way + total
        elif since > SETTING_OUT[0]:
            self._setting_out.append(wrench)
        self._at = here

    def _set_out(self) -> Array:
        """(6,) median wrench as the arm set out, unless it grew, as in contact."""
        wrenches = self._setting_out
        if not wrenches:
            return self.wrench
        half = len(wrenches) // 2
        grown = np.median(wrenches[half:], axis=0) - np.median(wrenches[: half + 1], axis=0)
        if abs(grown[:3] @ self._direction) > GROWS:
            return self.wrench
        return np.median(wrenches, axis=0)


def median_wrench(blackboard: Blackboard) -> Generator[float | None, None, Array]:
    """Wait for some ticks; (6,) the median wrench meanwhile."""
    wrenches: list[Array] = []
    for _ in range(SUSTAINED):
        wrenches.append(blackboard.robot.state.contact)
        yield
    return np.median(wrenches, axis=0)


def settle(blackboard: Blackboard, dwell: float = DWELL) -> Wait:
    """Wait until the arm, its elbow too, has been at rest for `dwell` s.

    Raises:
        LeafFailure: it does not come to rest.
    """
    start = since = blackboard.robot.state.t
    while (now := blackboard.robot.state.t) - since < dwell:
        since = max(since, _moved(blackboard))
        if now - start > SETTLE_LIMIT + dwell:
            raise LeafFailure(f"the arm does not settle within {SETTLE_LIMIT:g} s")
        yield dwell - (now - since)


def _moved(blackboard: Blackboard) -> float:
    """Robot time, s, at which the arm last moved, by its state and the samples since the last tick; -inf where it
    rested."""
    state, rows = blackboard.robot.state, blackboard.recorder.newest
    if np.linalg.norm(state.twist[:3]) > SETTLED_SPEED or np.abs(state.dq).max() > CREEPING:
        return state.t
    moves = np.linalg.norm(rows.twist[:, :3], axis=1) > SETTLED_SPEED
    moves |= np.abs(rows.dq).max(1, initial=0.0) > CREEPING
    return float(rows.t[moves].max(initial=-np.inf))


def finish(blackboard: Blackboard) -> Wait:
    """Wait until the arm's commanded motion has ended."""
    yield
    while blackboard.robot.state.moving:
        yield np.inf


def never() -> bool:
    """Return False: always near enough to touch something."""
    return False


def guarded(
    blackboard: Blackboard, touching: Callable[[], bool], far: Callable[[], bool] = never
) -> Generator[float | None, None, bool]:
    """Wait until the arm's motion is in contact, and hold it there; False when the motion ended
    first. As long as it is `far` from touching, what the arm feels is soon enough to look."""
    yield
    while not touching():
        if not blackboard.robot.state.moving:
            return False
        yield np.inf if far() else None
    blackboard.robot.hold()
    return True


def in_words(force: Array) -> str:
    """A force (3,), N, by size and main direction: `12 N downwards`."""
    size = float(np.linalg.norm(force))
    names = (("+x", "-x"), ("+y", "-y"), ("upwards", "downwards"))
    axis = int(np.abs(force).argmax())
    direction = names[axis][int(force[axis] < 0)]
    return f"{size:.0f} N {direction}"
