"""Swings of a load: the numbers."""

ARM_SWING = 3e-4
"""part (1 sigma) of what the arm feels as it swings empty that is another with a load for no known
reason: a thousandth of a joint's torque is beyond its sensor's linearity. Sensitive: hardly."""

ARM_BENT = 0.05
"""part (1 sigma) of what moves the arm's links otherwise with a load that is not known: nominal
inertias are some per cent off. Sensitive: inertia std ×0.9–1.2."""

SAME_AXIS = 0.98
"""cosine between the axes of two swings that compare. Sensitive: no."""

SAME_RATE = 0.02
"""part by which their rates may differ. Sensitive: no."""

TURNING_POINT = 0.04
"""s in which a commanded swing may seem to stand still. Sensitive: no."""

SHORTEST_SWING = 0.8
"""s: a shorter turn of the hand is no swing. Sensitive: no."""

RATE_SEARCH = (0.05, 0.005, 0.0005)
"""parts of a rate within which it is looked for, one after the other. Sensitive: no."""

RATE_STEPS = 21
"""rates that are tried each time. Sensitive: no."""

SWING_FLOOR = 3e-4
"""N m: noise that is always assumed, and what the pads' and the joints' play leave. Sensitive: inertia
std ×0.9–1.1."""

LOG_MASS_PRIOR = 3.0
"""1 sigma of half the logarithm of a mass: nothing is known of it. Sensitive: no."""

RADIUS_PRIOR = 0.35
"""1 sigma of the logarithm of how far the mass lies from its centre: in the core it is half of the
box's, at the rim nearly twice; an inertia is that squared. Sensitive: weak axes' std ×0.5–2.0."""

SKEW_PRIOR = 0.3
"""part of that distance (1 sigma) by which the mass lies askew to the body's axes. Sensitive: no."""

GIVE_PRIOR = 4e-4
"""s² (1 sigma): what gives way between pads and object, by the square of the rate: it rings at 8 Hz or
more. Sensitive: inertia std ×0.8–1.2."""
