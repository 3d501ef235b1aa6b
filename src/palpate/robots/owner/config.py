"""`robot.yaml`: what was measured of one very arm, or set on it; the form of `--robot-config`.

Version 1. SI units. Every key is optional; what is absent is what the noise model's datasheet, or
the arm's description, says. A figure that was measured has its standard deviation, and says when
and how.
"""

from __future__ import annotations

import datetime
import os
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    Field,
    PlainValidator,
    ValidationError,
    model_validator,
)

from palpate.errors import InputError
from palpate.files.plain_yaml import Section, plain_number, plain_yaml, worded, yaml_text
from palpate.files.read import read_text
from palpate.geometry.pose import Array
from palpate.robots.sheet import Name, Pair, ReflexSheet, Seven, Stiffness, Vector, Workspace

JOINTS = 7
MAX_BYTES = 100_000
"""Largest robot.yaml."""
ASKEW = 1e-9
"""Relative: what rounding leaves of a covariance's symmetry, and of its smallest eigenvalue."""

_Plain = BeforeValidator(plain_number)
Number = Annotated[float, _Plain, Field(allow_inf_nan=False)]
Size = Annotated[float, _Plain, Field(gt=0, allow_inf_nan=False)]
Deviation = Annotated[float, _Plain, Field(ge=0, allow_inf_nan=False)]


def _square(value: Any) -> Array:
    """A covariance of seven numbers."""
    wanted = f"give {JOINTS} lists of {JOINTS} numbers that are a covariance"
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(wanted) from None
    if array.shape != (JOINTS, JOINTS) or not np.isfinite(array).all():
        raise ValueError(wanted)
    small = ASKEW * float(np.abs(array).max())
    if not np.allclose(array, array.T, atol=small) or np.linalg.eigvalsh(array)[0] < -small:
        raise ValueError(wanted)
    array.flags.writeable = False
    return array


def _quaternion(value: Any) -> Array:
    """Four numbers, of some length."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != (4,) or not np.isfinite(array).all() or not array.any():
        raise ValueError("give a quaternion: w, x, y, z, not all of them 0")
    array.flags.writeable = False
    return array


class Figure(Section):
    """Something that was measured: when (`date`), and `by` what."""

    date: datetime.date | None = None
    by: Annotated[str, Field(max_length=300)] | None = None


class Value(Figure):
    """A number and its standard deviation."""

    value: Number
    std: Deviation


class Repeated(Figure):
    """Standard deviation of a repeatability."""

    value: Deviation


class Gains(Figure):
    """Relative errors of the joints' torque sensors: they show 1 + `value` times what they feel.

    Attributes:
        value: (7,).
        std: (7,), of joints that were measured one by one.
        covariance: (7, 7), of joints that were measured together; one of the two.
    """

    value: Seven
    std: Seven | None = None
    covariance: Annotated[np.ndarray, PlainValidator(_square)] | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Gains:
        if (self.std is None) == (self.covariance is None):
            raise ValueError("give 'std' or 'covariance', one of the two")
        if self.std is not None and (self.std < 0).any():
            raise ValueError("'std' must not be negative")
        if (self.value <= -1).any():
            raise ValueError("'value' is relative: 0.01 is one per cent")
        return self

    @property
    def spread(self) -> Array:
        """(7, 7) covariance."""
        if self.covariance is not None:
            return self.covariance
        assert self.std is not None
        return np.diag(self.std**2)


class Lean(Figure):
    """rad about the base's x and y axes, and standard deviations."""

    value: Pair
    std: Pair


class Gravity(Figure):
    """m/s^2, of the place where the arm stands."""

    value: Size


class EndEffector(Section):
    """End effector without a load, the fingers included: `mass` in kg, `centre` in m
    in the axes of the hand's body, from its origin, with the fingers half open."""

    mass: Size
    centre: Vector


class Camera(Section):
    """A camera that stands still: where it is in the axes of the arm's base, m and quaternion (w, x, y,
    z), looking along its own -z as in MJCF; its vertical field of view, degrees; pixels."""

    pos: Vector
    quat: Annotated[np.ndarray, PlainValidator(_quaternion)]
    fovy: Annotated[float, _Plain, Field(gt=1, lt=170)]
    size: tuple[Annotated[int, Field(gt=0, le=20000)], Annotated[int, Field(gt=0, le=20000)]]


class Simulated(Section):
    """Identity of the arm in the embedded world: another `noise` or `seed` is another arm. `visits`: how
    often it was calibrated; the next time what is drawn once a run is drawn anew."""

    noise: Annotated[str, Field(min_length=1, max_length=1000)]
    seed: Annotated[int, Field(ge=0)]
    visits: Annotated[int, Field(ge=0)] = 0


class RobotConfig(Section):
    """All that a robot.yaml says.

    Attributes:
        arm: its description's name.
        simulated: None for a real arm.
        gravity: where it stands.
        torque_gain: of the joints' sensors.
        tip_offset: m, from the TCP to the pads' end along the tool, with all that the arm's frame
            adds to a height where it was measured.
        base_lean: by how much the base leans more than the scene says, or seems to: it was measured
            with tip_offset, and both hold together.
        pose_repeatability: m, of each axis of the TCP, as heights show it.
        tip_compliance: m/N, of pads and joints beyond the encoders, under a force along the tool.
        end_effector: what hangs on the flange.
        stiffness: of the controller's springs.
        reflex: at what the arm stops itself.
        workspace: a box that the TCP stays in.
        speed: part of the description's pace.
        camera: the one that sees the workspace, where no poses.yaml has one.
    """

    palpate_robot: Literal[1] = 1
    name: Name | None = None
    arm: Name | None = None
    simulated: Simulated | None = None
    gravity: Gravity | None = None
    torque_gain: Gains | None = None
    tip_offset: Value | None = None
    base_lean: Lean | None = None
    pose_repeatability: Repeated | None = None
    tip_compliance: Value | None = None
    end_effector: EndEffector | None = None
    stiffness: Stiffness | None = None
    reflex: ReflexSheet | None = None
    workspace: Workspace | None = None
    speed: Annotated[float, _Plain, Field(gt=0, le=1)] | None = None
    camera: Camera | None = None

    # One and the same for the same file, as what is computed of it is kept.
    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other


def read_config(path: Path) -> RobotConfig:
    """Read a robot.yaml; return the same object as long as the file does not change.

    Raises:
        InputError: unreadable, or not of this form; the message names file and key.
    """
    version = path.stat().st_mtime_ns if path.is_file() else 0
    return _read(path, version)


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
        raise InputError(f"{path}: {worded(error, RobotConfig)}") from None


def write_config(path: Path, config: RobotConfig) -> None:
    """Write it whole, or not at all.

    Raises:
        InputError: it cannot be written.
    """
    text = yaml_text(_plain(config))
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


def _plain(section: BaseModel) -> dict[str, Any]:
    """Convert a section to plain values, arrays to lists, for YAML."""
    said: dict[str, Any] = {}
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, BaseModel):
            value = _plain(value)
        elif isinstance(value, np.ndarray):
            value = value.tolist()
        elif isinstance(value, tuple):
            value = list(cast("tuple[Any, ...]", value))
        if value is not None:
            said[name] = value
    return said
