"""Belief in the pose of a thing: seen with a covariance P, and corrected by touches, one Kalman update each.

The state x = (p, θ) is the error of the believed pose: position, m, and small rotation, rad, along the world's
axes. A touch of the thing at a point c along a direction n measures how much farther along n than believed it was
met, y = H x + e with H = (n, (c - o) x n), o the thing's origin, and e ~ N(0, R).

Fingers that close on a free thing push it to their middle, by an amount that nothing measures: its pose is
diffuse along n, up to the width of the opened fingers, before it is measured there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.common.pose import Array, Pose

Means = Literal["probe", "fingers"]
"""Means of a touch: a guarded motion meets a thing, or the fingers close on it."""
SURE = 3.0
"""Standard deviations of a believed pose: a touch farther off contradicts it, and motions and fingers leave as much
room."""
ERROR = 1e-3
"""m (1 sigma), of a touch as a run has it before anything is fitted: the arm's place, the length of its tips, and
what gives way under the press."""
SLIPS = 3e-3
"""m (1 sigma) level, by which a thing that is dragged along its support lags in the pads: up to 5 mm, simulated."""


@dataclass(frozen=True, slots=True)
class BeliefTouch:
    """A touch of a thing.

    Attributes:
        means: how.
        along: (3,) unit direction, world.
        point: (3,) m, world, where.
        apart: m along it from where the thing was believed to where it was met.
        std: m, of the touch alone.
        believed_std: m, of the belief before, along it.
    """

    means: Means
    along: tuple[float, float, float]
    point: tuple[float, float, float]
    apart: float
    std: float
    believed_std: float

    @property
    def z(self) -> float:
        """Deviation from the belief in standard deviations."""
        return self.apart / float(np.hypot(self.std, self.believed_std))

    @property
    def contradicts(self) -> bool:
        """True if it contradicts what was believed."""
        return abs(self.z) > SURE

    @property
    def said(self) -> str:
        """Its measurement in words."""
        axes = zip("xyz", self.along, strict=True)
        axis, part = max(axes, key=lambda one: abs(one[1]))
        sign = "-" if part < 0.0 else "+"
        apart = round(1e3 * self.apart, 1) + 0.0  # no negative zero
        return f"{apart:+.1f} ± {1e3 * self.std:.1f} mm along {sign}{axis}"


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Belief in the pose of a thing.

    Attributes:
        seen, seen_covariance: pose of its frame in the world before any touch, with its covariance (6, 6).
        placed: where it stood, by sight and touch, before anything pushed or carried it.
        pose, covariance: where it is now, along the world's axes.
        touches: in order.
    """

    seen: Pose
    seen_covariance: Array
    placed: Pose
    pose: Pose
    covariance: Array
    touches: tuple[BeliefTouch, ...] = ()

    @classmethod
    def of(cls, pose: Pose, covariance: Array) -> Belief:
        """Belief before any touch."""
        return cls(pose, covariance, pose, pose, covariance)

    @property
    def is_moved(self) -> bool:
        """True if touch found that it stood elsewhere than it was seen."""
        return self.placed.digits != self.seen.digits

    @property
    def contradiction(self) -> str:
        """Touches that contradict sight, in words; empty for none."""
        found = [touch for touch in self.touches if touch.contradicts]
        return "; ".join(
            f"it was met {touch.said} from where it was seen, {abs(touch.z):.1f} standard deviations: it does not "
            "stand there, or is of another size"
            for touch in found
        )

    def at(self, pose: Pose) -> Belief:
        """The same of the thing carried to `pose`: its errors turn with it."""
        turn = np.kron(np.eye(2), pose.rotation @ self.pose.rotation.T)
        return replace(self, pose=pose, covariance=turn @ self.covariance @ turn.T)

    def after_drag(self) -> Belief:
        """The same once the thing was dragged between the fingers."""
        slips = np.diag([SLIPS**2, SLIPS**2, 0.0, 0.0, 0.0, 0.0])
        return replace(self, covariance=self.covariance + slips)

    def std(self, along: Array, point: Array | None = None) -> float:
        """Standard deviation, m, along a direction (3,) at a point (3,) of the thing, world; by default at its
        origin."""
        row = self._row(along, self.pose.position if point is None else point)
        return float(np.sqrt(row @ self.covariance @ row))

    def touched(
        self, means: Means, along: Array, point: Array, apart: float, pushed: float = 0.0
    ) -> Belief:
        """The belief after a touch at `point` (3,), m, `apart` m farther along `along` (3,) than believed, of a thing
        that was `pushed` there by up to that many m to either side.

        What a touch contradicts was less sure than stated: its covariance grows to where the touch is `SURE`
        standard deviations off.
        """
        row, noise = self._row(along, point), ERROR
        prior = self.covariance.copy()
        # Uniform to either side.
        prior[:3, :3] += pushed**2 / 3.0 * np.outer(along, along)
        spread = float(row @ prior @ row)
        x, y, z = along.tolist()
        made = BeliefTouch(
            means, (x, y, z), tuple(point.tolist()), apart, noise, float(np.sqrt(spread))
        )
        if made.contradicts:
            prior *= max(((apart / SURE) ** 2 - noise**2) / max(spread, 1e-12), 1.0)
            spread = float(row @ prior @ row)
        gain = prior @ row / (spread + noise**2)
        step = gain * apart
        # Joseph's form, which stays a covariance.
        rest = np.eye(6) - np.outer(gain, row)
        covariance = rest @ prior @ rest.T + noise**2 * np.outer(gain, gain)
        turned = Pose.turn(step[3:]) @ Pose.of((0.0, 0.0, 0.0), self.pose.quaternion)
        pose = Pose(self.pose.position + step[:3], turned.quaternion)
        # What stood freely was found where it stands; what the fingers have closed on was pushed.
        placed = self.placed if pushed else self.placed @ self.pose.inverse() @ pose
        return replace(
            self, placed=placed, pose=pose, covariance=covariance, touches=(*self.touches, made)
        )

    def _row(self, along: Array, point: Array) -> Array:
        """(6,) H of a touch."""
        return np.concatenate([along, np.cross(point - self.pose.position, along)])
