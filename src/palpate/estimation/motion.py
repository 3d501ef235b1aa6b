"""Velocity of the hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
