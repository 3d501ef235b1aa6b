"""Lens of a camera: pinhole with OpenCV's distortion, and its intrinsics file.

    {fx: 915.2, fy: 914.8, cx: 639.1, cy: 361.7, size: [1280, 720],   # pixels
     distortion: [k1, k2, p1, p2, k3], focal_std: 0.002,              # focal length's relative error
     pose: {pos: [...], quat: [...], covariance: [[...], ...]}}       # in the world, where it is known

A camera on the hand has `on_hand: true` in its `pose`, which is then in the TCP's frame. It may
state the `joints` of its pictures, rad, if these are not taken from home.

The calibration file of ROS's camera_calibration (`camera_matrix`, `distortion_coefficients`,
`image_width`, `image_height`) is supported too. Pixel coordinates are OpenCV's: the centre of the
first pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field, ValidationError, model_validator

from palpate.common.errors import InputError
from palpate.common.files import Section, describe_error, plain_yaml, read_text
from palpate.common.pose import Array, Pose
from palpate.scene.camera import Camera
from palpate.scene.poses import Covariance, Quaternion, Vector

MAX_BYTES = 100_000  # Maximum size of an intrinsics file, bytes
# Relative. Default standard deviation of a focal length: about the repeatability of a calibration
# with a board.
FOCAL_STD = 0.002
# Rotation between OpenCV's camera frame (z along the view, y down) and MuJoCo's (view along -z, y
# up).
FACING = Pose.of((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """Intrinsics of a camera."""

    matrix: Array  # (3, 3) pinhole matrix, pixels
    size: tuple[int, int]  # width and height, pixels
    # (5,) coefficients k1, k2, p1, p2, k3 of OpenCV.
    distortion: Array = field(default_factory=lambda: np.zeros(5))
    focal_std: float = FOCAL_STD  # relative standard deviation of the focal length

    @classmethod
    def of(cls, camera: Camera) -> Lens:
        """Lens of a MuJoCo pinhole camera."""
        # The principal point is the centre of the picture in OpenCV's pixel convention.
        middle = (camera.width - 1) / 2, (camera.height - 1) / 2
        return cls(pinhole(camera.focal, *middle), (camera.width, camera.height))

    def zoom_lens(self, zoom: float) -> Lens:
        """Return the lens with the focal length times `zoom`."""
        # The zoom scales both focal lengths and keeps the principal point.
        factors = np.array([[zoom, 1, 1], [1, zoom, 1], [1, 1, 1]])
        return replace(self, matrix=self.matrix * factors)

    def project(self, points: Array, zoom: float = 1.0) -> Array:
        """Project points (n, 3), m, in OpenCV's camera frame to pixels (n, 2).

        The focal length is multiplied by `zoom`. The distortion is the Brown-Conrady model of
        OpenCV.
        """
        # Normalised image coordinates.
        x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
        k1, k2, p1, p2, k3 = self.distortion
        # Radial distortion 1 + k1 r² + k2 r⁴ + k3 r⁶, then tangential distortion by p1 and p2.
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        # Pinhole projection to pixels.
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        return np.column_stack([zoom * fx * u + cx, zoom * fy * v + cy])


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Prior of a camera pose."""

    # In MuJoCo's camera frame; for a camera on the hand, in the TCP's frame.
    pose_world_camera: Pose
    # (6, 6) of position (m) and rotation (rad) along the axes of that frame. (7, 7) with the log
    # focal length, if the camera was calibrated with its lens.
    covariance: Array
    on_hand: bool = False  # the camera is on the hand
    # rad of each joint, configuration of the pictures of a camera on the hand; None for home.
    joints: Array | None = None

    def within(self, frame: Pose) -> Mount:
        """Transform the mount from a frame at this pose to its parent frame."""
        # Rotate position and rotation blocks of the covariance.
        turn = np.eye(len(self.covariance))
        turn[:3, :3] = turn[3:6, 3:6] = frame.rotation
        return Mount(frame @ self.pose_world_camera, turn @ self.covariance @ turn.T)


def pinhole(focal: float, cx: float, cy: float) -> Array:
    """Matrix (3, 3) of a pinhole with square pixels."""
    return np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])


_Pixels = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
_Side = Annotated[int, Field(gt=0, le=20_000)]
_Angle = Annotated[float, Field(ge=-10, le=10, allow_inf_nan=False)]
_Coefficient = Annotated[float, Field(ge=-100, le=100, allow_inf_nan=False)]


class _Mount(Section):
    pos: Vector
    quat: Quaternion
    covariance: Covariance
    on_hand: bool = False
    joints: Annotated[list[_Angle], Field(min_length=6, max_length=7)] | None = None

    @model_validator(mode="after")
    def _of_hand(self) -> _Mount:
        if self.joints is not None and not self.on_hand:
            raise ValueError("'joints' goes with on_hand: true")
        return self


class _Lens(Section):
    fx: _Pixels
    fy: _Pixels
    cx: Annotated[float, Field(ge=-1e6, le=1e6)]
    cy: Annotated[float, Field(ge=-1e6, le=1e6)]
    size: tuple[_Side, _Side]
    distortion: Annotated[list[_Coefficient], Field(max_length=5)] = Field(
        default_factory=list[float]
    )
    focal_std: Annotated[float, Field(gt=0, le=0.2)] = FOCAL_STD
    pose: _Mount | None = None
    model: Literal["plumb_bob"] = "plumb_bob"

    @model_validator(mode="before")
    @classmethod
    def _of_ros(cls, content: Any) -> Any:
        """Translate a file of ROS's camera_calibration."""
        if not isinstance(content, dict) or "camera_matrix" not in content:
            return cast("Any", content)
        content = cast("dict[str, Any]", content)
        try:
            # The matrix is stored as nine numbers, row by row.
            fx, _, cx, _, fy, cy, *_ = content["camera_matrix"]["data"]
            return {
                "fx": fx,
                "fy": fy,
                "cx": cx,
                "cy": cy,
                "size": (content["image_width"], content["image_height"]),
                "distortion": content["distortion_coefficients"]["data"],
                "model": content.get("distortion_model", "plumb_bob"),
            }
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"is no file of ROS's camera_calibration: {error!r}") from None


def read_lens(path: Path) -> tuple[Lens, Mount | None]:
    """Read a lens and, if stated, the pose of its camera.

    Raises InputError: the file is unreadable or not of this form.
    """
    content = plain_yaml(read_text(path, MAX_BYTES, "a camera's intrinsics"), str(path))
    try:
        read = _Lens.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {describe_error(error, _Lens)}") from None
    # Missing distortion coefficients are zero.
    matrix = np.array([[read.fx, 0.0, read.cx], [0.0, read.fy, read.cy], [0.0, 0.0, 1.0]])
    distortion = np.array([*read.distortion, *[0.0] * (5 - len(read.distortion))])
    lens = Lens(matrix, read.size, distortion, read.focal_std)
    # The pose of the camera is optional.
    stands = read.pose
    if stands is None:
        return lens, None
    joints = None if stands.joints is None else np.array(stands.joints)
    pose, covariance = Pose.of(stands.pos, stands.quat), np.array(stands.covariance)
    return lens, Mount(pose, covariance, stands.on_hand, joints)
