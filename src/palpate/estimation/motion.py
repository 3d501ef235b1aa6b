"""Velocity of the hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.estimation.view import FitView
from palpate.geometry.pose import Array
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace


@dataclass(frozen=True, slots=True, eq=False)
class MeanVelocity:
    """Mean linear velocity of the TCP: (3,) m/s in world axes, its standard deviation, and over
    which time, s."""

    value: Array
    std: Array
    duration: float

    def view(self, trace: Trace, recording: Recording) -> FitView:
        """Way of the TCP along its mean velocity."""
        samples = trace.of(recording)
        along = self.value / max(float(np.linalg.norm(self.value)), 1e-12)
        since = samples.t - samples.t[0]
        return FitView(
            name="Way of the hand.",
            note="Its displacement from the first sample to the last is the mean velocity times the duration.",
            axes=("robot time (s)", "way along the mean velocity (mm)"),
            x=samples.t,
            measured=1e3 * (samples.pose_world_tcp[:, :3] - samples.pose_world_tcp[0, :3]) @ along,
            predicted=1e3 * since * float(np.linalg.norm(self.value)),
            groups="the hand",
            slopes=1e3 * since[:, None] * along,
        )


def mean_velocity(trace: Trace, recording: Recording) -> MeanVelocity:
    """The displacement over the duration, which holds less noise than the mean of the sensed
    twist.

    Raises:
        ValueError: the recording has fewer than two samples.
    """
    samples = trace.of(recording)
    if len(samples) < 2:
        raise ValueError(f"the recording has {len(samples)} samples, a velocity needs two")
    duration = float(samples.t[-1] - samples.t[0])
    moved = samples.pose_world_tcp[-1, :3] - samples.pose_world_tcp[0, :3]
    std = np.sqrt(2.0) * trace.hand.pose_repeatability / duration
    return MeanVelocity(moved / duration, np.full(3, std), duration)
