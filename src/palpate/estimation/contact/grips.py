"""Widths of objects between the fingers: from recordings while they are held, and from grasps alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.motion import mean_pose
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body
from palpate.trace.recording import LeafRun, Recording
from palpate.trace.samples import Trace

ROUND = frozenset(("cylinder", "sphere", "capsule"))
"""Shapes of the same width in all horizontal directions."""
CLOSING = "CloseGripper"
"""The primitive whose leaf is a grasp."""


class Extent(NamedTuple):
    """Measured extent along an axis of the object, m, with its standard deviation."""

    axis: int
    value: float
    std: float


def widths(trace: Trace, held: Sequence[Recording], body: Body) -> Iterator[Extent]:
    """Widths of an object from recordings `held` while it is held."""
    for recording in held:
        samples = trace.of(recording)
        opening = float(np.median(samples.width))
        before = [leaf for leaf in trace.leaf_runs(CLOSING) if leaf.end <= recording.start]
        width, std = width_at(trace, opening, before[-1] if before else None)
        for axis in axes_between(mean_pose(samples).rotation[:, 1], body):
            yield Extent(axis, width, std)


def widths_at_grasps(trace: Trace, body: Body) -> Iterator[Extent]:
    """Widths of an object from every grasp of it, as the fingers came to rest."""
    for leaf in trace.leaf_runs(CLOSING):
        if leaf.context is None or leaf.context.holding != body.name:
            continue
        samples = trace.samples.between(leaf.end - tuning.GRASPED, leaf.end)
        if not len(samples):
            continue
        width, std = width_at(trace, float(np.median(samples.width)), leaf)
        for axis in axes_between(mean_pose(samples).rotation[:, 1], body):
            yield Extent(axis, width, std)


def axes_between(closing: Array, body: Body) -> list[int]:
    """Axes of an object along which fingers that close along `closing` (3,), world axes, measure it: one of its
    own, or both level ones of a round object."""
    along = np.abs(body.pose_world.rotation.T @ closing)
    level = np.abs(body.pose_world.rotation[2]) < 1.0 - tuning.ALIGNED
    if body.words & ROUND and level.sum() == 2:
        return np.flatnonzero(level).tolist()
    return np.flatnonzero(along > tuning.ALIGNED).tolist()


def width_at(trace: Trace, held: float, grasp: LeafRun | None) -> tuple[float, float]:
    """Width of an object at a grasp, m, with its standard deviation: the finger opening at first contact,
    extrapolated from the squeeze between that and the firm grasp with its opening `held`, m."""
    if grasp is None:
        return held, tuning.OPENING_HELD
    samples = trace.samples.between(grasp.start, grasp.end)
    resting = np.abs(np.gradient(samples.width, samples.t)) < tuning.FINGERS_REST
    met = samples.width[resting & (samples.width < held + tuning.GRASP_YIELDS)]
    if not len(met):
        return held, tuning.OPENING_HELD
    squeezed = max(float(np.quantile(met, tuning.FIRST_MET)) - held, 0.0)
    share = tuning.FIRST_SQUEEZE
    width = held + (1.0 + share) * squeezed
    return width, float(np.hypot(tuning.OPENING, share * squeezed))
