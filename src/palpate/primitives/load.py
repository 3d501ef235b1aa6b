"""Load on the fingers, and the share that its support bears.

Both are differences from the wrench with empty fingers right before they closed, as the sensed force of
a real arm is never zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.pace import Doubt

BORNE = 0.3
"""Part of an object's weight that the fingers may still bear when they open: the rest of the arm's sag,
which relaxes meanwhile."""
CLOSING = 0.002
"""m by which fingers close when the object slides or turns out of them; the pads' compliance is less."""
SURE = 3.0
"""Standard deviations that a change of the moment must exceed to be a turn, and that a weight may exceed its
estimate."""
TURNED = 0.15  # N m that it must exceed in addition: the pads are compliant
UNFELT = 1.5
"""N, largest weight that may be taken for none: Franka states 0.8 N relative accuracy, and joints stick."""
ROUGHEST = 1.0
"""Largest plausible friction between an object and its support: rubber on dry concrete."""
PRESSED = 8.0
"""N, least normal force for a friction coefficient: ten times Franka's relative accuracy."""
BREAKAWAY = 1.3  # Static over dynamic friction, at most

SURELY = Doubt(np.zeros(7), 0.0)  # No doubt about a measured load


@dataclass(frozen=True, slots=True, eq=False)
class FingerLoad:
    """Measured load on the fingers.

    Attributes:
        empty: (6,) external wrench right before they closed, in the convention of `palpate.trace`.
        width: m between the fingers as they closed on the object.
        hanging: (6,) wrench at rest with the object hanging free; None before.
        moment: N m about the closing direction then.
        doubt: standard deviations of the moment.
        rough: upper bound of the support's friction, by slides so far.
        heaviest: N, upper bound of the weight by an estimate of the mass: where the arm is folded, the
            friction of its joints looks like newtons, and `hanging` is another weight.
    """

    empty: Array
    width: float = 0.0
    hanging: Array | None = None
    moment: float | None = None
    doubt: Doubt = SURELY
    rough: float = ROUGHEST
    heaviest: float = math.inf

    def after_drag(self, wrench: Array) -> FingerLoad:
        """Update by the wrench (6,) while the object is dragged along its support."""
        normal = self.support_load(wrench)
        if self.hanging is None or not normal > PRESSED:
            return self
        sideways = float(np.linalg.norm(wrench[:2] - self.hanging[:2]))
        return replace(self, rough=min(ROUGHEST, BREAKAWAY * sideways / normal))

    def hung(self, wrench: Array, tool: Pose, doubt: Doubt = SURELY) -> FingerLoad:
        """Update by the wrench (6,) at rest with the object hanging free from the hand at `tool`."""
        return replace(self, hanging=wrench, moment=_moment(wrench, tool), doubt=doubt)

    def turned(
        self, wrench: Array, tool: Pose, doubt: Doubt = SURELY, unrepeated: float = 0.0
    ) -> str | None:
        """Reason why the object has turned between the pads; None if it has not. Its centre of mass
        would come below the pads, and the moment vanish. `unrepeated`, N m, is the change of the
        moment by such a motion alone."""
        if self.moment is None:
            return None
        change = abs(_moment(wrench, tool) - self.moment)
        # The sign of the joints' friction at rest is random: twice its effect.
        if change <= TURNED + SURE * doubt.of_change(self.doubt) + 2.0 * unrepeated:
            return None
        return f"it turns in the fingers: its moment about them changed by {change:.2f} N m"

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

    def too_much(self, wrench: Array, spare: float = 0.0) -> str | None:
        """Reason against opening the fingers at `wrench` (6,): they would drop their load. With
        `spare`, N, they may not open even if the measured load is that much smaller later."""
        if self.hanging is None:
            bears = self.borne(wrench)
            return None if bears <= UNFELT - spare else f"the fingers still bear {bears:.1f} N"
        if self.support_load(wrench) >= max(UNFELT, (1.0 - BORNE) * self.weight) + spare:
            return None
        return (
            f"the fingers are relieved of {self.support_load(wrench):.1f} N since it hung on them, and "
            f"still bear the {self.weight:.1f} N"
        )

    def support_load(self, wrench: Array) -> float:
        """Load, N, that the support takes off the fingers at `wrench` (6,); 0 if the object never
        hung free."""
        return 0.0 if self.hanging is None else float(self.hanging[2] - wrench[2])


def _moment(wrench: Array, tool: Pose) -> float:
    """N m of a wrench (6,) about the closing direction."""
    return float(wrench[3:] @ tool.rotation[:, 1])


NOTHING = FingerLoad(np.zeros(6))  # Load before any measurement
