"""Clock of the simulated robot, and observers of its physics steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import mujoco

from palpate.common.pose import Array

TIMESTEP = 0.001  # s, the control cycle, 1 kHz
# Default physics steps in a control cycle, while anything touches or moves apart from the arm. With
# 1 ms, contacts and grasps are inaccurate.
SUBSTEPS = 2
BLOCK = 5  # cycles per logged sample: 200 Hz
PERIOD = BLOCK * TIMESTEP
LONGEST_RUN = 8  # log periods, at most, between two updates of the feed-forward torques: 25 Hz


# Observers of a world, called after every physics step.


Watch = Callable[[mujoco.MjData], None]


class Undoing(ABC):
    """Observer that can undo steps.

    The world then takes many steps at once, and goes back where the arm stops itself among them.
    """

    @abstractmethod
    def __call__(self, data: mujoco.MjData) -> None:
        """Record one physics step."""

    @abstractmethod
    def mark(self) -> Callable[[], None]:
        """Return a function that undoes all steps from here on."""

    @abstractmethod
    def pass_untouched(self, qpos: Array) -> None:
        """Record steps in which nothing touches anything, by the configurations `qpos` (n, nq) after each of them."""


def takes_many(watch: Watch | None) -> bool:
    """Test if the world may take many steps at once before it knows that all of them stay."""
    return watch is None or isinstance(watch, Undoing)
