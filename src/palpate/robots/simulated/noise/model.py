"""Noise model: deviations of a real arm from its nominal model. The format of `--noise FILE.yaml`, version 1.

Every key is optional. An absent key means no error; in `datasheet` it means the figure of the arm's
description. Units are SI. A scalar applies to all seven joints, or to all axes. A size is one standard
deviation of a centred normal distribution. It is a half width of a uniform distribution if its key ends in
`_max`, and a plain value if it is a level. A drawn size may be written `{fixed: value}`: the value is then
the same for every seed. `docs/noise.md` documents every figure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator

from palpate.common.files import Section, plain_number
from palpate.common.pose import Array
from palpate.robots.owner import Datasheet

JOINTS = 7
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

    A change of one key changes no other stream.

    Args:
        seed: seed of the robot.
        visit: number of that robot's run.
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

    Raises:
        ValueError: `message`.
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


def sizes(shape: Shape, infinite: bool = False) -> Callable[[Any], Array]:
    """Make a validator of sizes: numbers that are not negative."""

    def read(value: Any) -> Array:
        array = array_of(value, shape, form_of(shape))
        if (array < 0).any():
            raise ValueError("must not be negative")
        if not infinite and np.isinf(array).any():
            raise ValueError("must be finite")
        return array

    return read


def positive(value: Any) -> Array:
    """Validate one positive number a joint; it may be infinite."""
    array = sizes((JOINTS,), infinite=True)(value)
    if (array == 0).any():
        raise ValueError("must be positive")
    return array


def drawn(shape: Shape, law: Law = "normal") -> Callable[[Any], DrawnValue]:
    """Make a validator of a size, or `{fixed: value}`."""
    size = sizes(shape)

    def read(value: Any) -> DrawnValue:
        if isinstance(value, DrawnValue):
            return value
        if not isinstance(value, dict):
            return DrawnValue(law, size(value))
        said = cast("dict[str, Any]", value)
        if set(said) != {"fixed"}:
            raise ValueError(f"{form_of(shape)}, or {{fixed: VALUE}}")
        fixed = array_of(said["fixed"], shape, f"fixed: {form_of(shape)}")
        if np.isinf(fixed).any():
            raise ValueError("fixed: must be finite")
        if law == "magnitude" and (fixed < 0).any():
            raise ValueError("fixed: must not be negative")
        return DrawnValue(law, size(0.0), fixed)

    return read


def nothing(shape: Shape = (), law: Law = "normal") -> DrawnValue:
    """Return a drawn value that is always zero."""
    return DrawnValue(law, np.zeros(shape))


Seven = (JOINTS,)
AXES = (3,)
NONE = np.zeros(JOINTS)  # level of zero in each joint

Levels = Annotated[np.ndarray, PlainValidator(sizes(Seven))]  # one per joint
Ranges = Annotated[np.ndarray, PlainValidator(sizes(Seven, infinite=True))]
Positives = Annotated[np.ndarray, PlainValidator(positive)]

Number = Annotated[DrawnValue, PlainValidator(drawn(()))]
Joints = Annotated[DrawnValue, PlainValidator(drawn(Seven))]
JointsWithin = Annotated[DrawnValue, PlainValidator(drawn(Seven, "uniform"))]
JointsSigned = Annotated[DrawnValue, PlainValidator(drawn(Seven, "sign"))]
JointsSoft = Annotated[DrawnValue, PlainValidator(drawn(Seven, "magnitude"))]
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


class Flicker(Section):
    """1/f noise with the one-sided power spectral density level^2 / f within `band`, Hz.

    It is flat below the band and zero above. `level` is N m at 1 Hz per sqrt(Hz).
    """

    level: Levels = NONE
    band: Band = (0.003, 50.0)


class Drift(Section):
    """Thermal drift, per run.

    `size` is the stationary standard deviation, N m, with `time_constant`, s (infinite: a random walk).
    `warm_up`, N m, is a change that a reading approaches from the run's start in `warm_up_time`, s, with a
    random sign (per robot).
    """

    size: Levels = NONE
    time_constant: Lasting = 300.0
    warm_up: JointsSigned = nothing(Seven, "sign")
    warm_up_time: Positive = 1800.0


class EncoderRipple(Section):
    """Error periodic in a joint's angle, with `cycles` per turn and a phase per robot.

    `size` is its root mean square, `second` that of its second harmonic.
    """

    size: Levels = NONE
    second: Levels = NONE
    cycles: Levels = np.full(JOINTS, 64.0)


class Resonance(Section):
    """Second-order resonance of unit gain at low frequency, with natural `frequency`, Hz (infinite: none),
    and `damping` ratio.
    """

    frequency: Positives = np.full(JOINTS, np.inf)
    damping: Positives = np.full(JOINTS, 0.2)


class Ripple(EncoderRipple):
    """Ripple of the torque sensors, N m, as `EncoderRipple`, amplified by a soft control loop."""

    cycles: Levels = np.full(JOINTS, 200.0)
    resonance: Resonance = Resonance()


class Torque(Section):
    """Errors of the joint torque sensors against the true link-side torque; N m."""

    white: Levels = NONE
    flicker: Flicker = Flicker()
    drift: Drift = Drift()
    offset: Joints = nothing(Seven)
    gain_max: JointsWithin = nothing(Seven, "uniform")
    nonlinearity_max: JointsWithin = nothing(Seven, "uniform")
    hysteresis: Levels = NONE
    crosstalk: Pairs = nothing((JOINTS, JOINTS))
    ripple: Ripple = Ripple()
    quantisation: Levels = NONE
    range: Ranges = np.full(JOINTS, np.inf)
    delay: Level = 0.0
    filter: Level = 0.0


class FrictionNoise(Section):
    """Joint friction by Dahl's law behind the torque sensor; N m, rad, rad/s."""

    coulomb: Levels = NONE
    static: Factor = 1.0
    stribeck_speed: Positive = 0.01
    viscous: Levels = NONE
    presliding: Positives = np.full(JOINTS, 2e-3)
    load: Levels = NONE
    spread: Joints = nothing(Seven)
    position: Levels = NONE
    compensated: Share = 0.0


class Sticking(Section):
    """Torque that remains in the joints after the arm comes to rest: `force` N per axis at the TCP and
    `torque` N m per joint.
    """

    force: Vector = nothing(AXES)
    torque: Joints = nothing(Seven)
    settling: Positive = 0.08
    release: Lasting = 1.5e-3
    relaxation: Lasting = np.inf
    memory: Share = 0.0


class ModelErrors(Section):
    """Errors of the nominal inertial and kinematic model, per robot."""

    link_mass: Joints = nothing(Seven)
    link_com: JointAxes = nothing((JOINTS, 3))
    hand_mass: Number = nothing()
    hand_com: Vector = nothing(AXES)
    payload_cable: Level = 0.0
    base_tilt: Plane = nothing((2,))
    base_position: Vector = nothing(AXES)
    base_yaw: Number = nothing()
    gravity: Number = nothing()
    joint_offset: Joints = nothing(Seven)
    link_length: Joints = nothing(Seven)
    joint_compliance: JointsSoft = nothing(Seven, "magnitude")
    tip_offset: Number = nothing()
    tip_lateral: Plane = nothing((2,))
    pad_compliance: Soft = nothing((), "magnitude")
    finger_width: Number = nothing()


class PoseErrors(Section):
    """Errors of the encoders: m, rad."""

    repeatability: Vector = nothing(AXES)
    resettling: Positive = 2e-2
    encoder: Levels = NONE
    encoder_ripple: EncoderRipple = EncoderRipple()
    quantisation: Level = 0.0
    thermal: Level = 0.0


class OutlierNoise(Section):
    """Single samples with errors of a heavy-tailed distribution: `rate` per s and joint, `size` N m."""

    rate: Level = 0.0
    size: Levels = NONE


class Dropped(Section):
    """Gaps in the samples: `rate` per s, each `length` s."""

    rate: Level = 0.0
    length: Positive = 0.005


class Acquisition(Section):
    """Errors of the data acquisition, independent of the samples' values."""

    outliers: OutlierNoise = OutlierNoise()
    dropped: Dropped = Dropped()
    repeated: Annotated[Share, Field(lt=1)] = 0.0
    jitter: Level = 0.0
    clock: Number = nothing()


class Vibration(Section):
    """Vertical vibration of the base: `acceleration` m/s^2, root mean square, at `frequency` Hz."""

    acceleration: Level = 0.0
    frequency: Positive = 25.0


class Environment(Section):
    """Disturbances from the arm's surroundings."""

    vibration: Vibration = Vibration()


class NoiseModel(Section):
    """Deviations of a real arm from its nominal model, and the accuracy stated to its owner.

    Attributes:
        name: title in report and result.
        extends: base model of a file; None once the file is read, as it is then resolved.
        datasheet: the only section that estimators know.
    """

    palpate_noise: Literal[1] = 1
    name: Annotated[str, Field(min_length=1, max_length=100)] = "unnamed"
    extends: None = None
    datasheet: Datasheet = Datasheet()
    torque: Torque = Torque()
    friction: FrictionNoise = FrictionNoise()
    sticking: Sticking = Sticking()
    model: ModelErrors = ModelErrors()
    pose: PoseErrors = PoseErrors()
    acquisition: Acquisition = Acquisition()
    environment: Environment = Environment()
