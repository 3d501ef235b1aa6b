"""`robot.yaml`: measured figures and settings of an individual arm; the format of `--robot-config`.

Version 1. Units are SI. Every key is optional. An absent key means the figure of the noise model's
datasheet, or of the arm's description. A measured figure has its standard deviation, date and method.
"""

from __future__ import annotations

import datetime
import os
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator, ValidationError, model_validator

from palpate.common.errors import InputError
from palpate.common.files import (
    Section,
    describe_error,
    plain_number,
    plain_yaml,
    read_text,
    yaml_text,
)
from palpate.common.pose import Array
from palpate.robots.sheet import (
    AS_LIST,
    ControllerStiffness,
    Name,
    OwnReflex,
    Pair,
    Vector,
    Workspace,
    finite_array,
    joint_numbers,
)

MAX_BYTES = 100_000  # largest robot.yaml
ASKEW = 1e-9  # relative rounding error of a covariance's symmetry, and of its smallest eigenvalue

_Plain = BeforeValidator(plain_number)
Number = Annotated[float, _Plain, Field(allow_inf_nan=False)]
Size = Annotated[float, _Plain, Field(gt=0, allow_inf_nan=False)]
Deviation = Annotated[float, _Plain, Field(ge=0, allow_inf_nan=False)]


def require_covariance(value: Any) -> Array:
    """Validate a covariance (n, n) of n joints."""
    message = "give 7 lists of 7 numbers, or 6 lists of 6, that are a covariance"
    count = 6 if isinstance(value, list | np.ndarray) and len(cast("list[Any]", value)) == 6 else 7
    array = finite_array(value, (count, count), message)
    small = ASKEW * float(np.abs(array).max())
    if not np.allclose(array, array.T, atol=small) or np.linalg.eigvalsh(array)[0] < -small:
        raise ValueError(message)
    return array


def require_gains(value: Any) -> Array:
    """Validate one number a joint."""
    array = joint_numbers(value)
    if len(array) not in (6, 7):
        raise ValueError("give a list of 7 numbers, or of 6, one a joint")
    return array


def require_quaternion(value: Any) -> Array:
    """Validate a quaternion (4,) of any length but 0."""
    message = "give a quaternion: w, x, y, z, not all of them 0"
    array = finite_array(value, (4,), message)
    if not array.any():
        raise ValueError(message)
    return array


Gains = Annotated[np.ndarray, PlainValidator(require_gains), AS_LIST]
JointCovariance = Annotated[np.ndarray, PlainValidator(require_covariance), AS_LIST]


class MeasuredFigure(Section):
    """A measured figure."""

    date: datetime.date | None = None  # of the measurement
    by: Annotated[str, Field(max_length=300)] | None = None  # its method


class Value(MeasuredFigure):
    """A number and its standard deviation."""

    value: Number  # enters estimates
    std: Deviation  # enters their intervals


class Repeated(MeasuredFigure):
    """Standard deviation of a repeatability."""

    value: Deviation  # 1 sigma


class SensorGains(MeasuredFigure):
    """Relative errors of the joints' torque sensors.

    They are corrected where the sensors are read, so every force is right, including those of the safety
    predicate. The remaining error replaces the datasheet's in the intervals.
    """

    value: Gains  # a reading is 1 + `value` times the torque
    std: Gains | None = None  # of joints measured separately
    # instead of `std`, of joints measured together, which is more informative: a list a joint, of a number a joint
    covariance: JointCovariance | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> SensorGains:
        if (self.std is None) == (self.covariance is None):
            raise ValueError("give 'std' or 'covariance', one of the two")
        if self.std is not None and (self.std < 0).any():
            raise ValueError("'std' must not be negative")
        if len(self.spread) != len(self.value):
            raise ValueError("give as many numbers in 'value' as in 'std' or 'covariance'")
        if (self.value <= -1).any():
            raise ValueError("'value' is relative: 0.01 is one per cent")
        return self

    @property
    def spread(self) -> Array:
        """Covariance (n, n) of the relative errors of n joints."""
        if self.covariance is not None:
            return self.covariance
        assert self.std is not None
        return np.diag(self.std**2)


class Lean(MeasuredFigure):
    """Tilt of the base, real or apparent, against the scene's.

    It turns every pose that the arm reports. It is measured together with `tip_offset`, and valid with it.
    """

    value: Pair  # rad, about the base's x and y axes
    std: Pair  # rad


class Gravity(MeasuredFigure):
    """Gravity at the arm's place, the divisor of weights."""

    value: Size  # m/s^2


class EndEffector(Section):
    """End effector without a load, including the fingers."""

    mass: Size  # kg
    centre: Vector  # m, in the frame of the hand's body, with the fingers half open


class CameraConfig(MeasuredFigure):
    """The camera of the workspace, for a poses.yaml without one.

    Its pose is in the frame of the arm's base, or of the TCP where it is on the hand. It looks along its own
    -z, as in MJCF.
    """

    pos: Vector  # m
    quat: Annotated[np.ndarray, PlainValidator(require_quaternion), AS_LIST]  # w, x, y, z
    fovy: Annotated[float, _Plain, Field(gt=1, lt=170)]  # vertical field of view, degrees
    # width and height, pixels
    size: tuple[Annotated[int, Field(gt=0, le=20000)], Annotated[int, Field(gt=0, le=20000)]]
    on_hand: bool = False  # its pose is in the frame of the TCP
    # (7, 7) of position, m, rotation, rad, along the axes of that frame, and the logarithm of the focal
    # length; with it `palpate see` takes the camera's pose from here
    covariance: JointCovariance | None = None


class Simulated(Section):
    """Identity of an embedded arm: another `noise` or `seed` is another arm. Absent for a real arm."""

    noise: Annotated[str, Field(min_length=1, max_length=1000)]  # its noise model
    seed: Annotated[int, Field(ge=0)]  # its seed
    visits: Annotated[int, Field(ge=0)] = 0  # calibrations: each is a run with other errors


class RobotConfig(Section):
    """The content of a robot.yaml."""

    palpate_robot: Literal[1] = 1  # version of the form
    name: Name | None = None  # title of the arm
    arm: Name | None = None  # name of its description: with another arm the file is refused
    simulated: Simulated | None = None
    gravity: Gravity | None = None
    torque_gain: SensorGains | None = None
    # m, from the TCP to the pads' end along the tool; includes the error of the arm's frame in a height at
    # the place of measurement
    tip_offset: Value | None = None
    base_lean: Lean | None = None
    pose_repeatability: Repeated | None = None  # m, of each axis of the TCP, measured along gravity
    # m/N, of pads and joints beyond the encoders, along the tool
    tip_compliance: Value | None = None
    end_effector: EndEffector | None = None
    stiffness: ControllerStiffness | None = None
    reflex: OwnReflex | None = None
    workspace: Workspace | None = None
    speed: Annotated[float, _Plain, Field(gt=0, le=1)] | None = None  # share of the pace
    camera: CameraConfig | None = None

    # Compared by identity: results computed from it are cached, and a file is one object.
    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other


def read_config(path: Path) -> RobotConfig:
    """Read a robot.yaml; an unchanged file is the same object.

    Raises InputError: unreadable, or not of this form; the message names file and key.
    """
    return _read(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(32)
def _read(path: Path, version: int) -> RobotConfig:
    content: Any = plain_yaml(read_text(path, MAX_BYTES, "a robot.yaml"), str(path))
    if not isinstance(content, dict):
        raise InputError(
            f"{path}: give the keys of a robot.yaml, e.g. 'gravity: {{value: 9.8123}}'"
        )
    try:
        return RobotConfig.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {describe_error(error, RobotConfig)}") from None


def write_config(path: Path, config: RobotConfig) -> None:
    """Write a robot.yaml atomically."""
    text = yaml_text(config.model_dump(exclude_none=True))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            os.chmod(part, 0o644)
            os.replace(part, path)
        except BaseException:
            os.unlink(part)
            raise
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error
