"""Motion of the hand in samples: rest, speed, acceleration, mean pose and mean velocity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Pose, rotations
from palpate.estimation.estimate import FitView
from palpate.estimation.evidence import once
from palpate.trace.recording import NominalHand, Recording
from palpate.trace.samples import Samples, Trace

SETTLE = 0.15
"""s after the commanded pose stopped moving: transient of the impedance controller. Sensitive: mass
0.1 σ; friction 0.2 σ, std ×1.0–1.1; com 0.2 σ."""
START = 0.06
"""s before the commanded pose moves on: a smooth start accelerates before it visibly moves.
Sensitive: com 0.08 σ, std ×0.9–1.0."""
STILL_SPEED = 0.001
"""m/s: below this speed the TCP is at rest. Sensitive: mass 0.1 σ; friction 0.2 σ, std ×1.0–1.1; com 0.2 σ."""
STILL_TURN = 0.01
"""rad/s: below this angular speed the hand is at rest. Not sensitive."""
NEAR_ANGLE = 0.06
"""rad: rotation from the measured pose up to which an orientation counts as the same. Not sensitive."""
SPEED_SMOOTH = 0.05
"""s: averaging time of the speed in the test for a constant speed, as encoders are noisy.
Sensitive: mass 0.5 σ, std ×0.9–1.5."""
GAP = 3.0
"""sampling periods between samples from which samples are missing. Not sensitive."""
STEADY = 0.05
"""m/s²: largest acceleration of a row of a pass. The inertial force of the arm at a change of speed
is far larger than a load. Sensitive: mass 0.7 σ, std ×0.8–1.5."""

Mask = NDArray[np.bool_]


def runs(mask: Mask) -> Iterator[slice]:
    """Yield the maximal stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(end))


def row_at(samples: Samples, time: float) -> int:
    """Return the first row at or after `time`, s, or the last row."""
    return min(int(np.searchsorted(samples.t, time)), len(samples) - 1)


def smooth_rows(values: Array, rows: int) -> Array:
    """Compute the (n,) running mean of values (n,) over `rows` rows; at the ends over those that exist."""
    window = np.ones(min(rows, len(values)))
    counts = np.convolve(np.ones(len(values)), window, mode="same")
    return np.convolve(values, window, mode="same") / counts


def smoothed_with_rate(speeds: Array, t: Array, over: float) -> tuple[Array, Array]:
    """Average speeds (n, k) over at most `over` s; return them and their rates of change per second.

    Both are means over the same rows. A part of a trace may begin, end or have a gap while the arm moves.
    """
    steps = np.diff(t)
    step = max(float(np.median(steps)) if len(steps) else 0.0, 1e-9)
    # An odd window keeps both at the time of their row.
    rows = 2 * (max(0, round(over / step) - 1) // 2) + 1
    smooth, rates = np.zeros(speeds.shape), np.zeros(speeds.shape)
    for part in np.split(np.arange(len(t)), np.flatnonzero(steps > GAP * step) + 1):
        for column in range(speeds.shape[1]):
            speed: Array = speeds[part, column]
            smooth[part, column] = smooth_rows(speed, rows)
            if len(part) > 1:
                rates[part, column] = smooth_rows(np.gradient(speed, t[part]), rows)
    return smooth, rates


@once
def acceleration(samples: Samples, over: float) -> Array:
    """Compute the TCP acceleration (n, 3), m/s², world axes, from its velocity averaged over `over` s."""
    t = samples.t
    if len(t) < 2:
        return np.zeros((len(t), 3))
    return smoothed_with_rate(samples.twist[:, :3], t, over)[1]


@once
def steady(samples: Samples) -> Mask:
    """Return the rows at which the arm does not change its speed."""
    change = acceleration(samples, SPEED_SMOOTH)
    return np.linalg.norm(change, axis=1) < STEADY


@once
def commanded_rows(samples: Samples) -> Mask:
    """Return the rows at which the commanded pose moves or turns."""
    target = samples.target_world_tcp
    moved = np.linalg.norm(np.diff(target[:, :3], axis=0), axis=1)
    # A quaternion and its opposite are the same orientation.
    turned = 1.0 - np.abs(np.sum(target[1:, 3:] * target[:-1, 3:], axis=1))
    return np.concatenate([[False], (moved > 1e-6) | (turned > 1e-12)])


@once
def at_rest(samples: Samples) -> Mask:
    """Return the rows at which neither the commanded pose nor the arm moves, without transients."""
    t = samples.t
    if len(t) < 2:
        return np.zeros(len(t), dtype=bool)
    changed = commanded_rows(samples)
    # Time of the last change of the command before each row, and of the next after it.
    last_change = np.maximum.accumulate(np.where(changed, t, -np.inf))
    next_change = np.minimum.accumulate(np.where(changed, t, np.inf)[::-1])[::-1]
    # The measured velocity of an arm at rest is encoder noise; 0.6 mm/s on a real arm.
    twist, _ = smoothed_with_rate(samples.twist, t, SPEED_SMOOTH)
    slow = np.linalg.norm(twist[:, :3], axis=1) < STILL_SPEED
    slow &= np.linalg.norm(twist[:, 3:], axis=1) < STILL_TURN
    return (t - last_change > SETTLE) & (next_change - t > START) & slow


def mean_pose(samples: Samples) -> Pose:
    """Average the TCP pose (world) of samples that lie close together. Raises ValueError: there are no samples."""
    if not len(samples):
        raise ValueError("no samples to average a pose over")
    quaternions = samples.pose_world_tcp[:, 3:]
    # Bring all quaternions to the hemisphere of the first before averaging.
    signs = np.where(quaternions @ quaternions[0] < 0, -1.0, 1.0)
    return Pose.of(
        samples.pose_world_tcp[:, :3].mean(axis=0), (quaternions * signs[:, None]).mean(axis=0)
    )


def tip_height(samples: Samples, hand: NominalHand) -> Array:
    """Compute the (n,) world z, m, of the lower fingertip.

    The tips lie `tip_offset` from the TCP along the tool axis z, and half the opening to either
    side along the closing direction y. When the hand leans in that direction, one tip is lower by
    the opening times the sine of the lean, and touches first.
    """
    turned = rotations(samples.pose_world_tcp[:, 3:])
    # Height of the point between the tips, less the drop of the lower one.
    middle = samples.pose_world_tcp[:, 2] + hand.tip_offset * turned[:, 2, 2]
    return middle - samples.width / 2 * np.abs(turned[:, 2, 1])


def aligned_rows(samples: Samples, pose: Pose) -> Mask:
    """Return the rows at which the TCP has the orientation of `pose`."""
    # Rotation angle from the absolute quaternion product.
    dots = np.abs(samples.pose_world_tcp[:, 3:] @ pose.quaternion)
    return 2.0 * np.arccos(np.minimum(dots, 1.0)) < NEAR_ANGLE


@dataclass(frozen=True, slots=True, eq=False)
class MeanVelocity:
    """Mean linear velocity of the TCP."""

    value: Array  # (3,) m/s, world axes
    std: Array  # (3,) m/s, its standard deviation
    duration: float  # s

    def view(self, trace: Trace, recording: Recording) -> FitView:
        """Chart the displacement of the TCP along its mean velocity."""
        samples = trace.of(recording)
        along = self.value / max(float(np.linalg.norm(self.value)), 1e-12)
        since = samples.t - samples.t[0]
        return FitView(
            name="Displacement of the hand.",
            note="From the first sample to the last, it is the mean velocity times the duration.",
            axes=("robot time (s)", "along the mean velocity (mm)"),
            x=samples.t,
            measured=1e3 * (samples.pose_world_tcp[:, :3] - samples.pose_world_tcp[0, :3]) @ along,
            predicted=1e3 * since * float(np.linalg.norm(self.value)),
            groups="the hand",
            slopes=1e3 * since[:, None] * along,
        )


def mean_velocity(trace: Trace, recording: Recording) -> MeanVelocity:
    """Compute displacement over duration, which is less noisy than the mean of the sensed twist.

    Raises ValueError: the recording has fewer than two samples.
    """
    samples = trace.of(recording)
    if len(samples) < 2:
        raise ValueError(f"the recording has {len(samples)} samples, a velocity needs two")
    duration = float(samples.t[-1] - samples.t[0])
    moved = samples.pose_world_tcp[-1, :3] - samples.pose_world_tcp[0, :3]
    # Two positions, each with the repeatability of a pose.
    std = np.sqrt(2.0) * trace.hand.pose_repeatability / duration
    return MeanVelocity(moved / duration, np.full(3, std), duration)
