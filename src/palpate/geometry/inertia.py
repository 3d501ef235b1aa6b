"""Inertia tensors as MJCF writes them: xx yy zz xy xz yz, kg m²."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.geometry.pose import Array, Pose


def rotation(quaternion: Array) -> Array:
    """(3, 3) matrix of a quaternion wxyz."""
    return Pose.of((0, 0, 0), quaternion).rotation


def tensor_of(parts: Sequence[float]) -> Array:
    """(3, 3) from xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = parts
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def components(tensor: Array) -> list[float]:
    """xx yy zz xy xz yz of a (3, 3) tensor."""
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    return tensor[rows, columns].tolist()
