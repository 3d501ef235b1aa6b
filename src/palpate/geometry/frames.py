"""Poses of several shapes at several moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Poses of k shapes at n moments: positions (n, k, 3) and rotations (n, k, 3, 3)."""

    positions: Array
    rotations: Array

    @classmethod
    def joined(cls, parts: Sequence[Frames]) -> Frames:
        """Concatenate shapes of several carriers at the same moments."""
        return cls(
            np.concatenate([part.positions for part in parts], axis=1),
            np.concatenate([part.rotations for part in parts], axis=1),
        )

    @classmethod
    def stacked(cls, parts: Sequence[Frames]) -> Frames:
        """Concatenate moments of the same shapes."""
        return cls(
            np.concatenate([part.positions for part in parts]),
            np.concatenate([part.rotations for part in parts]),
        )

    def at(self, moment: int) -> Frames:
        """Select one moment."""
        return self.part(slice(moment, moment + 1))

    def part(self, moments: slice) -> Frames:
        """Select some moments."""
        return Frames(self.positions[moments], self.rotations[moments])
