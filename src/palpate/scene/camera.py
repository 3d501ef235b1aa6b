"""Images of the workspace, and the pinhole camera that takes them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError
from palpate.common.files import read_bytes
from palpate.common.pose import Array, Pose
from palpate.scene.poses import CameraEntry

MAX_BYTES = 100_000_000  # Largest size of a picture file
MAX_PIXELS = 64_000_000  # Most pixels of a picture
MAX_SIDE = 1024  # Pixels, longest side after loading; larger pictures are downscaled


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes:
        pose_world_camera: pose in MuJoCo's convention: view along -z, x to the right of the image,
            y up.
        fovy: vertical field of view, rad.
        width, height: pixels.
    """

    pose_world_camera: Pose
    fovy: float
    width: int
    height: int

    @classmethod
    def of(cls, entry: CameraEntry) -> Camera:
        """From an entry of `poses.yaml`."""
        return cls(Pose.of(entry.pos, entry.quat), float(np.deg2rad(entry.fovy)), *entry.size)

    @property
    def focal(self) -> float:
        """Focal length, pixels (square pixels, centre of the image on the axis)."""
        return self.height / 2 / float(np.tan(self.fovy / 2))

    def ray(self, u: float, v: float) -> Array:
        """(3,) unit vector in the world through a pixel (u right, v down)."""
        # Inverse of the pinhole projection, with the image centre on the optical axis.
        local = np.array([u - self.width / 2, self.height / 2 - v, -self.focal])
        return self.pose_world_camera.rotation @ (local / np.linalg.norm(local))

    def on_plane(self, u: float, v: float, z: float) -> Array | None:
        """(3,) intersection of the ray through a pixel with the level plane at world `z`, or None."""
        ray, eye = self.ray(u, v), self.pose_world_camera.position
        if abs(ray[2]) <= 1e-9:
            return None
        # eye + s ray with z component z; s > 0 in front of the camera.
        distance = (z - eye[2]) / ray[2]
        if distance > 0:
            return eye + distance * ray
        return None

    def project(self, point: Array) -> tuple[float, float] | None:
        """Pixel (u, v) of a point (3,) in the world; None behind the camera."""
        # u = w / 2 - f x / z and v = h / 2 + f y / z, as the view is along -z.
        x, y, z = self.pose_world_camera.local(point)
        if z >= 0:
            return None
        return self.width / 2 - self.focal * x / z, self.height / 2 + self.focal * y / z


def load_image(path: Path, max_side: int = MAX_SIDE) -> NDArray[np.uint8]:
    """Load a PNG or JPEG as RGB pixels (height, width, 3), the longer side at most `max_side`.

    Raises InputError: not readable, not PNG or JPEG, or too large.
    """
    from PIL import Image  # most scenes have no picture

    bombs = (Image.DecompressionBombError, Image.DecompressionBombWarning)
    content = read_bytes(path, MAX_BYTES, "a picture of the workspace")
    # A small file may unpack to a large picture. Pillow warns before it unpacks.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(BytesIO(content), formats=("PNG", "JPEG")) as file:
                if file.width * file.height > MAX_PIXELS:
                    raise InputError(
                        f"the image {path} has {file.width} × {file.height} pixels; at most "
                        f"{MAX_PIXELS // 1_000_000} million are read"
                    )
                file.thumbnail((max_side, max_side))
                return np.asarray(file.convert("RGB"), dtype=np.uint8)
    except (OSError, ValueError, SyntaxError, *bombs) as error:
        raise InputError(
            f"cannot read the image {path}: {error}; give a PNG or JPEG file"
        ) from None
