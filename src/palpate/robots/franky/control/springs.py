"""The springs and dampers that franky's controllers are given."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.franky.library import franky
from palpate.robots.sheet import Stiffness
from palpate.robots.simulated.impedance import POSTURE_RATE, Gains, Inertia

TORQUE_STEP = 0.8
"""N m that a commanded torque changes by in one cycle at most; libfranka refuses 1 N m."""
BLENDING = 0.1
"""s: time constant with which springs change."""


class Springs:
    """franky's gains for an arm's stiffness: dampers are critical for what each spring moves."""

    def __init__(self, stiffness: Stiffness) -> None:
        self.stiffness = stiffness

    def of_tcp(self, inertia: Inertia) -> Any:
        """A `CartesianImpedanceGains`."""
        gains = Gains.of_tcp(self.stiffness, inertia)
        return franky().CartesianImpedanceGains.diagonal(gains.stiffness, gains.damping)

    def of_joints(self, inertia: Inertia) -> tuple[Array, Array]:
        """Stiffness (7,), N m/rad, and damping (7,), N m s/rad."""
        gains = Gains.of_joints(self.stiffness, inertia)
        return gains.stiffness, gains.damping

    def posture(self, inertia: Inertia) -> tuple[Array, Array]:
        """The same for the null space."""
        own = np.diag(inertia.joints)
        return POSTURE_RATE**2 * own, 2 * POSTURE_RATE * own
