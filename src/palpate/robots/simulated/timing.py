"""Clock of the embedded robot: physics, control and log."""

from __future__ import annotations

TIMESTEP = 0.001  # s, the control cycle, 1 kHz
SUBSTEPS = 2  # physics steps in a control cycle: 1 ms resolves contacts and grasps poorly
BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * TIMESTEP
LONGEST_RUN = 8  # log periods between two updates of the feed-forward torques, at most: 25 Hz
DAMPING_DELAY = TIMESTEP / SUBSTEPS / 2
"""s: torque is sampled at the beginning of a cycle's last physics step, dampers act at the end of
each."""
SPRING_DELAY = (SUBSTEPS - 1) * TIMESTEP / SUBSTEPS / 2
"""s: springs are sampled then, too, and act on average this much earlier."""
