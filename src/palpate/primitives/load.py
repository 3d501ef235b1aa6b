"""Load on the fingers, and the share that its support carries.

Both are differences from the wrench with empty fingers right before they closed. The sensed force of a
real arm is never zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.pace import Doubt

# Largest fraction of an object's weight on the fingers when they open. It is the rest of the arm's
# sag, which relaxes meanwhile.
BORNE = 0.3
# m, closing of the fingers that shows slip: the object slides or turns out of them. The pads'
# compliance is smaller.
CLOSING = 0.002
# Number of standard deviations for a significant change of the moment, and for the largest weight.
SURE = 3.0
TURNED = 0.15  # N m in addition, since the pads are compliant
# N, largest weight that cannot be distinguished from zero. Franka states a relative accuracy of 0.8
# N, and joints stick.
UNFELT = 1.5
# m, largest distance of the hand from its grasp pose at which an object that was never lifted is still in place
AT_GRASP = 0.003
# Largest plausible friction between an object and its support: rubber on dry concrete.
ROUGHEST = 1.0
# N, least normal force for a friction coefficient: ten times Franka's relative accuracy.
PRESSED = 8.0
BREAKAWAY = 1.3  # Largest ratio of static to dynamic friction
SURELY = Doubt(np.zeros(1), 0.0)  # No doubt about a measured load, in any joint


@dataclass(frozen=True, slots=True, eq=False)
class FingerLoad:
    """Measured load on the fingers."""

    # (6,) external wrench right before they closed, in the convention of `palpate.trace`.
    empty: Array
    width: float = 0.0  # m between the fingers as they closed on the object
    hanging: Array | None = None  # (6,) wrench at rest with the object hanging free; None before
    moment: float | None = None  # N m about the closing direction then
    doubt: Doubt = SURELY  # standard deviations of the moment
    rough: float = ROUGHEST  # upper bound of the support's friction, by slides so far
    error: float = 0.0  # N, largest error of the weight in `hanging`, from friction in the joints
    # N, upper bound of the weight by an estimate of the mass. With a folded arm, joint friction
    # biases the weight in `hanging` by newtons.
    heaviest: float = math.inf
    gives: float = 0.0  # m by which the full force compressed it
    grasped_at: Pose | None = None  # pose (world) of the TCP as they closed; None before

    def after_drag(self, wrench: Array) -> FingerLoad:
        """Update the friction bound by the wrench (6,) while the object is dragged along its support."""
        normal = self.support_load(wrench)
        if self.hanging is None or not normal > PRESSED:
            return self
        # Coulomb friction: sideways force over normal force, with a margin for breakaway.
        sideways = float(np.linalg.norm(wrench[:2] - self.hanging[:2]))
        return replace(self, rough=min(ROUGHEST, BREAKAWAY * sideways / normal))

    def set_hanging_load(
        self, wrench: Array, tool: Pose, doubt: Doubt = SURELY, error: float = 0.0
    ) -> FingerLoad:
        """Update by the wrench (6,) at rest with the object hanging free from the hand at `tool`.

        `error`, N, is the largest error of the force.
        """
        moment = _moment(wrench, tool)
        return replace(self, hanging=wrench, moment=moment, doubt=doubt, error=error)

    def turned(
        self, wrench: Array, tool: Pose, doubt: Doubt = SURELY, unrepeated: float = 0.0
    ) -> str | None:
        """Reason why the object has turned between the pads; None if it has not.

        A turn brings the centre of mass below the pads, and the moment vanishes. `unrepeated`, N m, is
        the change of the moment by the same motion with the empty hand.
        """
        if self.moment is None:
            return None
        change = abs(_moment(wrench, tool) - self.moment)
        # The sign of joint friction at rest is random, so allow twice its effect.
        if change <= TURNED + SURE * doubt.of_change(self.doubt) + 2.0 * unrepeated:
            return None
        return f"it turns in the fingers: its moment changed by {change:.2f} N m"

    @property
    def weight(self) -> float:
        """Weight that hung on the fingers, N; 0 before."""
        if self.hanging is None:
            return 0.0
        return min(max(float(self.hanging[2] - self.empty[2]), 0.0), self.heaviest)

    def after_weighing(self, mass: float, std: float, gravity: float) -> FingerLoad:
        """Update by an estimate of the held object's mass, kg, in a gravity in m/s^2."""
        return replace(self, heaviest=(mass + SURE * std) * gravity)

    def slip(self, width: float) -> str | None:
        """Reason why fingers `width` m apart no longer hold the object; None if they do."""
        if width > self.width - CLOSING:
            return None
        return f"slip: the fingers closed from {1e3 * self.width:.1f} to {1e3 * width:.1f} mm"

    def borne(self, wrench: Array) -> float:
        """Load on the fingers at `wrench` (6,), N; negative where they press."""
        return float(wrench[2] - self.empty[2])

    def explain_carried_load(self, wrench: Array, spare: float = 0.0) -> str | None:
        """Return the reason why opening at `wrench` (6,) would drop the load, with a margin `spare`, N; else None."""
        # An object that never hung free: compare with the wrench of the empty fingers.
        if self.hanging is None:
            bears = self.borne(wrench)
            return None if bears <= UNFELT - spare else f"the fingers still carry {bears:.1f} N"
        if self.support_load(wrench) >= max(UNFELT, (1.0 - BORNE) * self.weight) + spare:
            return None
        return (
            f"the support carries {self.support_load(wrench):.1f} N, and the fingers still carry the rest of the "
            f"{self.weight:.1f} N"
        )

    def is_where_it_stood(self, tool: Pose) -> bool:
        """True if the object never hung free, and the hand at `tool` is where it grasped the object."""
        if self.hanging is not None or self.grasped_at is None:
            return False
        return tool.distance_to(self.grasped_at) <= AT_GRASP

    def support_load(self, wrench: Array) -> float:
        """Return the load, N, that the support takes off the fingers; 0 if the object never hung free."""
        return 0.0 if self.hanging is None else float(self.hanging[2] - wrench[2])


def _moment(wrench: Array, tool: Pose) -> float:
    """Moment of a wrench (6,) about the closing direction, N m."""
    return float(wrench[3:] @ tool.rotation[:, 1])


NOTHING = FingerLoad(np.zeros(6))  # Load before any measurement
