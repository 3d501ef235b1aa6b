"""Footage of a cell's camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

    from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """Footage of the cell's 30 Hz camera: the world's model and its configurations, (t in s, qpos),
    to be rendered.

    Attributes:
        spec: what the model was compiled from, which says how its bodies look; None: as they collide.
        believed: no camera saw it: it is the trace, played again.
    """

    model: mujoco.MjModel
    frames: tuple[tuple[float, Array], ...]
    spec: mujoco.MjSpec | None = None
    believed: bool = False

    def drawn(self, *, soft: bool = True) -> mujoco.MjModel:
        """The model as it is drawn."""
        from palpate.pictures.stage import staged

        return self.model if self.spec is None else staged(self.spec, soft=soft)
