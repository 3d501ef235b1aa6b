"""Noise models in a line, and motions for their sensors."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import load_description
from palpate.robots.simulated.noise.disturbances import LoggedMotion
from palpate.robots.simulated.noise.model import NoiseModel, Streams
from palpate.robots.simulated.noise.sensors import Sensors

ARM = load_description()
NOMINAL = NominalArm(ARM, Pose.of([0, 0, 0]), np.array([0, 0, -9.81]))
HOME = NOMINAL.kinematics(ARM.home[None])
JACOBIAN = HOME.jacobian[0]


def model(**sections: Any) -> NoiseModel:
    """A noise model that is perfect but for these sections."""
    return NoiseModel.model_validate(sections)


def moving(count: int, rate: float | Array = 0.0, position: Array | None = None) -> LoggedMotion:
    """`count` log periods at a constant rate (rad/s) of every joint, from home on."""
    dq = np.broadcast_to(rate, (count, 7)).astype(float)
    q = ARM.home + np.cumsum(dq, axis=0) * 0.005
    place = np.zeros((count, 3)) if position is None else position
    return LoggedMotion(q, dq, JACOBIAN, place)


def sensors(noise: NoiseModel, seed: int = 0) -> Sensors:
    return Sensors(noise, ARM.limits.tau_max, Streams(seed))


def read(found: Sensors, count: int, rate: float = 0.0, torque: float = 0.0) -> Array:
    """What the sensors say of a constant torque, N m, while every joint goes at `rate`, rad/s."""
    return found.measure(np.full((count, 7), torque), moving(count, rate)).torque


def spectrum(signal: Array, period: float) -> tuple[Array, Array]:
    """One-sided power spectral density of a signal (n, k), over its columns' mean: Hz, 1/Hz."""
    n = len(signal)
    window = np.hanning(n)[:, None]
    power = np.abs(np.fft.rfft((signal - signal.mean(0)) * window, axis=0)) ** 2
    density = 2 * period * power / (window**2).sum()
    return np.fft.rfftfreq(n, period)[1:], density.mean(1)[1:]
