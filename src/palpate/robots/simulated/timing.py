"""Clock of the simulated robot, and observers of its physics steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import mujoco

TIMESTEP = 0.001  # s, the control cycle, 1 kHz
# Default physics steps in a control cycle, while anything touches or moves apart from the arm. With
# 1 ms, contacts and grasps are inaccurate.
SUBSTEPS = 2
BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * TIMESTEP
LONGEST_RUN = 8  # log periods, at most, between two updates of the feed-forward torques: 25 Hz


# Observers of a world, called after every physics step.


Watch = Callable[[mujoco.MjData], None]


@runtime_checkable
class Undoing(Protocol):
    """Observer that can undo steps.

    The world then takes many steps at once, and goes back where the arm stops itself among them.
    """

    def __call__(self, data: mujoco.MjData) -> None: ...

    def mark(self) -> Callable[[], None]:
        """Return a function that undoes all steps from here on."""
        ...


def takes_many(watch: Watch | None) -> bool:
    """Test if the world may take many steps at once before it knows that all of them stay."""
    return watch is None or isinstance(watch, Undoing)


def mark_steps(watch: Watch | None) -> Callable[[], None]:
    """Return a function that undoes all steps from here on."""
    # None first: an instance test against a protocol is slow.
    return watch.mark() if watch is not None and isinstance(watch, Undoing) else lambda: None
