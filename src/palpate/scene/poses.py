"""`poses.yaml`: poses from a pose estimator or a person. Angles in rad, lengths in m.

objects: {bottle: {pos: [0.5, 0.1, 0.8], yaw: 0.3}}       # pose of the body frame in the world
         {box: {pos: [0.4, 0, 0.8], source: picture, std: 0.003}}  # from a picture: pose and size ± 3 mm
         {tin: {pos: [0.5, 0, 0.8], source: seen, covariance: [[...], ...]}}  # by a camera (palpate see)
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

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from palpate.common.errors import InputError, unknown_name
from palpate.common.files import plain_yaml, read_text
from palpate.common.pose import Pose
from palpate.robots.description import RobotDescription

MAX_BYTES = 200_000  # Largest size of a poses file
Number = Annotated[float, Field(allow_inf_nan=False, ge=-100.0, le=100.0)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
Name = Annotated[str, Field(min_length=1, max_length=100)]
_Row = tuple[Number, Number, Number, Number, Number, Number]
# Covariance of position, m, and small rotation, rad, along the world's axes.
Covariance = Annotated[
    tuple[_Row, _Row, _Row, _Row, _Row, _Row],
    AfterValidator(lambda rows: _require_covariance(rows)),
]


# Pattern of steps in pydantic's error location that name a type instead of a key.
_FORM = re.compile(r"constrained-|\[")


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class PoseEntry(_Strict):
    """A pose: position, and at most one of yaw (rad about world z), euler (rad, fixed x-y-z) and
    quat (wxyz)."""

    pos: Vector
    """Position, m."""
    yaw: Number | None = None
    """Turn about world z, rad."""
    euler: Vector | None = None
    """Turns about the fixed axes x, y and z, in this order, rad."""
    quat: Quaternion | None = None
    """Quaternion w, x, y, z."""

    @model_validator(mode="after")
    def _one_orientation(self) -> PoseEntry:
        # At most one form of the orientation, and a quaternion that can be normalised.
        if (self.yaw, self.euler, self.quat).count(None) < 2:
            raise ValueError("has more than one of yaw, euler and quat")
        if self.quat is not None and sum(v * v for v in self.quat) < 1e-9:
            raise ValueError("has a quat of zeros")
        return self

    def body_pose(self) -> Pose:
        """Pose of a body; upright without an orientation."""
        # A quaternion is complete; yaw is a rotation about z, euler about fixed axes.
        if self.quat is not None:
            return Pose.of(self.pos, self.quat)
        angles = (0.0, 0.0, self.yaw) if self.euler is None and self.yaw is not None else self.euler
        return Pose.of(self.pos, (1.0, 0.0, 0.0, 0.0) if angles is None else _from_euler(angles))

    def tool_pose(self) -> Pose:
        """Pose of the TCP: top-down, turned by yaw, unless euler or quat is given."""
        if self.quat is None and self.euler is None:
            return Pose.top_down(self.pos, self.yaw or 0.0)
        return self.body_pose()


class ObjectEntry(PoseEntry):
    """Pose of an object or a surface, and where it comes from."""

    source: Literal["picture", "stated", "seen"] = "stated"
    """`picture`: pose and size are from a picture and uncertain; contacts of the fingers correct the size.
    `seen`: a camera measured the pose, and the size is the scene's."""
    std: Annotated[float, Field(gt=0.0, le=0.1)] | None = None
    """Standard deviation of its position and size, m; stating it marks them as uncertain."""
    covariance: Covariance | None = None
    """Covariance of its pose, 6 lists of 6 numbers: position, m, and rotation, rad, along the world's axes."""

    @model_validator(mode="after")
    def _one_accuracy(self) -> ObjectEntry:
        if self.std is not None and self.covariance is not None:
            raise ValueError("has both std and covariance")
        return self

    @property
    def is_unsure(self) -> bool:
        """True if its size is uncertain, and contacts may correct it."""
        return self.source == "picture" or self.std is not None

    @property
    def accuracy(self) -> float | None:
        """Largest standard deviation of its horizontal position, m, by the covariance of x and y; else None."""
        if self.covariance is None:
            return self.std
        # Larger eigenvalue: (xx + yy) / 2 + sqrt(((xx - yy) / 2)² + xy²).
        (xx, xy, *_), (_, yy, *_), *_ = self.covariance
        return math.sqrt((xx + yy) / 2 + math.hypot((xx - yy) / 2, xy))


class CameraEntry(_Strict):
    """A pinhole camera looking along its own -z, as in MuJoCo."""

    pos: Vector
    """Position in the world, m."""
    quat: Quaternion
    """Orientation in the world: quaternion w, x, y, z."""
    fovy: Annotated[float, Field(gt=1, lt=170)]
    """Vertical field of view, degrees, as in MJCF."""
    size: tuple[Annotated[int, Field(gt=0, le=20000)], Annotated[int, Field(gt=0, le=20000)]]
    """Width and height, pixels."""


Offset = Number | Vector


class Poses(_Strict):
    """The content of a `poses.yaml`."""

    objects: dict[Name, ObjectEntry] = {}
    """Poses of the objects' frames in the world; they overrule the MJCF."""
    places: dict[Name, PoseEntry] = {}
    """Poses of the TCP, by names that plans may use; it points down unless euler or quat is given."""
    joints: dict[Name, Annotated[tuple[Number, ...], Field(min_length=6, max_length=7)]] = {}
    """Joint configurations, rad; `home_config` is where plans begin."""
    offsets: dict[Name, Offset | dict[Name, Offset]] = {}
    """Offsets of plans, m: along the axis an offset is named after, or [x, y, z] along the grasp's
    axes; for every object, or by object."""
    grasps: dict[Name, PoseEntry] = {}
    """Poses of the TCP in the object's frame."""
    camera: CameraEntry | None = None
    """The camera that took the picture."""
    accuracy: Annotated[float, Field(gt=0.0, le=0.1)] | None = None
    """Standard deviation of the objects' positions, m; without it, the accuracy of measured poses applies."""


def read_poses(path: Path) -> Poses:
    """Read and validate a poses file; an `InputError` states the entry and its form."""
    return parse_poses(read_text(path, MAX_BYTES, "poses"), str(path))


def add_arm_camera(poses: Poses, arm: RobotDescription, pose_world_base: Pose) -> Poses:
    """The poses, with the camera of the arm's robot.yaml if they have none."""
    # A camera on the hand moves, so its pose is not one of the scene.
    camera = arm.config.camera if arm.config is not None else None
    if poses.camera is not None or camera is None or camera.on_hand:
        return poses
    # The camera's pose in robot.yaml is relative to the arm.
    stands = arm.stands(pose_world_base) @ Pose.of(camera.pos, camera.quat)
    pos, quat = tuple(stands.position.tolist()), tuple(stands.quaternion.tolist())
    entry = {"pos": pos, "quat": quat, "fovy": camera.fovy, "size": camera.size}
    return poses.model_copy(update={"camera": CameraEntry.model_validate(entry)})


def parse_poses(text: str, where: str = "poses") -> Poses:
    """Parse poses from text, as `read_poses`."""
    # An empty file is valid: every section is optional.
    content: Any = plain_yaml(text, where)
    try:
        return Poses.model_validate(content or {})
    except ValidationError as error:
        raise InputError(f"{where}: {_complaint(error)}") from None


_POSE = (
    "a pose: pos: [x, y, z] in m, and at most one of yaw (rad), euler (rad) and quat (w, x, y, z)"
)
# Form of the entries below each key.
_FORMS = {
    "objects": f"{_POSE}; source: picture, stated or seen; std in m if it is uncertain, or the pose's covariance",
    "places": _POSE,
    "grasps": _POSE,
    "joints": "one angle a joint in rad",
    "offsets": "a length in m, [x, y, z] in m, or a mapping of such offsets for one object",
    "camera": "a camera: pos: [x, y, z] in m, quat: [w, x, y, z], fovy in degrees, and size: [width, height] in pixels",
    "accuracy": "a length in m, more than 0 and at most 0.1",
}
_SINGLE = ("camera", "accuracy")  # Keys with a single value


def _complaint(invalid: ValidationError) -> str:
    """Message with the error, its keys, and the expected form."""
    errors = invalid.errors()
    # An unknown key is the most likely error if several types of an entry were tried.
    unknown = [error for error in errors if error["type"] == "extra_forbidden"]
    first = (unknown or errors)[0]
    # Steps of an entry with several possible types may name a type instead of a key.
    steps = [str(step) for step in first["loc"] if not _FORM.search(str(step))]
    if not steps:
        return f"needs keys: {', '.join(_FORMS)}"
    # A wrong key at the top gets the closest valid one as a suggestion.
    if steps[0] not in _FORMS:
        return str(unknown_name("key", steps[0], _FORMS))
    # The kind of error as a predicate, then the expected form of the entry.
    complaint = {
        "extra_forbidden": "is not a key",
        "missing": "is missing",
        "dict_type": "has no keys below it",
        "model_type": "has no keys below it",
    }.get(first["type"])
    if complaint is None:
        message = first["msg"].removeprefix("Value error, ").replace("Input should", "should")
        complaint = message.partition(", unable")[0]
    entry = f"'{steps[0]}'" if steps[0] in _SINGLE else f"an entry of '{steps[0]}'"
    return f"{'.'.join(steps)} {complaint}; {entry} is {_FORMS[steps[0]]}"


def _require_covariance(rows: tuple[_Row, ...]) -> tuple[_Row, ...]:
    import numpy as np

    # A covariance is symmetric and positive semidefinite, up to rounding.
    array = np.array(rows)
    rounding = 1e-6 * float(np.abs(array).max())
    if not np.allclose(array, array.T, atol=rounding) or np.linalg.eigvalsh(array)[0] < -rounding:
        raise ValueError("is not a covariance")
    return rows


def _from_euler(angles: Vector) -> Quaternion:
    import mujoco
    import numpy as np

    # MuJoCo's upper-case sequence is about fixed axes.
    quaternion = np.empty(4)
    mujoco.mju_euler2Quat(quaternion, np.array(angles), "XYZ")
    w, x, y, z = quaternion.tolist()
    return w, x, y, z
