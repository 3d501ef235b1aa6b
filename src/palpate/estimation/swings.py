"""Inertia tensor from sinusoidal excitation: swings with the load against swings without.

As the hand rotates to and fro about its TCP, every joint torque oscillates. The weight and inertia of the arm
and the wrench of the load cause it. About the TCP, the load exerts

    f = m (a + g) + alpha x h + w x (w x h)        n = h x (a + g) + I alpha + w x I w.

Here a is the acceleration of the TCP, w and alpha the angular rate and acceleration of the hand. g is gravity
(upward, as the force that holds the load), h = m c the first moment, I the inertia about the TCP. The wrench is
linear in all ten parameters.

Each signal is fitted by a constant, a trend and a sine at the swing's frequency (a lock-in). This rejects
constants, drift and noise at other frequencies; friction lags by a quarter of a period. Signals of unit
parameters and of the arm's links are computed sample by sample and pass the same lock-in. A compliant arm still
oscillates as a swing begins, so -w² times the displacement would be wrong by 1 to 2 %. The error of the nominal
link inertias cancels against the swing of the empty hand, in proportion to the angle.

Gear torques in phase with the angle do not cancel. A swing of some mrad covers a part of one period of the gear
ripple. That part acts like a spring, at another phase when the load has bent the arm. Friction in a joint that
hardly turns acts like a spring as well: Dahl's state is in phase with the angle. Each is an unknown of its joint,
common to all swings. Its size is taken from the swings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Pose, rotations
from palpate.estimation.descent import gear_waves
from palpate.estimation.joint_friction import TURNED, dahl_states
from palpate.estimation.load_noise import SignalLevels
from palpate.estimation.motion import commanded_rows, mean_pose, runs
from palpate.estimation.rigid_bodies import wrenches_of_load
from palpate.estimation.segments import NEAR
from palpate.estimation.wrench_observation import WrenchObservation, observe_wrench
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace

ARM_SWING = 3e-4
"""Fraction (1 sigma) of the torques of the empty swing that changes with a load for unknown reasons: sensors are
linear to a thousandth of their torque at best. Sensitive: hardly."""
ARM_BENT = 0.05
"""Relative error (1 sigma) of the predicted change of the links' inertial torques with a load: nominal inertias are
wrong by some per cent. Sensitive: inertia std ×0.9–1.2."""
ARM_RUBS = 0.03
"""Fraction (1 sigma) of the friction of the empty swing whose part in phase with the angle changes with a load.
Chosen on six hammers at `measured`: the errors of their two large components are 0.76 (rms) of the stated deviations,
0.88 with half of it, 1.08 without it. Sensitive: inertia std ×0.7 without it at `measured`, ×0.9 at `lab`."""
ARM_STICKS = 0.01
"""Fraction (1 sigma) of a joint's dry friction that changes with a load, in swings in which the joint hardly turns.
Chosen on the same six: without it, two are contradicted. Sensitive: inertia std ×0.8–1.4 without it."""
SAME_AXIS = 0.98
"""Cosine between the axes of two swings above which they are comparable. Sensitive: no."""
SAME_RATE = 0.02
"""Relative difference of their rates below which two swings are comparable. Sensitive: no."""
TURNING_POINT = 0.04
"""s. Longest apparent rest of the command at a turning point of a swing. Sensitive: no."""
SHORTEST_SWING = 0.8
"""s. Shortest rotation of the hand that counts as a swing. Sensitive: no."""
RATE_SEARCH = (0.05, 0.005, 0.0005)
"""Relative widths of the successive searches for a rate. Sensitive: no."""
RATE_STEPS = 21
"""Number of rates tried in each search. Sensitive: no."""

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class SwingResponse:
    """Response to a swing about one axis, in phase with the angle of the hand."""

    time: float  # s, middle of the swing
    pose: Pose  # mean pose of the hand
    axis: Array  # (3,) unit, world
    angle: float  # rad, amplitude
    rate: float  # rad/s, angular frequency
    observed: Array  # (m,) amplitudes of the signals, N m
    variance: Array  # (m,) N² m², of the amplitudes, by sensor noise
    rubbing: Array  # (m,) N m, amplitudes in quadrature, by friction
    own: Array  # (m,) N m, part of the arm's links by their nominal inertias; 0 where unknown
    # (m, 10) amplitudes per unit mass, first moment and inertia (about the TCP, tool axes).
    load: Array
    # (m, 5) amplitudes per N m of each gear wave (`descent.gear_waves`) and of Dahl's state; 0
    # where the signals are not joint torques.
    gears: Array
    rippled: Array  # (m,) N² m², mean square of the signals that the waves explain


def swings(trace: Trace, recording: Recording, noise: SignalLevels) -> Sequence[SwingResponse]:
    """Responses to all swings of a recording, in order; `noise` is that of each signal."""
    samples, observed = trace.of(recording), observe_wrench(trace)
    # Signals in the rows of the recording, and gear ripple where the hand states it.
    first, last = np.searchsorted(trace.samples.t, [recording.start, recording.end + 1e-9])
    signals = observed.signals[int(first) : int(last)]
    cycles = trace.hand.ripple_cycles or (0.0,) * signals.shape[1]
    found: list[SwingResponse] = []
    for rows in rows_of_swings(samples):
        part = samples.where(rows)
        found.append(swing_of(part, signals[rows], observed, noise, trace.gravity, cycles))
    return found


def contrast(
    loaded: Sequence[SwingResponse], empty: Sequence[SwingResponse]
) -> Iterator[tuple[SwingResponse, Array, Array, Array]]:
    """Subtract from each loaded swing its empty counterpart; loaded swings without one are skipped.

    Yields the loaded swing, the signals of the load alone (m,), and their variance (m,). The last item is the effect
    (m, k) of one deviation of each gear unknown on them.
    """
    every = [*loaded, *empty]
    if not every:
        return
    # Amplitude of the gear waves: two harmonics, each a sine and a cosine of equal amplitude.
    wave = np.sqrt(np.max([swing.rippled for swing in every], axis=0) / 2.0)
    # Dry friction: the first harmonic of a square wave is 4 / pi of its amplitude.
    dry = np.pi / 4.0 * np.abs([swing.rubbing for swing in every]).max(axis=0)
    size = np.column_stack([wave, wave, wave, wave, dry])
    for swing in loaded:
        # Find the swing of the empty hand about the same axis at the same pose and frequency.
        alike = [
            own
            for own in empty
            if own.pose.distance_to(swing.pose) < NEAR
            and abs(float(own.axis @ swing.axis)) > SAME_AXIS
            and abs(own.rate - swing.rate) < SAME_RATE * swing.rate
        ]
        if not alike:
            continue
        own = alike[0]
        ratio = swing.angle / own.angle
        # The load bends the arm slightly, so the joints share the swing differently.
        bent = swing.own - ratio * own.own
        inexact = (
            ARM_SWING * own.observed,
            ARM_BENT * bent,
            ARM_RUBS * own.rubbing,
            ARM_STICKS * dry,
        )
        variance = swing.variance + ratio**2 * own.variance + sum(part**2 for part in inexact)
        gears = size * (swing.gears - ratio * own.gears)
        yield swing, swing.observed - ratio * own.observed - bent, variance, gears


def rows_of_swings(samples: Samples) -> Iterator[slice]:
    """Yield the rows of each swing: the commanded pose rotates, except in short pauses at its turning points."""
    moving = commanded_rows(samples)
    turning = moving.copy()
    period = float(np.median(np.diff(samples.t))) if len(samples) > 1 else 1.0
    gap = max(1, round(TURNING_POINT / period))
    # Close the short pauses at turning points.
    for rows in runs(~moving):
        inside = rows.start > 0 and rows.stop < len(moving)
        if inside and rows.stop - rows.start < gap:
            turning[rows] = True
    for rows in runs(turning):
        if samples.t[rows.stop - 1] - samples.t[rows.start] > SHORTEST_SWING:
            yield rows


def swing_of(
    samples: Samples,
    signals: Array,
    observed: WrenchObservation,
    noise: SignalLevels,
    gravity: float,
    cycles: Sequence[float],
) -> SwingResponse:
    """Lock-in amplitudes of the `signals` (n, m) of a swing; gears of joint i ripple `cycles[i]` times a turn."""
    rate = commanded_rate(samples)
    period = 2.0 * np.pi / rate
    # The amplitude grows in the first period and decays in the last: use the periods between.
    steady = (samples.t > samples.t[0] + period) & (samples.t < samples.t[-1] - period)
    joints, hand = (change[steady] for change in accelerations(samples))
    angles = np.zeros(signals.shape) if observed.chain is None else samples.q
    states, angles = dahl_states(angles)[steady, :, TURNED], angles[steady]
    samples, signals = samples.where(steady), signals[steady]
    # Axis and phase of the rotation: the principal direction of its complex amplitude.
    pose = mean_pose(samples)
    turned = rotation_vectors(samples.pose_world_tcp[:, 3:], pose)
    lock = _Lock.of(samples.t, rate)
    turn = lock.of_signal(turned)
    along = np.linalg.svd(np.stack([turn.real, turn.imag]))[2][0]
    phase = complex(turn @ along)
    angle = abs(phase)
    unit = phase / angle

    def in_phase(values: Array) -> Array:
        """Amplitude (…,) of values (n, …) in phase with the angle."""
        flat = lock.of_signal(values.reshape(len(values), -1)) / unit
        return flat.real.reshape(values.shape[1:])

    # Torques of the links alone, waves of the gears, and the noise of an amplitude.
    t = samples.t
    links = observed.links_motion(samples.q, samples.dq, joints)
    waves = [gear_waves(*joint) for joint in zip(angles.T, cycles, strict=False)]
    # Noise at the frequency of the swing over its duration: 2 s² dt for white noise, h²/f for 1/f noise.
    slow = 2.0 * np.pi * noise.flicker / (rate * float(t[-1] - t[0]))
    return SwingResponse(
        time=float(t.mean()),
        pose=pose,
        axis=along,
        angle=angle,
        rate=rate,
        observed=in_phase(signals),
        variance=2.0 * noise.white / len(t) + slow,
        rubbing=(lock.of_signal(signals) / unit).imag,
        own=in_phase(links),
        load=in_phase(observed.maps(samples.q) @ unit_load_wrenches(samples, hand, gravity)),
        gears=in_phase(np.dstack([np.stack(waves, axis=1), states])),
        rippled=np.array([lock.explained(*one) for one in zip(signals.T, waves, strict=True)]),
    )


def accelerations(samples: Samples) -> tuple[Array, Array]:
    """Accelerations of the joints (n, m), rad/s², and of the TCP (n, 6), m/s² and rad/s², world axes.

    Cubic splines through the speeds have no lag or attenuation at swing frequencies.
    """
    from scipy.interpolate import CubicSpline

    found = CubicSpline(samples.t, np.hstack([samples.dq, samples.twist]))(samples.t, 1)
    joints = samples.dq.shape[1]
    return found[:, :joints], found[:, joints:]


@dataclass(frozen=True, slots=True, eq=False)
class _Lock:
    """Least-squares fit of a constant, a trend and a sine (lock-in)."""

    design: Array  # (n, 4) cosine, sine, constant and trend
    inverse: Array  # (4, n) its pseudoinverse

    @classmethod
    def of(cls, t: Array, rate: float) -> _Lock:
        """Lock-in at times `t` (n,), s, and angular frequency `rate`, rad/s."""
        since = t - t.mean()
        design = np.column_stack(
            [np.cos(rate * since), np.sin(rate * since), np.ones_like(since), since]
        )
        return cls(design, np.linalg.pinv(design))

    def of_signal(self, values: Array) -> Complex:
        """Complex amplitudes (k,) of signals (n, k)."""
        cosine, sine = (self.inverse @ values)[:2]
        return cosine - 1j * sine

    def explained(self, signal: Array, waves: Array) -> float:
        """Mean square of a signal (n,) that `waves` (n, k) explain beyond the lock-in."""
        left, beside = (x - self.design @ (self.inverse @ x) for x in (signal, waves))
        found = np.linalg.lstsq(beside, left, rcond=None)[0]
        return float(np.mean((beside @ found) ** 2))


def commanded_rate(samples: Samples) -> float:
    """Angular frequency of the commanded swing, rad/s: the sine with the largest amplitude.

    It is exact to a hundredth of a period over the whole length.
    """
    # Command along its principal axis, and a first rate from its zero crossings.
    middle = Pose(np.zeros(3), samples.target_world_tcp[0, 3:])
    turned = rotation_vectors(samples.target_world_tcp[:, 3:], middle)
    along = turned @ np.linalg.svd(turned, full_matrices=False)[2][0]
    crossings = np.flatnonzero(np.diff(np.signbit(along)))
    inner = samples.t[crossings[1:-1]]
    rate = np.pi * (len(inner) - 1) / max(float(inner[-1] - inner[0]), 1e-9)
    # Refine the rate in nested searches for the largest lock-in amplitude.
    for finer in RATE_SEARCH:
        rates = rate * np.linspace(1.0 - finer, 1.0 + finer, RATE_STEPS)
        rate = max(
            rates.tolist(),
            key=lambda one: abs(_Lock.of(samples.t, one).of_signal(along[:, None])[0]),
        )
    return float(rate)


def rotation_vectors(quaternions: Array, about: Pose) -> Array:
    """Rotation vectors (n, 3), rad, world axes, of poses with `quaternions` (n, 4) relative to `about`."""
    # Axis times sine from the skew part of the relative rotation, then scaled to axis times angle.
    relative = rotations(quaternions) @ about.rotation.T
    skew = relative - relative.transpose(0, 2, 1)
    vectors = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) / 2.0
    sines = np.minimum(np.linalg.norm(vectors, axis=1, keepdims=True), 1.0)
    return vectors * np.where(sines > 1e-9, np.arcsin(sines) / np.maximum(sines, 1e-9), 1.0)


def unit_load_wrenches(samples: Samples, changes: Array, gravity: float) -> Array:
    """Wrenches (n, 6, 10) about the TCP, world axes, of unit mass, first moment and inertia in tool axes."""
    pulled = changes[:, :3] + np.array([0.0, 0.0, gravity])
    return wrenches_of_load(
        rotations(samples.pose_world_tcp[:, 3:]), pulled, samples.twist[:, 3:], changes[:, 3:]
    )
