"""A recording of an arm as a `Trace`, in which the hand carries a load in given windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm, wrenches
from palpate.trace.log import ArmLog
from palpate.trace.recording import Context, Conversion, LeafRun, Recording
from palpate.trace.samples import FORCES, Samples, Trace

PERIOD = 0.005
"""s between samples of a trace; faster recordings are averaged."""
EDGE = 0.3
"""s on either side of a window's ends in which the load comes and goes."""
APART = 10.0
"""s in the trace between a recording and that of the empty hand."""
Window = tuple[float, float]


def trace_of(
    log: ArmLog,
    loaded: Sequence[Window],
    name: str,
    quantities: Sequence[str],
    arm: RobotDescription,
    base: Pose,
    gravity: float,
    empty: ArmLog | None = None,
) -> Trace:
    """Build the trace of a log whose hand carries `name` in the windows `loaded`, s since its first row, and is
    empty elsewhere and in the log `empty`."""
    parts = [binned(log)]
    if empty is not None:
        later = binned(empty)
        parts.append(replace(later, t=later.t + parts[0].t[-1] + APART))
    nominal = NominalArm(arm, base, np.array([0.0, 0.0, -gravity]))
    samples = Samples.concatenate(samples_of(part, nominal) for part in parts)
    held, free = Context("moving", "load", name), Context("moving", "load")
    leaves: list[LeafRun] = []
    recordings: list[Recording] = []
    for i, (start, end) in enumerate(loaded):
        node = f"recording.windows[{i}]"
        taken = LeafRun(
            node, "CloseGripper", "load taken", start - EDGE, start, "SUCCESS", "", held
        )
        given = LeafRun(node, "OpenGripper", "load given", end, end + EDGE, "SUCCESS", "", free)
        leaves += [taken, given]
        recordings.append(Recording(FORCES, start, end, held, node))
    last = recordings[-1]
    conversions = [
        Conversion("Recording", name, quantity, last, last.end) for quantity in quantities
    ]
    return Trace(
        samples, tuple(leaves), tuple(recordings), tuple(conversions), arm.nominal, gravity
    )


def binned(log: ArmLog) -> ArmLog:
    """Means over bins of `PERIOD`."""
    bins = np.floor((log.t - log.t[0]) / PERIOD).astype(int)
    _, place, count = np.unique(bins, return_inverse=True, return_counts=True)

    def mean(values: Array) -> Array:
        sums = np.zeros((len(count), *values.shape[1:]))
        np.add.at(sums, place, values)
        return sums / count.reshape(-1, *[1] * (values.ndim - 1))

    external = None if log.tau_ext is None else mean(log.tau_ext)
    return replace(
        log, t=mean(log.t), q=mean(log.q), dq=mean(log.dq), tau=mean(log.tau), tau_ext=external
    )


def samples_of(log: ArmLog, nominal: NominalArm) -> Samples:
    """Samples of a log: the external torques are the sensed ones less those that hold the nominal arm up."""
    seen = nominal.kinematics(log.q)
    external = log.tau - seen.gravity_torque
    twist = np.einsum("nij,nj->ni", seen.jacobian, log.dq)
    return Samples(
        t=log.t,
        q=log.q,
        dq=log.dq,
        tau_ext=external,
        wrench=wrenches(seen.jacobian, external[:, :, None])[:, :, 0],
        pose_world_tcp=seen.pose_world_tcp,
        twist=twist,
        target_world_tcp=seen.pose_world_tcp,
        width=np.zeros(len(log)),
    )
