"""Torque sensors with gain, hysteresis, drift and coloured noise, joint encoders, and a wrench sensor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.robots.nominal import RIDGE
from palpate.robots.sheet import WristSheet
from palpate.robots.simulated.noise.disturbances import (
    BaseVibration,
    Cable,
    JointFriction,
    LoggedMotion,
    Resonator,
    Rests,
    Waves,
)
from palpate.robots.simulated.noise.line import SignalLine
from palpate.robots.simulated.noise.model import (
    DrawnValue,
    Flicker,
    NoiseModel,
    Streams,
    Torque,
    WristErrors,
)
from palpate.robots.simulated.timing import BLOCK, PERIOD

THRESHOLDS = 8  # play operators of the hysteresis, each half as wide as the one before
WIDEST = 0.25  # of the range: width of the widest play operator
# Ratio of a loop's width to w S, for swing S and weights w. It lies between 1 and 2, by the place
# of S between two thresholds; this is its geometric mean.
LOOP = math.sqrt(2.0)
# s: a random walk has no stationary size. At first it spreads like a drift of that size with this
# time constant; later it does not return.
WALK_TIME = 300.0
AHEAD = 20  # log periods of 1/f noise that are drawn together
PER_DECADE = 3  # relaxations per decade of 1/f noise: their sum is within 3 % of 1/f


class Gauges:
    """The joints' torque sensors with their robot's own gains, cross-talk, curvature, hysteresis and ripple."""

    def __init__(self, torque: Torque, tau_max: Array, streams: Streams) -> None:
        # Sensitivity matrix: gains on its diagonal, cross-talk off it.
        self._matrix = np.diag(1.0 + torque.gain_max.draw(streams("torque.gain_max")))
        crosstalk = torque.crosstalk.draw(streams("torque.crosstalk"))
        self._matrix += crosstalk - np.diag(np.diag(crosstalk))
        self._gain = np.diag(self._matrix).copy()
        self._crossed = torque.crosstalk.any
        # Curvature is relative to the full range.
        full = np.where(np.isfinite(torque.range), torque.range, tau_max)
        self._curvature = None
        if torque.nonlinearity_max.any:
            drawn = torque.nonlinearity_max.draw(streams("torque.nonlinearity_max"))
            self._curvature = drawn / full
        # Ripple of the gears, amplified by a soft control loop.
        self._waves = Waves(torque.ripple, streams("torque.ripple"))
        self._resonator = None
        if np.isfinite(torque.ripple.resonance.frequency).any():
            self._resonator = Resonator(torque.ripple.resonance, PERIOD)
        # Half widths of the play operators, a geometric series.
        self._weight = torque.hysteresis / LOOP
        self._lags = bool(self._weight.any())
        self._half = WIDEST * full * 0.5 ** np.arange(THRESHOLDS)[:, None]
        self._plays: Array | None = None

    def read(self, torque: Array, q: Array) -> Array:
        """Compute the readings (n, 7), N m, at link-side torques (n, 7) and joint angles (n, 7)."""
        reading = torque @ self._matrix.T if self._crossed else self._gain * torque
        if self._curvature is not None:
            reading += self._curvature * torque * torque
        if self._lags:
            reading -= self._weight * self._lag(torque)
        if not self._waves.none:
            ripple = self._waves.at(q)
            reading += ripple if self._resonator is None else self._resonator.passed(ripple)
        return reading

    def _lag(self, torque: Array) -> Array:
        """Sum the lags (n, 7), N m, of play operators of all widths: a Prandtl-Ishlinskii model.

        The width of a loop is proportional to the swing since the last reversal (P. Krejci, "Hysteresis,
        Convexity and Dissipation in Hyperbolic Equations", 1996).
        """
        before = self._plays
        if before is None:
            before = np.broadcast_to(torque[0], self._half.shape)
        # Each play operator follows its input with a dead band: p_i = clip(p_(i-1), u_i - h, u_i + h).
        low, high = torque[:, None] - self._half, torque[:, None] + self._half
        plays = np.empty_like(low)
        for i in range(len(torque)):
            before = np.minimum(np.maximum(before, low[i]), high[i], out=plays[i])
        self._plays = before
        return (torque[:, None] - plays).sum(1)


class Relaxation:
    """Ornstein-Uhlenbeck process of `count` components with stationary standard deviation `size`, exact at any step."""

    def __init__(self, size: Array | float, time: float, random: np.random.Generator, count: int):
        self._size, self._time, self._random, self._count = size, time, random, count
        walks = math.isinf(time)
        # (count,) now; a random walk (infinite `time` constant) starts at zero.
        self.value: Array = np.zeros(count) if walks else size * random.standard_normal(count)

    def after(self, duration: float) -> Array:
        """Advance by `duration` s and return the value (count,)."""
        drawn = self._random.standard_normal(self._count)
        if math.isinf(self._time):
            self.value = self.value + self._size * math.sqrt(2 * duration / WALK_TIME) * drawn
            return self.value
        # Exact discretisation: x' = k x + size sqrt(1 - k^2) n, with k = exp(-dt / time).
        kept = math.exp(-duration / self._time)
        self.value = kept * self.value + self._size * math.sqrt(1 - kept * kept) * drawn
        return self.value


class FlickerNoise:
    """1/f noise of the joints as a sum of relaxations whose corners are spaced evenly on a log axis.

    A relaxation of variance v and corner f_k has the one-sided power spectral density
    (2 v / pi f_k) / (1 + (f / f_k)^2). Corners spaced by a factor r sum to v / (f ln r) between the lowest
    and the highest corner. The sum is flat below and falls as 1 / f^2 above; at the two corners it has
    half that value.
    """

    def __init__(self, flicker: Flicker, period: float, random: np.random.Generator) -> None:
        # Corners and the variance of each relaxation.
        low, high = flicker.band
        count = max(2, math.ceil(PER_DECADE * math.log10(high / low)) + 1)
        corners = np.geomspace(low, high, count)
        size = flicker.level * math.sqrt(math.log(corners[1] / corners[0]))
        # Discretise each relaxation at the log period: decay factor and standard deviation of its input.
        keep = np.exp(-2 * np.pi * corners * period)[:, None]
        self._kick = np.sqrt(1 - keep**2) * size
        self._random, self._parts = (
            random,
            size * random.standard_normal((count, len(flicker.level))),
        )
        # Response of each relaxation to each input of the rows ahead, and the decay of its present value.
        ages = np.subtract.outer(np.arange(AHEAD), np.arange(AHEAD))
        self._response = np.tril(keep[:, None] ** np.maximum(ages, 0))
        self._fade = keep[:, None] ** np.arange(1.0, AHEAD + 1)[:, None]
        self._ahead: Array = np.empty((0, len(flicker.level)))

    def after(self, periods: int) -> Array:
        """Advance by some log periods and return the noise (periods, 7), N m."""
        while len(self._ahead) < periods:
            self._ahead = np.concatenate([self._ahead, self._more()])
        out, self._ahead = self._ahead[:periods], self._ahead[periods:]
        return out

    def _more(self) -> Array:
        """Draw the noise (AHEAD, 7) of the next rows; it does not depend on the motion."""
        drawn = self._random.standard_normal((AHEAD, *self._parts.shape)) * self._kick
        parts = self._response @ drawn.transpose(1, 0, 2) + self._fade * self._parts[:, None]
        self._parts = parts[:, -1]
        return parts.sum(0)


class Wander:
    """Slow and coloured noise of the torque signals: drift, warm-up, flicker, zeroing offset."""

    def __init__(self, torque: Torque, period: float, streams: Streams) -> None:
        drift = torque.drift
        self._period, self._t, self._warm_up_time = period, 0.0, drift.warm_up_time
        # (7,) N m, offset that remains after zeroing.
        self.left = torque.offset.draw(streams.run("torque.offset"))
        self._drift = self._warm_up = self._flicker = None
        if drift.size.any():
            random = streams.run("torque.drift")
            self._drift = Relaxation(drift.size, drift.time_constant, random, len(drift.size))
        if drift.warm_up.any:
            self._warm_up = drift.warm_up.draw(streams("torque.drift.warm_up"))
        if torque.flicker.level.any():
            self._flicker = FlickerNoise(torque.flicker, period, streams.run("torque.flicker"))

    @property
    def now(self) -> Array:
        """Drift (7,), N m, now."""
        return np.zeros_like(self.left) if self._drift is None else self._drift.value

    def add(self, reading: Array) -> None:
        """Add the noise to the readings (n, 7), N m, of n log periods."""
        duration = len(reading) * self._period
        self._t += duration
        if self._drift is not None:
            reading += self._drift.after(duration)
        if self._warm_up is not None:
            reading += self._warm_up * -math.expm1(-self._t / self._warm_up_time)
        if self._flicker is not None:
            reading += self._flicker.after(len(reading))


# Sensors of the arm: joint encoders and joint torque sensors.


# s: time constant of the pads' deformation, sqrt(m c) with an arm's 8 kg on 5e-5 m/N. Hard objects
# of the world ring under an impact; pads would not.
PAD_TIME = 0.02
NOTHING = 1e-6  # N: pads under less than this force are within 0.1 nm of their shape
YIELDS = -math.expm1(-PERIOD / PAD_TIME)  # share of the deformation in a log period


class Encoders:
    """Errors of the joint angles, and of the TCP position that follows from them.

    Attributes:
        exact: True if reported angles equal the true ones, except for noise.
        clean: True if they have no noise.
        soft: m/N, compliance of the pads under a probe. The arm advances by it, and its encoders show it.
    """

    def __init__(self, noise: NoiseModel, rests: Rests, streams: Streams) -> None:
        pose, model = noise.pose, noise.model
        self._rests = rests
        self._compliance = model.joint_compliance.draw(streams("model.joint_compliance"))
        self.soft = model.pad_compliance.number(streams("model.pad_compliance"))
        self._pressed = 0.0
        self._waves = Waves(pose.encoder_ripple, streams("pose.encoder_ripple"))
        self._noise, self._random = pose.encoder, streams.run("pose.encoder")
        self._noisy, self._step = bool(pose.encoder.any()), pose.quantisation
        self.exact = self._waves.none and not (self._compliance.any() or self.soft)
        self.clean = not (self._noisy or pose.quantisation)
        self._thermal = None
        if pose.thermal:
            time = noise.torque.drift.time_constant
            self._thermal = Relaxation(pose.thermal, time, streams.run("pose.thermal"), 3)

    @property
    def pose_error(self) -> Array:
        """Position error (3,), m, world axes: reported less true TCP position, without the angles' part."""
        if self._thermal is None:
            return self._rests.pose_error
        return self._rests.pose_error + self._thermal.value

    def pass_time(self, periods: int) -> None:
        """Advance the thermal expansion of the links by some log periods."""
        if self._thermal is not None:
            self._thermal.after(periods * PERIOD)

    def reported(self, q: Array, torque: Array) -> Array:
        """Return the reported angles (n, 7), rad, of true ones (n, 7) under link-side torques
        (n, 7), N m: the encoders sit before the compliance of the joints."""
        if self.exact:
            return q
        reported = q + self._compliance * torque
        return reported if self._waves.none else reported + self._waves.at(q)

    def pressed(self, jacobian: Array, force: Array, axis: Array) -> Array:
        """Compute the joint motion (n, 7), rad, by which the arm advances while its pads deform.

        The pads press with `force` (n,), N, which is low-passed in place, along the unit vector `axis` (3,). The
        `jacobian` is (6, 7), world axes about the TCP.
        """
        if self._pressed < NOTHING and force.max() <= 0.0:
            self._pressed = 0.0
            return np.zeros((len(force), jacobian.shape[1]))
        # Low-pass the force: the pads deform with the time constant PAD_TIME.
        for i, pressing in enumerate(np.maximum(force, 0.0).tolist()):
            self._pressed += (pressing - self._pressed) * YIELDS
            force[i] = self._pressed
        # Map the advance along the axis to the joints by the pseudo-inverse of the Jacobian.
        forward = np.concatenate([axis, np.zeros(3)])
        along = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + RIDGE, forward)
        return self.soft * force[:, None] * along

    def noise(self, periods: int) -> Array | None:
        """Draw the noise (periods, 7), rad, of block means; None without any."""
        if not self._noisy:
            return None
        return (
            self._noise
            / math.sqrt(BLOCK)
            * self._random.standard_normal((periods, len(self._noise)))
        )

    def quantise_angles(self, q: Array) -> Array:
        """Round angles (n, 7), rad, to whole steps."""
        return np.round(q / self._step) * self._step if self._step else q


class SensorReading(NamedTuple):
    """Measurement of n log periods."""

    torque: Array  # (n, 7) N m
    arrived: NDArray[np.bool_] | None  # (n,) True for samples that arrived; None for all
    # (7,) N m, the last reading before white noise and acquisition errors. The arm's own
    # reflex adds the noise of each look.
    shown: Array


class Sensors:
    """Errors of the joint torque sensors, whose state follows the arm's motion."""

    def __init__(self, noise: NoiseModel, tau_max: Array, streams: Streams) -> None:
        """Draw the sensors' errors; `tau_max` (7,), N m, is the range of a sensor where the model states none."""
        torque, vibration = noise.torque, noise.environment.vibration
        self._friction = JointFriction(noise.friction, PERIOD, streams)
        # Errors of each rest, among them that of the reported pose.
        self.rests = Rests(noise.sticking, noise.pose, PERIOD, streams)
        pull = noise.model.payload_cable
        self._cable = Cable(pull, streams) if pull else None
        self._vibration = None
        if vibration.acceleration:
            self._vibration = BaseVibration(vibration, PERIOD, streams)
        self._gauges = Gauges(torque, tau_max, streams)
        self._wander = Wander(torque, PERIOD, streams)
        # Acquisition of the torque samples.
        self.line = SignalLine(torque, noise.acquisition, streams)
        self._white, self._looks = torque.white, streams.run("torque.white.looks")
        self._noisy = bool(torque.white.any())
        self._zero = np.zeros_like(tau_max)

    def zero(self, torque: Array, nominal: Array, start: LoggedMotion) -> None:
        """Zero the sensors at rest: at the true `torque` (7,) they show the `nominal` one (7,), except for the zeroing
        error. `start` is one log period of the resting arm.
        """
        here = torque[None] + self._friction.torque
        if self._cable is not None:
            self._cable.add(here, start)
        shown = self._gauges.read(here, start.q)[0]
        self._zero = shown + self._wander.now - nominal - self._wander.left

    def measure(self, torque: Array, motion: LoggedMotion) -> SensorReading:
        """Simulate the measurement of the true mean torques (n, 7) behind the gears, N m."""
        # Disturbances of the mechanics add to the torque behind the gears.
        torque = torque.copy()
        if self._vibration is not None:
            self._vibration.add(torque)
        if not self._friction.none:
            self._friction.add(torque, motion)
        if not self.rests.none:
            self.rests.add(torque, motion)
        if self._cable is not None:
            self._cable.add(torque, motion)
        # The sensors then add their own errors, less the reading at zeroing.
        reading = self._gauges.read(torque, motion.q)
        self._wander.add(reading)
        reading -= self._zero
        shown = reading[-1].copy()
        return SensorReading(*self.line.carry(reading), shown)

    def looks(self, count: int) -> Array:
        """Draw the white noise (count, 7), N m, of single 1 kHz samples."""
        shape = (count, len(self._white))
        return self._white * self._looks.standard_normal(shape) if self._noisy else np.zeros(shape)


# Six-axis force/torque sensor at the wrist.

WRENCH = 6  # axes
MOMENT_LEVER = 0.3  # m: relates the cross-talk between forces and moments


class WristSensor:
    """Sensor whose errors are drawn once per robot, and whose noise and drift are drawn per run."""

    def __init__(self, sheet: WristSheet, errors: WristErrors, streams: Streams) -> None:
        """Draw the errors: those of the data sheet `sheet`, times the factors of the noise model."""
        # Sensitivity: a common gain, cross-talk between the axes, and a turn in the mounting.
        unit = np.repeat([1.0, MOMENT_LEVER], 3)

        def draw(name: str, size: float, shape: tuple[int, ...]) -> Array:
            drawn = DrawnValue("normal", np.full(shape, size))
            return drawn.draw(streams(f"sensor.{name}"))

        crossed = draw("crosstalk", errors.crosstalk * sheet.crosstalk, (WRENCH, WRENCH))
        np.fill_diagonal(crossed, 0.0)
        gain = float(draw("gain", errors.gain * sheet.gain, ()))
        x, y, z = draw("mounting", errors.mounting * sheet.mounting, (3,)).tolist()
        turn = np.array([[1.0, z, -y], [-z, 1.0, x], [y, -x, 1.0]])
        turned = np.kron(np.eye(2), turn)
        matrix = (1.0 + gain) * np.eye(WRENCH) + unit[:, None] * crossed / unit
        self._matrix: Array = matrix @ turned
        self._range = sheet.range
        # Noise of a block's mean, and a zero that drifts.
        self._white = errors.white * sheet.white / np.sqrt(BLOCK)
        self._random, self._resting = streams.run("sensor.white"), streams.run("sensor.white.rest")
        self._zero = draw("offset", errors.offset, (WRENCH,)) * sheet.drift
        drift = errors.drift * sheet.drift
        self._drift = Relaxation(drift, sheet.drift_time, streams.run("sensor.drift"), WRENCH)

    def rest(self, wrench: Array, duration: float) -> Array:
        """Measure the wrench (6,) of a rest at the start: the mean over `duration` s."""
        noise = self._white * math.sqrt(PERIOD / duration) * self._resting.standard_normal(WRENCH)
        return self._matrix @ wrench + self._zero + self._drift.value + noise

    def read(self, wrench: Array) -> Array:
        """Measure wrenches (n, 6), N and N m, that the arm exerts below the sensor, in its axes."""
        found = wrench @ self._matrix.T
        found += self._zero + self._drift.after(len(wrench) * PERIOD)
        found += self._white * self._random.standard_normal(found.shape)
        return np.clip(found, -self._range, self._range)
