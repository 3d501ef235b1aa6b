"""Coefficient of restitution of a body on a spring and a damper side by side (Kelvin and Voigt).

    m a = -k x - d v,    zeta = d / (2 sqrt(k m))

until the force is zero, as a contact does not pull; the body's weight, small against the force of a fast fall,
is left out. Schwager and Pöschel, "Coefficient of restitution and linear-dashpot model revisited", Granular
Matter 9 (2007), 465.
"""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning


def restitution(zeta: float) -> float:
    """Speed after over speed before the contact, at a damping ratio `zeta`. Below zero, where only errors lead, it is
    continued by its tangent, 1 - pi zeta."""
    if zeta < 0.0:
        return 1.0 - float(np.pi) * zeta
    if zeta < 1.0:
        root = float(np.sqrt(1.0 - zeta**2))
        # The time of contact times omega; of both branches of the arc tangent the one in (0, pi).
        contact = float(np.arctan2(2.0 * zeta * root, 2.0 * zeta**2 - 1.0)) / root
        return float(np.exp(-zeta * contact))
    root = float(np.sqrt(max(zeta**2 - 1.0, 1e-12)))
    contact = float(np.log((zeta + root) / (zeta - root))) / root
    return float(np.exp(-zeta * contact))


def damping_ratio(stiffness: float, damping: float, mass: float = tuning.FALLING_MASS) -> float:
    """Damping ratio of `mass`, kg, on a spring, N/m, and a damper, N s/m."""
    return damping / (2.0 * float(np.sqrt(stiffness * mass)))
