"""Noise model: deviations of a real arm from its nominal one. The format of `--noise FILE.yaml`,
version 1.

Every key is optional. An absent key means no error; in `datasheet` it means the figure of the arm's
description. SI units. A size is one standard deviation of a centred normal unless its key ends in
`_max` (uniform within plus and minus) or it is a level. `docs/noise.md` documents every figure.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from palpate.files.worded import Section
from palpate.robots.owner.datasheet import Datasheet
from palpate.robots.simulated.noise.values import (
    AXES,
    JOINTS,
    NONE,
    Factor,
    JointAxes,
    Joints,
    JointsSigned,
    JointsSoft,
    JointsWithin,
    Lasting,
    Level,
    Levels,
    Number,
    Pairs,
    Plane,
    Positive,
    Ranges,
    Seven,
    Share,
    Soft,
    Vector,
    nothing,
)


def _rising(band: tuple[float, float]) -> tuple[float, float]:
    if band[0] >= band[1]:
        raise ValueError("the lower edge must be below the upper one")
    return band


Band = Annotated[tuple[Positive, Positive], AfterValidator(_rising)]


class Flicker(Section):
    """1/f noise: a one-sided power spectral density level^2 / f within `band`, Hz; flat below it,
    zero above. `level`: N m at 1 Hz per sqrt(Hz)."""

    level: Levels = NONE
    band: Band = (0.003, 50.0)


class Drift(Section):
    """Thermal drift, per run: `size` N m stationary, `time_constant` s (infinite: a random walk);
    `warm_up` N m that a reading approaches from the run's start in `warm_up_time` s, with a random
    sign (per robot)."""

    size: Levels = NONE
    time_constant: Lasting = 300.0
    warm_up: JointsSigned = nothing(Seven, "sign")
    warm_up_time: Positive = 1800.0


class Ripple(Section):
    """Error periodic in a joint's angle, `cycles` per turn, phase per robot; `size`: its root mean
    square."""

    size: Levels = NONE
    cycles: Level = 200.0


class EncoderRipple(Ripple):
    """Ripple of the encoders, as `Ripple`, rad."""

    cycles: Level = 64.0


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


class Friction(Section):
    """Joint friction behind the torque sensor; N m, rad, rad/s."""

    coulomb: Levels = NONE
    static: Factor = 1.0
    stribeck_speed: Positive = 0.01
    viscous: Levels = NONE
    presliding: Positive = 2e-3
    load: Levels = NONE
    spread: Joints = nothing(Seven)
    position: Levels = NONE
    compensated: Share = 0.0


class Sticking(Section):
    """Torque left in the joints of an arm that came to rest: `force` N per axis at the TCP and
    `torque` N m per joint."""

    force: Vector = nothing(AXES)
    torque: Joints = nothing(Seven)
    settling: Positive = 0.08
    release: Lasting = 1.5e-3
    relaxation: Lasting = np.inf
    memory: Share = 0.0


class Model(Section):
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


class Outliers(Section):
    """Single samples, heavy tailed: `rate` per s and joint, `size` N m."""

    rate: Level = 0.0
    size: Levels = NONE


class Dropped(Section):
    """Gaps: `rate` per s, each `length` s."""

    rate: Level = 0.0
    length: Positive = 0.005


class Acquisition(Section):
    """Errors of the data acquisition, independent of the samples' values."""

    outliers: Outliers = Outliers()
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
        extends: base model of a file; resolved, and so None, once the file is read.
        datasheet: the only section that estimators know.
    """

    palpate_noise: Literal[1] = 1
    name: Annotated[str, Field(min_length=1, max_length=100)] = "unnamed"
    extends: None = None
    datasheet: Datasheet = Datasheet()
    torque: Torque = Torque()
    friction: Friction = Friction()
    sticking: Sticking = Sticking()
    model: Model = Model()
    pose: PoseErrors = PoseErrors()
    acquisition: Acquisition = Acquisition()
    environment: Environment = Environment()
