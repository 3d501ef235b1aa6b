"""A guarded descent as it was felt: tip height and pressing force, from free air on.

A contact is where the force rises *and stays*: forces are running medians, so that a sample, or
four, say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.windows import Mask
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.trace.recording import Hand, LeafRun, Recording
from palpate.trace.samples import POSE, Samples, Trace

GUARDED = "MoveUntilContact"
"""The primitive whose leaf is a guarded descent."""


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Samples from the beginning of a guarded descent to the end of the recording after it.

    Attributes:
        samples: of the whole motion. leaf: the descent itself.
        z: (n,) m, tip height.
        force: (n,) N, pressing down, less what was felt in free air; smooth: its running median.
        noise: N, of a row's force in free air.
        onset: the last row before the contact. pressed: rows of the recording.
        set_out: (6,) N, N m, by how much the wrench changed as the arm set out: the joints' friction.
    """

    samples: Samples
    leaf: LeafRun
    z: Array
    force: Array
    smooth: Array
    noise: float
    onset: int
    pressed: Mask
    set_out: Array

    @property
    def full(self) -> float:
        """N, while the pose was recorded."""
        return float(np.mean(self.smooth[self.pressed]))

    @property
    def held(self) -> float:
        """m, tip height meanwhile."""
        return float(np.median(self.z[self.pressed]))

    def crossing(self, force: float) -> int:
        """The first row of the contact at which the force has risen to `force` N."""
        after = np.flatnonzero(self.smooth[self.onset :] >= force)
        return self.onset + int(after[0]) if len(after) else len(self.z) - 1


def tip_height(samples: Samples, hand: Hand) -> Array:
    """(n,) world z of the lower fingertip, m.

    Seen from the side the hand is a T: from the TCP the tips lie `tip_offset` along the tool axis
    z, and half the opening to either side along the closing direction y. When the hand leans over
    in that direction, one tip is lower than the other by the opening times the sine of the lean,
    and that one touches first. Rotation matrix from a quaternion wxyz: R[2,2] = 1 - 2 (x² + y²),
    R[2,1] = 2 (y z + w x).
    """
    w, x, y, z = samples.pose_world_tcp[:, 3:].T
    tool_z = 1.0 - 2.0 * (x**2 + y**2)
    closing_z = 2.0 * (y * z + w * x)
    middle = samples.pose_world_tcp[:, 2] + hand.tip_offset * tool_z
    return middle - samples.width / 2 * np.abs(closing_z)


def probes(trace: Trace, parameter: Parameter) -> list[Recording]:
    """The recordings of the pose in contact with a surface."""
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        on_it = context.activity == "contact" and context.support == parameter.object
        if recording.buffer == POSE and on_it:
            found.append(recording)
    return found


def descent_before(trace: Trace, recording: Recording) -> Descent | None:
    """The guarded descent that a recorded pose belongs to; None where it ended with nothing under
    the fingers.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    leaves = trace.leaf_runs(GUARDED)
    before = [leaf for leaf in leaves if leaf.end <= recording.start + 1e-6]
    if not before:
        raise ValueError(
            "no guarded descent (MoveUntilContact) comes before the recording of the pose"
        )
    leaf = before[-1]
    samples = trace.samples.between(leaf.start, recording.end)
    pressed = (samples.t >= recording.start) & (samples.t <= recording.end)
    if not pressed.any():
        raise ValueError("the recording of the pose holds no samples")
    z = tip_height(samples, trace.hand)
    down = -samples.wrench[:, 2]
    smooth = _running_median(down)
    # Twice: where the contact begins decides how far the free air reaches.
    onset, noise, zero = len(z) // 3, 0.0, 0.0
    free = np.arange(1)
    for _ in range(2):
        free = _free_air(samples, onset)
        zero, noise = _centre(down[free])
        onset = _onset(smooth - zero, noise, samples.t <= leaf.end)
    felt = float(np.mean(smooth[pressed])) - zero
    if felt < tuning.CONTACT_NOISE * max(noise, trace.hand.force_repeatability):
        return None
    resting = trace.samples.between(leaf.start - tuning.AT_REST, leaf.start).wrench
    moving: Array = np.median(samples.wrench[free], axis=0)
    set_out = moving - np.median(resting, axis=0) if len(resting) else np.zeros(6)
    return Descent(samples, leaf, z, down - zero, smooth - zero, noise, onset, pressed, set_out)


def steady(samples: Samples) -> Mask:
    """Rows long enough after the last change of the commanded speed for the arm to have stopped
    swinging: its own inertia is felt before."""
    told = np.gradient(samples.target_world_tcp[:, 2], samples.t)
    changes = np.abs(np.gradient(told, samples.t)) > tuning.SPEED_CHANGE
    last = np.maximum.accumulate(np.where(changes, samples.t, -np.inf))
    return samples.t - last > tuning.SWING


def _running_median(values: Array) -> Array:
    """(n,) of `SUSTAINED` rows about each, the first and the last one repeated beyond the ends."""
    padded = np.pad(values, tuning.SUSTAINED // 2, mode="edge")
    return np.median(sliding_window_view(padded, tuning.SUSTAINED), axis=-1)


def _free_air(samples: Samples, onset: int) -> NDArray[np.intp]:
    """Rows of the later half of the way to the contact."""
    told = -np.gradient(samples.target_world_tcp[:, 2], samples.t)[:onset]
    descending = told > tuning.DESCENDING * float(told.max(initial=1e-6))
    smoothly = descending & steady(samples)[:onset]
    moving = np.flatnonzero(smoothly if smoothly.any() else descending)
    return moving[len(moving) // 2 :] if len(moving) else np.arange(1)


def _centre(values: Array) -> tuple[float, float]:
    """Of some values, and their spread: medians, which a few wild samples do not reach. The standard
    deviation of a normal distribution is 1.4826 times its median absolute deviation."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))


def _onset(smooth: Array, noise: float, rows: Mask) -> int:
    """The last of some rows at which nothing is felt."""
    nothing = max(tuning.SOFT_FORCE, tuning.CONTACT_NOISE * noise / np.sqrt(tuning.SUSTAINED))
    quiet = np.flatnonzero(rows & (smooth < nothing))
    return int(quiet[-1]) if len(quiet) else 0
