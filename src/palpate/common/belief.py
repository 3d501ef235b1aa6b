"""Belief in the pose of an object: seen with a covariance P, and corrected by touches, one Kalman update
each.

The state x = (p, θ) is the error of the believed pose: position, m, and small rotation, rad, along the
world's axes. A touch of the object at a point c along a direction n measures how much farther along n the
contact was than believed: y = H x + e with H = (n, (c - o) × n), the object's origin o, and e ~ N(0, R).

Fingers that close on a free object push it to their middle, by an unmeasured amount. Before the object is
measured there, its pose is diffuse along n, up to the width of the opened fingers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.common.pose import Array, Pose

# Means of a touch: a guarded motion meets an object, or the fingers close on it.
Means = Literal["probe", "fingers"]
# Standard deviations of a believed pose. A larger deviation of a touch contradicts the pose;
# motions and fingers leave this margin.
SURE = 3.0
# m (1 sigma): error of a touch as a run measures it before any fit. It covers the arm's position,
# the length of its tips, and the deformation under the press.
ERROR = 1e-3
# m (1 sigma), horizontal: lag in the pads of an object that is dragged along its support. It was up
# to 5 mm in simulation.
SLIPS = 3e-3


@dataclass(frozen=True, slots=True)
class BeliefTouch:
    """A touch of an object."""

    means: Means  # means of the touch
    along: tuple[float, float, float]  # (3,) unit direction, world
    point: tuple[float, float, float]  # (3,) m, world, contact point
    apart: float  # m along `along` from the believed to the measured contact
    std: float  # m, of the touch alone
    believed_std: float  # m, of the previous belief, along `along`

    @property
    def z(self) -> float:
        """Deviation from the belief in standard deviations."""
        return self.apart / float(np.hypot(self.std, self.believed_std))

    @property
    def contradicts(self) -> bool:
        """True if the touch contradicts the belief."""
        return abs(self.z) > SURE

    @property
    def description(self) -> str:
        """The measurement in words."""
        # Name the axis with the largest component.
        axes = zip("xyz", self.along, strict=True)
        axis, part = max(axes, key=lambda item: abs(item[1]))
        sign = "-" if part < 0.0 else "+"
        gap = round(1e3 * self.apart, 1) + 0.0  # no negative zero
        return f"{gap:+.1f} ± {1e3 * self.std:.1f} mm along {sign}{axis}"


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Belief in the pose of an object."""

    # seen, seen_covariance: pose of its frame in the world before any touch, with its covariance
    # (6, 6).
    seen: Pose
    seen_covariance: Array
    placed: Pose  # pose, by sight and touch, before any motion pushed or carried the object
    # pose, covariance: present pose, along the world's axes.
    pose: Pose
    covariance: Array
    touches: tuple[BeliefTouch, ...] = ()  # in order

    @classmethod
    def of(cls, pose: Pose, covariance: Array) -> Belief:
        """Make the belief before any touch."""
        return cls(pose, covariance, pose, pose, covariance)

    @property
    def is_moved(self) -> bool:
        """True if touches showed that the object's pose differed from the seen one."""
        return self.placed.digits != self.seen.digits

    @property
    def contradiction(self) -> str:
        """Touches that contradict sight, in words; empty for none."""
        contradicting = [touch for touch in self.touches if touch.contradicts]
        return "; ".join(
            f"it was met {touch.description} from where it was seen, {abs(touch.z):.1f} standard "
            "deviations: it does not stand there, or is of another size"
            for touch in contradicting
        )

    def at(self, pose: Pose) -> Belief:
        """Return the belief after the object was carried to `pose`: its errors turn with it."""
        # Rotate both blocks of the covariance: P' = T P Tᵀ.
        turn = np.kron(np.eye(2), pose.rotation @ self.pose.rotation.T)
        return replace(self, pose=pose, covariance=turn @ self.covariance @ turn.T)

    def after_drag(self) -> Belief:
        """Return the belief after the object was dragged between the fingers."""
        # Dragging adds horizontal variance of the position.
        slips = np.diag([SLIPS**2, SLIPS**2, 0.0, 0.0, 0.0, 0.0])
        return replace(self, covariance=self.covariance + slips)

    def std(self, along: Array, point: Array | None = None) -> float:
        """Compute the standard deviation, m, along a direction (3,) at a point (3,) of the object, world; by
        default at its origin.
        """
        row = self._row(along, self.pose.position if point is None else point)
        return float(np.sqrt(row @ self.covariance @ row))

    def update(
        self, means: Means, along: Array, point: Array, gap: float, pushed: float = 0.0
    ) -> Belief:
        """Update the belief by a touch at `point` (3,), m, that was `gap` m farther along `along` (3,) than
        believed.

        The fingers may have `pushed` the object there by up to that many m to either side. A contradicted
        belief was less certain than stated: its covariance grows until the touch is `SURE` standard
        deviations off.
        """
        # Prior variance along the direction, H P Hᵀ.
        row, noise = self._row(along, point), ERROR
        prior = self.covariance.copy()
        # Variance of a uniform push to either side: pushed² / 3.
        prior[:3, :3] += pushed**2 / 3.0 * np.outer(along, along)
        spread = float(row @ prior @ row)
        x, y, z = along.tolist()
        touch = BeliefTouch(
            means, (x, y, z), tuple(point.tolist()), gap, noise, float(np.sqrt(spread))
        )
        # Inflate a contradicted prior.
        if touch.contradicts:
            prior *= max(((gap / SURE) ** 2 - noise**2) / max(spread, 1e-12), 1.0)
            spread = float(row @ prior @ row)
        # Kalman gain K = P Hᵀ / (H P Hᵀ + R), and the correction of the pose.
        gain = prior @ row / (spread + noise**2)
        step = gain * gap
        # Joseph form of the covariance, which stays positive semidefinite.
        rest = np.eye(6) - np.outer(gain, row)
        covariance = rest @ prior @ rest.T + noise**2 * np.outer(gain, gain)
        # Apply the correction to position and orientation.
        rotated = Pose.turn(step[3:]) @ Pose.of((0.0, 0.0, 0.0), self.pose.quaternion)
        pose = Pose(self.pose.position + step[:3], rotated.quaternion)
        # A free object was found in its original place; an object that the fingers closed on was pushed.
        placed = self.placed if pushed else self.placed @ self.pose.inverse() @ pose
        return replace(
            self, placed=placed, pose=pose, covariance=covariance, touches=(*self.touches, touch)
        )

    def _row(self, along: Array, point: Array) -> Array:
        """Return the row H (6,) of a touch."""
        return np.concatenate([along, np.cross(point - self.pose.position, along)])
