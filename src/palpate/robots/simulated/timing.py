"""Clock of the embedded robot: physics, control and log."""

from __future__ import annotations

TIMESTEP = 0.001  # s, the control cycle, 1 kHz
SUBSTEPS = 2
"""Physics steps in a control cycle, by default: 1 ms resolves contacts and grasps poorly."""
BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * TIMESTEP
LONGEST_RUN = 8  # log periods between two updates of the feed-forward torques, at most: 25 Hz


def damped_after(step: float) -> float:
    """Return the s from the sample of a cycle's torque, at the beginning of its last physics step of `step` s, to the
    mean moment at whose speed dampers act: the integrator, implicit in them, takes that at the end of each step."""
    return (3.0 * step - TIMESTEP) / 2.0
