"""Clock of the embedded robot: physics, control and log."""

from __future__ import annotations

TIMESTEP = 0.001  # s, the control cycle, 1 kHz
SUBSTEPS = 2
"""Physics steps in a control cycle, by default, while anything touches or moves beside the arm: 1 ms resolves
contacts and grasps poorly."""
BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * TIMESTEP
LONGEST_RUN = 8  # log periods between two updates of the feed-forward torques, at most: 25 Hz
