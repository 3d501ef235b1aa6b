"""`poses.yaml`: what a pose estimator, or a person, says about where things are. Angles in rad,
lengths in m.

objects: {bottle: {pos: [0.5, 0.1, 0.8], yaw: 0.3}}       # pose of the body frame in the world
places: {shelf_approach: {pos: [0.4, 0.2, 0.6]}}          # pose of the TCP; top-down unless quat is
    given
joints: {home_config: [0, -0.785, 0, -2.356, 0, 1.571, 0.785]}
offsets: {z_offset: 0.12, hammer: {x_offset: 0.04}}        # metres, or [x, y, z] along the grasp's
    axes
grasps: {hammer: {pos: [0.02, 0, 0.01], yaw: 0}}           # pose of the TCP in the object's frame
accuracy: 0.002                                            # m, 1 sigma, of the objects' poses
camera: {pos: [...], quat: [...], fovy: 45, size: [640, 480]}
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from palpate.errors import InputError
from palpate.files.plain_yaml import plain_yaml
from palpate.files.read import read_text
from palpate.geometry.pose import Pose

MAX_BYTES = 200_000
"""Largest poses file."""

Number = Annotated[float, Field(allow_inf_nan=False, ge=-100.0, le=100.0)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
Name = Annotated[str, Field(min_length=1, max_length=100)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class PoseEntry(_Strict):
    """A pose: position, and at most one of yaw (rad about world z), euler (rad, fixed x-y-z) and
    quat (wxyz)."""

    pos: Vector
    yaw: Number | None = None
    euler: Vector | None = None
    quat: Quaternion | None = None

    @model_validator(mode="after")
    def _one_orientation(self) -> PoseEntry:
        if (self.yaw, self.euler, self.quat).count(None) < 2:
            raise ValueError("give one of yaw, euler, quat")
        if self.quat is not None and sum(v * v for v in self.quat) < 1e-9:
            raise ValueError("quat is all zero")
        return self

    def body_pose(self) -> Pose:
        """As the pose of a body: upright unless turned."""
        return Pose.of(self.pos, self._quaternion() or (1.0, 0.0, 0.0, 0.0))

    def tool_pose(self) -> Pose:
        """As the pose of the TCP: top-down, turned by yaw, unless euler or quat says otherwise."""
        if self.quat is None and self.euler is None:
            return Pose.top_down(self.pos, self.yaw or 0.0)
        return self.body_pose()

    def _quaternion(self) -> Quaternion | None:
        if self.quat is not None:
            return self.quat
        if self.euler is not None:
            return _from_euler(self.euler)
        if self.yaw is not None:
            return _from_euler((0.0, 0.0, self.yaw))
        return None


class CameraEntry(_Strict):
    """A pinhole camera looking along its own -z, as in MuJoCo."""

    pos: Vector
    quat: Quaternion
    fovy: Annotated[float, Field(gt=1, lt=170)]
    """Vertical field of view, degrees, as in MJCF."""
    size: tuple[Annotated[int, Field(gt=0, le=20000)], Annotated[int, Field(gt=0, le=20000)]]
    """Width and height, pixels."""


Offset = Number | Vector


class Poses(_Strict):
    """The content of a `poses.yaml`."""

    objects: dict[Name, PoseEntry] = {}
    places: dict[Name, PoseEntry] = {}
    joints: dict[Name, tuple[Number, Number, Number, Number, Number, Number, Number]] = {}
    offsets: dict[Name, Offset | dict[Name, Offset]] = {}
    grasps: dict[Name, PoseEntry] = {}
    camera: CameraEntry | None = None
    accuracy: Annotated[float, Field(gt=0.0, le=0.1)] | None = None
    """m (1 sigma), how far an object may be from where it is said to stand; what poses that were
    measured are known to, where it is left out."""


def read_poses(path: Path) -> Poses:
    """Read and validate a poses file.

    Raises:
        InputError: unreadable, too large, not YAML, or not of this form.
    """
    text = read_text(path, MAX_BYTES, "poses")
    return parse_poses(text, str(path))


def parse_poses(text: str, where: str = "poses") -> Poses:
    """As `read_poses`, from text.

    Raises:
        InputError: not YAML, or not of this form.
    """
    content: Any = plain_yaml(text, where)
    try:
        return Poses.model_validate(content or {})
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "content"
        raise InputError(f"{where}: {place}: {first['msg']}") from None


def _from_euler(angles: Vector) -> Quaternion:
    import mujoco
    import numpy as np

    quaternion = np.empty(4)
    mujoco.mju_euler2Quat(quaternion, np.array(angles), "XYZ")
    w, x, y, z = quaternion.tolist()
    return w, x, y, z
