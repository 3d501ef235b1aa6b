"""Clock of the embedded robot: physics, control and log."""

from __future__ import annotations

TIMESTEP = 0.001  # s, the control cycle, 1 kHz
SUBSTEPS = 2
"""Physics steps in a control cycle, by default: 1 ms resolves contacts and grasps poorly."""
BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * TIMESTEP
LONGEST_RUN = 8  # log periods between two updates of the feed-forward torques, at most: 25 Hz


def damped_after(step: float) -> float:
    """Return by how many s dampers act later than a cycle's torque is sampled, on average.

    The sample is of the beginning of the cycle's last physics step, which lasts `step` s; the integrator is implicit
    in dampers, which act with the speed at the end of every step.
    """
    return (3.0 * step - TIMESTEP) / 2.0
