"""What a cell's camera saw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

    from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """What the cell's 30 Hz camera saw: the world's model and its configurations, (t in s, qpos),
    to be rendered."""

    model: mujoco.MjModel
    frames: tuple[tuple[float, Array], ...]
