"""Inertia tensor from sinusoidal excitation: swings with the load against swings without.

As the hand turns to and fro about its TCP, every joint torque oscillates by the weight and inertia of the
arm itself, and by the wrench of the load: about the TCP,

    f = m (a + g) + alpha x h + w x (w x h)        n = h x (a + g) + I alpha + w x I w

with the acceleration a of the TCP, the rate w and angular acceleration alpha of the hand, gravity g (upward,
as the force that holds the load), the first moment h = m c of the load and its inertia I about the TCP: linear
in all ten parameters. Each signal is fitted by a constant, a trend and a sine at the frequency of the swing (a
lock-in), which rejects constants, drift and noise at other frequencies; friction is a quarter of a period out
of phase. Signals of unit parameters and of the arm's own links are computed sample by sample and pass the
same lock-in, because springs that still ring as a swing begins are no pure sine: -w² times the displacement
would be 1 to 2 % off. The error of the links' nominal inertias cancels against the swing of the empty hand, in
proportion to the angle.

What the gears add in phase with the angle does not cancel. A swing of some mrad is a part of one wave of their
ripple, which passes for a spring, and at another phase where the load has bent the arm. Friction is a spring, too, in
a joint that hardly turns: Dahl's state is in phase with the angle. Each is an unknown of its joint, the same in all
swings, as large as the swings show.
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
from palpate.estimation.motion import Mask, commanded_rows, mean_pose, runs
from palpate.estimation.segments import NEAR
from palpate.estimation.wrench_observation import WrenchObservation, observe
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace

ARM_SWING = 3e-4
"""part (1 sigma) of the torques of the empty swing that changes with a load for no known reason: the linearity of a
sensor is no better than a thousandth of its torque. Sensitive: hardly."""
ARM_BENT = 0.05
"""part (1 sigma) of the change of the links' inertial torques with a load that is unknown: nominal inertias are some
per cent off. Sensitive: inertia std ×0.9–1.2."""
ARM_RUBS = 0.03
"""part (1 sigma) of the friction in the empty swing by which its part in phase with the angle changes with a load for
no known reason. Chosen on six hammers at `measured`: their two large components are 0.76 (rms) of their deviations off,
with half of it 0.88, without it 1.08. Sensitive: inertia std ×0.7 without it at `measured`, ×0.9 at `lab`."""
ARM_STICKS = 0.01
"""part (1 sigma) of a joint's dry friction, likewise, in swings in which it hardly turns.
Chosen on the same six: without it two of them are contradicted. Sensitive: inertia std ×0.8–1.4 without it."""
SAME_AXIS = 0.98
"""cosine between the axes of two swings that compare. Sensitive: no."""
SAME_RATE = 0.02
"""part by which their rates may differ. Sensitive: no."""
TURNING_POINT = 0.04
"""s in which a commanded swing may seem to stand still. Sensitive: no."""
SHORTEST_SWING = 0.8
"""s: a shorter turn of the hand is no swing. Sensitive: no."""
RATE_SEARCH = (0.05, 0.005, 0.0005)
"""parts of a rate within which it is looked for, one after the other. Sensitive: no."""
RATE_STEPS = 21
"""rates that are tried each time. Sensitive: no."""

Complex = NDArray[np.complex128]

INERTIA = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of xx yy zz xy xz yz."""


@dataclass(frozen=True, slots=True, eq=False)
class SwingResponse:
    """Swing about one axis, in phase with the angle of the hand.

    Attributes:
        time: s, its middle.
        pose: where the hand turned.
        axis: (3,) unit, world.
        angle: rad, amplitude.
        rate: rad/s.
        observed: (m,) amplitudes of the signals, N m.
        variance: (m,) of the amplitudes, by the noise of the sensors.
        rubbing: (m,) amplitudes a quarter of a period later, of friction.
        own: (m,) part of the arm's own links, by their nominal inertias; 0 where unknown.
        load: (m, 10) amplitudes per unit mass, first moment and inertia (about the TCP, tool axes).
        gears: (m, 5) amplitudes per N m of each wave of the gears (`contact.ripple.gear_waves`), and of Dahl's
            state; 0 where the signals are no joints'.
        rippled: (m,) N² m², mean square of the signals that the waves explain.
    """

    time: float
    pose: Pose
    axis: Array
    angle: float
    rate: float
    observed: Array
    variance: Array
    rubbing: Array
    own: Array
    load: Array
    gears: Array
    rippled: Array


def swings(trace: Trace, recording: Recording, noise: SignalLevels) -> Sequence[SwingResponse]:
    """All swings in a recording, in order."""
    samples, observed = trace.of(recording), observe(trace)
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
    """Each loaded swing that has an empty counterpart, with the signals of the load alone (m,), their variance (m,),
    and what one deviation of each unknown of the gears does to them (m, k)."""
    every = [*loaded, *empty]
    if not every:
        return
    # The mean square of two harmonics, each a sine and a cosine of amplitudes alike.
    wave = np.sqrt(np.max([swing.rippled for swing in every], axis=0) / 2.0)
    # The first harmonic of a square wave is 4 / pi of its size.
    dry = np.pi / 4.0 * np.abs([swing.rubbing for swing in every]).max(axis=0)
    size = np.column_stack([wave, wave, wave, wave, dry])
    for swing in loaded:
        # The swing of the empty hand about the same axis at the same pose and frequency.
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
        # The load bends the arm a little, so that the joints share the swing differently.
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
    """Rows of each swing: the commanded pose turns, apart from short pauses at its turning points."""
    moving = commanded_rows(samples)
    turning = moving.copy()
    period = float(np.median(np.diff(samples.t))) if len(samples) > 1 else 1.0
    gap = max(1, round(TURNING_POINT / period))
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
    """Amplitudes of the `signals` (n, m) of a swing, of m joints whose gears ripple `cycles` (m,) times a turn."""
    rate = commanded_rate(samples)
    period = 2.0 * np.pi / rate
    # The amplitude grows in the first period and fades in the last.
    steady = (samples.t > samples.t[0] + period) & (samples.t < samples.t[-1] - period)
    motion = _Changes.of(samples).where(steady)
    angles = np.zeros(signals.shape) if observed.chain is None else samples.q
    states, angles = dahl_states(angles)[steady, :, TURNED], angles[steady]
    samples, signals = samples.where(steady), signals[steady]
    pose = mean_pose(samples)
    turned = rotation_vectors(samples.pose_world_tcp[:, 3:], pose)
    lock = _Lock.of(samples.t, rate)
    turn = lock.of_signal(turned)
    along = np.linalg.svd(np.stack([turn.real, turn.imag]))[2][0]
    phase = complex(turn @ along)
    angle = abs(phase)
    unit = phase / angle

    def in_phase(values: Array) -> Array:
        """(…,) of (n, …): its amplitude in phase with the angle."""
        flat = lock.of_signal(values.reshape(len(values), -1)) / unit
        return flat.real.reshape(values.shape[1:])

    t = samples.t
    links = observed.links_motion(samples.q, samples.dq, motion.joints)
    waves = [gear_waves(*joint) for joint in zip(angles.T, cycles, strict=False)]
    # Density of the noise at the frequency of the swing over the duration: 2 s² dt of white noise, h²/f of 1/f noise.
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
        load=in_phase(observed.maps(samples.q) @ unit_load_wrenches(samples, motion, gravity)),
        gears=in_phase(np.dstack([np.stack(waves, axis=1), states])),
        rippled=np.array([lock.explained(*one) for one in zip(signals.T, waves, strict=True)]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Changes:
    """Time derivatives of joint rates and of the TCP's twist.

    Attributes:
        joints: (n, m) rad/s².
        hand: (n, 6) m/s² and rad/s² of the TCP, world axes.
    """

    joints: Array
    hand: Array

    @classmethod
    def of(cls, samples: Samples) -> _Changes:
        """Derivatives of splines through the speeds, without lag or attenuation at the frequencies of swings."""
        from scipy.interpolate import CubicSpline

        speeds = np.hstack([samples.dq, samples.twist])
        changes = CubicSpline(samples.t, speeds)(samples.t, 1)
        return cls(*np.split(changes, [samples.dq.shape[1]], axis=1))

    def where(self, rows: Mask) -> _Changes:
        """Derivatives in some rows."""
        return _Changes(self.joints[rows], self.hand[rows])


@dataclass(frozen=True, slots=True, eq=False)
class _Lock:
    """A fit of a constant, a trend and a sine."""

    design: Array
    inverse: Array

    @classmethod
    def of(cls, t: Array, rate: float) -> _Lock:
        """At times `t` (n,), s, and `rate`, rad/s."""
        since = t - t.mean()
        design = np.column_stack(
            [np.cos(rate * since), np.sin(rate * since), np.ones_like(since), since]
        )
        return cls(design, np.linalg.pinv(design))

    def of_signal(self, values: Array) -> Complex:
        """(k,) complex amplitudes of signals (n, k)."""
        cosine, sine = (self.inverse @ values)[:2]
        return cosine - 1j * sine

    def explained(self, signal: Array, waves: Array) -> float:
        """Mean square of a signal (n,) that `waves` (n, k) explain beyond the fit."""
        left, beside = (x - self.design @ (self.inverse @ x) for x in (signal, waves))
        found = np.linalg.lstsq(beside, left, rcond=None)[0]
        return float(np.mean((beside @ found) ** 2))


def commanded_rate(samples: Samples) -> float:
    """Rate of the commanded swing, rad/s: that of the sine with the least residuals, to a hundredth of a period
    over the whole length."""
    middle = Pose(np.zeros(3), samples.target_world_tcp[0, 3:])
    turned = rotation_vectors(samples.target_world_tcp[:, 3:], middle)
    along = turned @ np.linalg.svd(turned, full_matrices=False)[2][0]
    crossings = np.flatnonzero(np.diff(np.signbit(along)))
    inner = samples.t[crossings[1:-1]]
    rate = np.pi * (len(inner) - 1) / max(float(inner[-1] - inner[0]), 1e-9)
    for finer in RATE_SEARCH:
        rates = rate * np.linspace(1.0 - finer, 1.0 + finer, RATE_STEPS)
        rate = max(
            rates.tolist(),
            key=lambda one: abs(_Lock.of(samples.t, one).of_signal(along[:, None])[0]),
        )
    return float(rate)


def rotation_vectors(quaternions: Array, about: Pose) -> Array:
    """(n, 3) rad, world axes: small rotations of poses from `about`."""
    relative = rotations(quaternions) @ about.rotation.T
    skew = relative - relative.transpose(0, 2, 1)
    vectors = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) / 2.0
    sines = np.minimum(np.linalg.norm(vectors, axis=1, keepdims=True), 1.0)
    return vectors * np.where(sines > 1e-9, np.arcsin(sines) / np.maximum(sines, 1e-9), 1.0)


def unit_load_wrenches(samples: Samples, changes: _Changes, gravity: float) -> Array:
    """(n, 6, 10) wrenches about the TCP, world axes, of unit mass, first moment and inertia in tool axes."""
    tools = rotations(samples.pose_world_tcp[:, 3:])
    rate, turned = samples.twist[:, 3:], changes.hand[:, 3:]
    carried = changes.hand[:, :3] + np.array([0.0, 0.0, gravity])
    found = np.zeros((len(tools), 6, 10))
    found[:, :3, 0] = carried
    for k in range(3):
        axis = tools[:, :, k]
        found[:, :3, 1 + k] = np.cross(turned, axis) + np.cross(rate, np.cross(rate, axis))
        found[:, 3:, 1 + k] = np.cross(axis, carried)
    for k, (i, j) in enumerate(INERTIA):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        tensors = tools @ unit @ tools.transpose(0, 2, 1)
        spin = np.einsum("nij,nj->ni", tensors, rate)
        resisted = np.einsum("nij,nj->ni", tensors, turned)
        found[:, 3:, 4 + k] = resisted + np.cross(rate, spin)
    return found
