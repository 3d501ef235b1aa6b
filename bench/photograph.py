"""One picture of a simulated camera, with the stated properties of the camera."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.perception.lens import Lens, Mount
from palpate.perception.rendered import SimulatedCamera


class Photograph(NamedTuple):
    """Picture (height, width, 3), RGB, and lens and pose of its camera as stated by its owner."""

    pixels: NDArray[np.uint8]
    lens: Lens
    mount: Mount


def take(world: mujoco.MjSpec, name: str, **options: Any) -> Photograph:
    """Take a picture by a `SimulatedCamera` with the same arguments."""
    camera = SimulatedCamera(world, name, **options)
    return Photograph(camera.shoot(), camera.lens, camera.mount)
