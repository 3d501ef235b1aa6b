"""The parallel hand: a servo of limited force, and what its encoders tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.geometry.pose import Array

OPEN = 0.04
"""m: each finger's way from the middle when open."""
CLOSED = -0.006
"""m: beyond touching, so that the drive saturates at its grasp force on thin objects too."""
SPEED = 0.05
"""m/s per finger: Franka Hand manual, travel speed 50 mm/s."""
SATURATION = 0.004
"""m: how far the set-point must lead for the grasp force of 40 N per finger (fr3.xml: 80 N over 20
kN/m)."""
STANDSTILL = 0.001
"""m/s: fingers slower than this stand still."""
STANDING = 0.1
"""s: and for so long, before they count as stopped."""
NOTHING = 0.002
"""m: an opening below this is an empty hand."""


class Gripper:
    """Set-points for the fingers, and their state. Times are robot time, s."""

    def __init__(self) -> None:
        self.width = 2 * OPEN
        """m between the fingers."""
        self.moving = False
        """A command is under way."""
        self._goal = self._from = OPEN
        self._since = self._last_moved = 0.0

    @property
    def gripping(self) -> bool:
        """Closed, and stopped on something."""
        return self._goal == CLOSED and not self.moving and self.width > NOTHING

    def open(self, t: float) -> None:
        """Start opening fully."""
        self._start(t, OPEN)

    def close(self, t: float) -> None:
        """Start closing until something resists."""
        self._start(t, CLOSED)

    def setpoints(self, t: Array) -> Array | float:
        """Each finger's commanded way from the middle at times `t` (n,), m."""
        if t[0] - self._since > abs(self._goal - self._from) / SPEED:
            return self._goal
        way = SPEED * (t - self._since)
        if self._goal > self._from:
            return np.minimum(self._from + way, self._goal)
        return np.maximum(self._from - way, self._goal)

    def observe(self, t: float, fingers: Sequence[float], speeds: Sequence[float]) -> None:
        """Take note of the fingers' two ways from the middle, m, and their speeds, m/s.

        Fingers that touch are closed, however much the end stops give under the drive.
        """
        self.width = max(0.0, sum(fingers))
        if not self.moving:
            return
        if max(map(abs, speeds)) > STANDSTILL or not self._pressed(t):
            self._last_moved = t
        self.moving = t - self._last_moved < STANDING

    def _pressed(self, t: float) -> bool:
        """The set-point has arrived, or leads by enough for the full force."""
        commanded = float(np.asarray(self.setpoints(np.array([t]))).flat[0])
        return commanded == self._goal or commanded < self.width / 2 - SATURATION

    def _start(self, t: float, goal: float) -> None:
        commanded = float(np.asarray(self.setpoints(np.array([t]))).flat[0])
        self._from = float(
            np.clip(commanded, self.width / 2 - SATURATION, self.width / 2 + SATURATION)
        )
        self._since = self._last_moved = t
        self._goal, self.moving = goal, True
