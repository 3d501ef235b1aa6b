"""Shapes that move together, and where they are at several moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A colliding shape: its id in the model, and its pose in the frame of what it belongs to."""

    geom: int
    position: Array
    rotation: Array


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Shapes that move as one: positions (k, 3) and rotations (k, 3, 3) in their carrier's frame."""

    positions: Array
    rotations: Array

    @classmethod
    def of(cls, shapes: Sequence[Shape]) -> Cluster:
        """These shapes, which have one carrier."""
        return cls(
            np.array([shape.position for shape in shapes]).reshape(-1, 3),
            np.array([shape.rotation for shape in shapes]).reshape(-1, 3, 3),
        )

    def at(self, positions: Array, rotations: Array) -> Frames:
        """With the carrier at `positions` (n, 3) and `rotations` (n, 3, 3)."""
        return Frames(
            positions[:, None] + np.einsum("nij,kj->nki", rotations, self.positions),
            np.einsum("nij,kjl->nkil", rotations, self.rotations),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Poses of shapes at n moments: positions (n, k, 3) and rotations (n, k, 3, 3)."""

    positions: Array
    rotations: Array

    @classmethod
    def joined(cls, parts: Sequence[Frames]) -> Frames:
        """Shapes of several carriers, at the same moments."""
        return cls(
            np.concatenate([part.positions for part in parts], axis=1),
            np.concatenate([part.rotations for part in parts], axis=1),
        )

    def repeated(self, moments: int) -> Frames:
        """The one moment as often as that."""
        return Frames(
            np.repeat(self.positions, moments, axis=0), np.repeat(self.rotations, moments, axis=0)
        )

    def at(self, moment: int) -> Frames:
        """Poses at a single moment."""
        one = slice(moment, moment + 1)
        return Frames(self.positions[one], self.rotations[one])
