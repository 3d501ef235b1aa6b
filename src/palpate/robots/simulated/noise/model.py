"""Noise model: deviations of a real arm from its nominal model. The format of `--noise FILE.yaml`, version 1.

Every key is optional. An absent key means no error; in `datasheet` it means the figure of the arm's
description. Units are SI. A scalar applies to all joints, or to all axes. A size is one standard
deviation of a centred normal distribution. It is a half width of a uniform distribution if its key ends in
`_max`, and a plain value if it is a level. A drawn size may be written `{fixed: value}`: the value is then
the same for every seed. The comment of a key has when it is drawn, its unit and its effect; the documentation's table
of keys is made from these comments.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    ValidationInfo,
    model_validator,
)

from palpate.common.files import Section, plain_number
from palpate.common.pose import Array
from palpate.robots.owner import Datasheet

JOINTS = 7  # of an arm whose model is read without a context; see `with_joints`
Law = Literal["normal", "uniform", "magnitude", "sign"]
Shape = tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DrawnValue:
    """A value that is drawn, or fixed."""

    law: Law
    # Standard deviation of a centred normal distribution (`normal`; `magnitude` takes the absolute value),
    # half the width of a uniform one (`uniform`), or the size of a random sign (`sign`).
    size: Array
    fixed: Array | None = None  # the value itself, with its sign, instead of a draw

    @property
    def any(self) -> bool:
        """Test if it can be non-zero."""
        return bool(np.any(self.size if self.fixed is None else self.fixed))

    def draw(self, random: np.random.Generator) -> Array:
        """Draw a value, in the shape of its size."""
        # A uniform draw within plus and minus the size, or a normal one by the law.
        if self.fixed is not None:
            return self.fixed.copy()
        if self.law == "uniform":
            return self.size * random.uniform(-1.0, 1.0, self.size.shape)
        drawn = random.standard_normal(self.size.shape)
        if self.law == "magnitude":
            drawn = np.abs(drawn)
        elif self.law == "sign":
            drawn = np.sign(drawn)
        return self.size * drawn

    def number(self, random: np.random.Generator) -> float:
        """Draw a scalar value."""
        return float(self.draw(random)[()])


class Streams:
    """Random number streams, one per key of a noise model (`torque.white`), independent of each other.

    A change of one key changes no other stream. `seed` is that of the robot, `visit` the number of its run.
    """

    def __init__(self, seed: int, visit: int = 0) -> None:
        self._seed, self._visit = seed, visit

    def __call__(self, key: str, *visit: int) -> np.random.Generator:
        """Return the stream of a property of the robot, the same in all its runs."""
        sequence = np.random.SeedSequence(self._seed, spawn_key=(*key.encode(), *visit))
        return np.random.default_rng(sequence)

    def run(self, key: str) -> np.random.Generator:
        """Return the stream of a value that differs from run to run."""
        # 255 is the largest byte of a key, so that no key and visit equal another key.
        return self(key, 255 + self._visit) if self._visit else self(key)


def array_of(value: Any, shape: Shape, message: str) -> Array:
    """Read numbers, including infinite ones, in `shape`, from a scalar, one number per joint, or all of them.

    Raises ValueError: `message`.
    """
    try:
        require_numbers(value)
        array = np.array(value, dtype=float)
        if array.shape == shape[:1] and len(shape) == 2:
            array = array[:, None]
        elif array.shape not in ((), shape):
            raise ValueError
        array = np.broadcast_to(array, shape).copy()
        if np.isnan(array).any():
            raise ValueError
    except (TypeError, ValueError):
        raise ValueError(message) from None
    array.flags.writeable = False
    return array


def require_numbers(value: Any) -> None:
    """Reject booleans, which Python accepts as numbers, and any other value that is no number."""
    if isinstance(value, list):
        for inner in cast("list[Any]", value):
            require_numbers(inner)
    elif isinstance(value, bool) or not isinstance(value, int | float | str | np.ndarray):
        raise ValueError


def form_of(shape: Shape) -> str:
    """Describe the values that a key of this shape takes."""
    if not shape:
        return "give a number"
    if len(shape) == 1:
        return f"give a number or a list of {shape[0]} numbers"
    return f"give a number, a list of {shape[0]} numbers, or {shape[0]} lists of {shape[1]}"


def with_joints(shape: Shape, info: ValidationInfo) -> Shape:
    """Return the shape for the arm's number of joints, which the context `joints` of a validation states."""
    count = JOINTS if info.context is None else int(info.context["joints"])
    return tuple(count if size == JOINTS else size for size in shape)


def sizes(shape: Shape, infinite: bool = False) -> Callable[[Any, ValidationInfo], Array]:
    """Make a validator of sizes: numbers that are not negative."""

    def read(value: Any, info: ValidationInfo) -> Array:
        own = with_joints(shape, info)
        array = array_of(value, own, form_of(own))
        if (array < 0).any():
            raise ValueError("must not be negative")
        if not infinite and np.isinf(array).any():
            raise ValueError("must be finite")
        return array

    return read


def positive(value: Any, info: ValidationInfo) -> Array:
    """Validate one positive number a joint; it may be infinite."""
    array = sizes((JOINTS,), infinite=True)(value, info)
    if (array == 0).any():
        raise ValueError("must be positive")
    return array


def drawn(shape: Shape, law: Law = "normal") -> Callable[[Any, ValidationInfo], DrawnValue]:
    """Make a validator of a size, or `{fixed: value}`."""
    size = sizes(shape)

    def read(value: Any, info: ValidationInfo) -> DrawnValue:
        if isinstance(value, DrawnValue):
            return value
        if not isinstance(value, dict):
            return DrawnValue(law, size(value, info))
        said = cast("dict[str, Any]", value)
        own = with_joints(shape, info)
        if set(said) != {"fixed"}:
            raise ValueError(f"{form_of(own)}, or {{fixed: VALUE}}")
        fixed = array_of(said["fixed"], own, f"fixed: {form_of(own)}")
        if np.isinf(fixed).any():
            raise ValueError("fixed: must be finite")
        if law == "magnitude" and (fixed < 0).any():
            raise ValueError("fixed: must not be negative")
        return DrawnValue(law, size(0.0, info), fixed)

    return read


def nothing(shape: Shape = (), law: Law = "normal") -> DrawnValue:
    """Return a drawn value that is always zero."""
    return DrawnValue(law, np.zeros(shape))


EACH_JOINT = (JOINTS,)
AXES = (3,)
NONE = np.zeros(JOINTS)  # level of zero in each joint

Levels = Annotated[np.ndarray, PlainValidator(sizes(EACH_JOINT))]  # one per joint
Ranges = Annotated[np.ndarray, PlainValidator(sizes(EACH_JOINT, infinite=True))]
Positives = Annotated[np.ndarray, PlainValidator(positive)]

Number = Annotated[DrawnValue, PlainValidator(drawn(()))]
Joints = Annotated[DrawnValue, PlainValidator(drawn(EACH_JOINT))]
JointsWithin = Annotated[DrawnValue, PlainValidator(drawn(EACH_JOINT, "uniform"))]
JointsSigned = Annotated[DrawnValue, PlainValidator(drawn(EACH_JOINT, "sign"))]
JointsSoft = Annotated[DrawnValue, PlainValidator(drawn(EACH_JOINT, "magnitude"))]
Soft = Annotated[DrawnValue, PlainValidator(drawn((), "magnitude"))]
JointAxes = Annotated[DrawnValue, PlainValidator(drawn((JOINTS, 3)))]
Pairs = Annotated[DrawnValue, PlainValidator(drawn((JOINTS, JOINTS)))]
Vector = Annotated[DrawnValue, PlainValidator(drawn(AXES))]
Plane = Annotated[DrawnValue, PlainValidator(drawn((2,)))]

_Plain = BeforeValidator(plain_number)
Level = Annotated[float, _Plain, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, _Plain, Field(gt=0, allow_inf_nan=False)]
Lasting = Annotated[float, _Plain, Field(gt=0)]  # a time or a distance that may be infinite
Share = Annotated[float, _Plain, Field(ge=0, le=1)]
Factor = Annotated[float, _Plain, Field(ge=1, allow_inf_nan=False)]


def _rising(band: tuple[float, float]) -> tuple[float, float]:
    if band[0] >= band[1]:
        raise ValueError("the lower edge must be below the upper one")
    return band


Band = Annotated[tuple[Positive, Positive], AfterValidator(_rising)]


class NoiseSection(Section):
    """A section whose defaults have the number of joints of the arm that the model is read for."""

    @model_validator(mode="before")
    @classmethod
    def _fill_defaults(cls, value: Any, info: ValidationInfo) -> Any:
        """State the defaults, so that validation gives them the arm's number of joints."""
        if info.context is None or not isinstance(value, dict):
            return value
        stated = cast("dict[str, Any]", value)
        return {name: _scalar(field.default) for name, field in cls.model_fields.items()} | stated


def _scalar(default: Any) -> Any:
    """Return a default as a file would state it: a scalar for all joints, or a section without keys."""
    if isinstance(default, NoiseSection):
        return {}
    if isinstance(default, DrawnValue):
        default = default.size
    return (
        float(np.ravel(cast("Array", default))[0]) if isinstance(default, np.ndarray) else default
    )


class Flicker(NoiseSection):
    """1/f noise: one-sided power spectral density level^2 / f in `band`, flat below, zero above."""

    level: Levels = NONE  # run; N m at 1 Hz per sqrt(Hz)
    band: Band = (0.003, 50.0)  # Hz, edges at which half of the density is left


class Drift(NoiseSection):
    """Thermal drift."""

    size: Levels = NONE  # run; N m, stationary standard deviation of an Ornstein-Uhlenbeck process
    time_constant: Lasting = (
        300.0  # s; infinite: a random walk that spreads as one of 300 s begins to
    )
    # robot (sign); N m, change that a reading approaches exponentially from the run's start
    warm_up: JointsSigned = nothing(EACH_JOINT, "sign")
    warm_up_time: Positive = 1800.0  # s


class EncoderRipple(NoiseSection):
    """Error periodic in a joint's angle."""

    size: Levels = NONE  # robot (phase); root mean square of a sine in the joint's angle
    second: Levels = NONE  # robot (phase); of its second harmonic
    cycles: Levels = np.full(JOINTS, 64.0)  # per turn


class Resonance(NoiseSection):
    """Second-order resonance of a soft control loop, excited by the ripple; unit gain at low frequency."""

    frequency: Positives = np.full(JOINTS, np.inf)  # Hz; infinite: none
    damping: Positives = np.full(JOINTS, 0.2)  # damping ratio


class Ripple(EncoderRipple):
    """Ripple of the torque sensors, N m."""

    cycles: Levels = np.full(JOINTS, 200.0)  # per turn: one a joint, or one for all
    resonance: Resonance = Resonance()


class Torque(NoiseSection):
    """Errors of the joint torque sensors against the true link-side torque."""

    white: Levels = NONE  # sample; N m, white noise
    flicker: Flicker = Flicker()
    drift: Drift = Drift()
    offset: Joints = nothing(EACH_JOINT)  # run; N m, offset after zeroing
    gain_max: JointsWithin = nothing(EACH_JOINT, "uniform")  # robot; relative error of each joint
    nonlinearity_max: JointsWithin = nothing(
        EACH_JOINT, "uniform"
    )  # robot; quadratic, share of the range
    # loops as wide as this share of the swing since the last reversal, within a factor 1.4
    # (Prandtl-Ishlinskii model)
    hysteresis: Levels = NONE
    crosstalk: Pairs = nothing((JOINTS, JOINTS))  # robot; N m per N m of every other joint
    ripple: Ripple = Ripple()
    quantisation: Levels = NONE  # N m, step of the reading, after all errors above
    range: Ranges = np.full(JOINTS, np.inf)  # N m, saturation of the reading
    delay: Level = 0.0  # s, of torque against position
    filter: Level = 0.0  # Hz, first-order low pass; 0: none


class FrictionNoise(NoiseSection):
    """Joint friction by Dahl's law behind the torque sensor, seen by the wrench; it does not slow the arm."""

    coulomb: Levels = NONE  # N m, level of each joint
    static: Factor = 1.0  # higher friction at low speed, over `coulomb` (Stribeck)
    stribeck_speed: Positive = 0.01  # rad/s
    viscous: Levels = NONE  # N m s/rad
    presliding: Positives = np.full(JOINTS, 2e-3)  # rad: one distance, or one a joint
    load: Levels = NONE  # N m per N m, share of the joint's torque
    spread: Joints = nothing(EACH_JOINT)  # robot; relative scatter of `coulomb`
    # relative change with the joint's angle, root mean square; the phase is drawn for the robot
    position: Levels = NONE
    compensated: Share = 0.0  # share that a driver compensates


class Sticking(NoiseSection):
    """Torque that remains in the joints after the arm comes to rest."""

    force: Vector = nothing(AXES)  # rest; N per axis at the TCP
    torque: Joints = nothing(EACH_JOINT)  # rest; N m per joint
    settling: Positive = 0.08  # s in which they build up
    # rad, norm over the joints: motion that shakes them off; infinite: they persist until the next rest
    release: Lasting = 1.5e-3
    relaxation: Lasting = np.inf  # s, time constant of decay at rest
    memory: Share = 0.0  # share in common with the last rest; the size stays the same


class ModelErrors(NoiseSection):
    """Errors of the nominal inertial and kinematic model, drawn for the robot."""

    link_mass: Joints = nothing(EACH_JOINT)  # relative, of the moving links
    link_com: JointAxes = nothing((JOINTS, 3))  # m
    hand_mass: Number = nothing()  # kg
    hand_com: Vector = nothing(AXES)  # m
    payload_cable: Level = (
        0.0  # N, force at the TCP on every axis: a smooth random field over 0.3 m
    )
    base_tilt: Plane = nothing((2,))  # rad; also turns gravity in the base frame
    base_position: Vector = nothing(AXES)  # m, base against scene frame, in the base's axes
    base_yaw: Number = nothing()  # rad
    gravity: Number = nothing()  # m/s^2, true less assumed
    joint_offset: Joints = nothing(EACH_JOINT)  # rad, zeros of the encoders
    link_length: Joints = nothing(EACH_JOINT)  # m, along each link
    # rad per N m, behind the encoders; the magnitude is drawn
    joint_compliance: JointsSoft = nothing(EACH_JOINT, "magnitude")
    tip_offset: Number = nothing()  # m, true end of the pads along the tool
    tip_lateral: Plane = nothing((2,))  # m, across the tool
    pad_compliance: Soft = nothing(
        (), "magnitude"
    )  # m/N, of the pads under a probe; the magnitude is drawn
    finger_width: Number = nothing()  # m, offset of the reported opening


class PoseErrors(NoiseSection):
    """Errors of the encoders."""

    repeatability: Vector = nothing(AXES)  # rest; m per axis, reported against true TCP
    resettling: Positive = 2e-2  # rad of motion over which the next value comes
    encoder: Levels = NONE  # sample; rad, white noise of the angles
    encoder_ripple: EncoderRipple = EncoderRipple()  # rad
    quantisation: Level = 0.0  # rad
    thermal: Level = 0.0  # run; m per axis, with the time constant of the torque drift


class OutlierNoise(NoiseSection):
    """Single samples with errors of Student's t with 2 degrees of freedom."""

    rate: Level = 0.0  # per s and joint
    size: Levels = NONE  # N m


class Dropped(NoiseSection):
    """Gaps in the 1 kHz samples; a logged sample is the mean of those of its five that arrive."""

    rate: Level = 0.0  # per s
    length: Positive = 0.005  # s


class Acquisition(NoiseSection):
    """Errors of the data acquisition. The arm's reflex does not see them."""

    outliers: OutlierNoise = OutlierNoise()
    dropped: Dropped = Dropped()
    repeated: Annotated[Share, Field(lt=1)] = (
        0.0  # sample; share of samples that repeat the last one
    )
    jitter: Level = 0.0  # sample; s, of the time stamps, which stay in order
    clock: Number = nothing()  # robot; relative rate error of the robot's clock


class WristErrors(NoiseSection):
    """Errors of a six-axis sensor at the wrist, as factors on the figures of its data sheet."""

    white: Level = 0.0  # sample; factor on `wrench_sensor.white`
    drift: Level = 0.0  # run; factor on `wrench_sensor.drift`
    offset: Level = 0.0  # robot; zero at power-on, as a multiple of `wrench_sensor.drift`
    gain: Level = 0.0  # robot; factor on `wrench_sensor.gain`
    crosstalk: Level = 0.0  # robot; factor on `wrench_sensor.crosstalk`
    mounting: Level = 0.0  # robot; factor on `wrench_sensor.mounting`


class Vibration(NoiseSection):
    """Vertical vibration of the base, which changes the weight of arm and load."""

    acceleration: Level = 0.0  # run (phase); m/s^2, root mean square
    frequency: Positive = 25.0  # Hz


class Environment(NoiseSection):
    """Disturbances from the arm's surroundings."""

    vibration: Vibration = Vibration()


class NoiseModel(NoiseSection):
    """Deviations of a real arm from its nominal model, and the accuracy stated to its owner.

    `extends` is None once a file is read, as it is then resolved.
    """

    palpate_noise: Literal[1] = 1  # version of the form
    # title in report and result; else the file's name
    name: Annotated[str, Field(min_length=1, max_length=100)] = "unnamed"
    extends: None = (
        None  # a bundled model or another FILE.yaml, whose keys hold where the file has none
    )
    datasheet: Datasheet = Datasheet()
    torque: Torque = Torque()
    friction: FrictionNoise = FrictionNoise()
    sticking: Sticking = Sticking()
    model: ModelErrors = ModelErrors()
    pose: PoseErrors = PoseErrors()
    acquisition: Acquisition = Acquisition()
    environment: Environment = Environment()
    sensor: WristErrors = WristErrors()
