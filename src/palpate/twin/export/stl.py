"""Binary STL: 80 bytes, the number of triangles, and of each its normal, its corners (single
precision) and two bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.geometry.pose import Array

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])


def write_stl(path: Path, corners: Array) -> None:
    """Write triangles: `corners` (n, 3, 3) in m, each corner a row."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = np.zeros(len(corners), _TRIANGLE)
    triangles["corners"] = corners
    triangles["normal"] = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    path.write_bytes(bytes(80) + np.uint32(len(corners)).tobytes() + triangles.tobytes())
