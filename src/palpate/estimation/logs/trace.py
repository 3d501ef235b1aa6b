"""Conversion of an arm recording to a `Trace`, with a load in given time windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose, rotations
from palpate.estimation.logs.wrench_log import WrenchLog, joined
from palpate.estimation.rigid_bodies import parameters, regressor
from palpate.robots.description import RobotDescription, carries
from palpate.robots.nominal import NominalArm, wrenches
from palpate.trace.recording import (
    RECORDED,
    ArmLog,
    Context,
    Conversion,
    LeafRun,
    NominalHand,
    Recording,
    WrenchSensor,
)
from palpate.trace.samples import FORCES, Samples, Trace

PERIOD = 0.005
"""s between samples of a trace; faster recordings are averaged."""
EDGE = 0.5
"""s at either end of a window, in which the load changes."""
APART = 10.0
"""s in the trace between a recording and that of the empty hand."""
SHORTEST = 1.0
"""s. Shortest useful window."""
Window = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Carrying:
    """Load of a recording.

    Attributes:
        name: name of the object.
        windows: s since the first row of the log, in which it was carried; all of the log if empty.
        in_hand: position and quaternion wxyz of the object in the hand, as text; None where unknown.
        hand: kg of the end effector; None for that of the arm's description; `found` if fitted to the recording.
    """

    name: str
    windows: tuple[Window, ...] = ()
    in_hand: str | None = None
    hand: float | Literal["found"] | None = None


def trace_of(
    log: ArmLog,
    carrying: Carrying,
    parameters: Sequence[Parameter],
    arm: RobotDescription,
    base: Pose,
    gravity: float,
    empty: ArmLog | None = None,
) -> Trace:
    """Build the trace of a log.

    The hand carries a load in the log's windows. It is empty elsewhere, and in the log `empty`.
    Raises InputError: A window is not in the log.
    """
    # Average the recording, and append that of the empty hand.
    parts = [average_bins(log)]
    end = float(parts[0].t[-1])
    if empty is not None:
        later = average_bins(empty)
        parts.append(replace(later, t=later.t + end + APART))
    samples = Samples.concatenate(samples_of(part, arm, base, gravity, carrying) for part in parts)
    # The unknown part of the hand's mass is removed from the chain, so that the load fit contains it.
    chain, share = arm.nominal.chain, hand_share(arm, carrying.hand)
    assert chain is not None
    of_hand = hand_links(arm)
    links = tuple(
        replace(link, mass=share * link.mass, inertia=tuple(share * part for part in link.inertia))
        if i in of_hand
        else link
        for i, link in enumerate(chain.links)
    )
    hand = replace(arm.nominal, chain=replace(chain, links=links))
    return _carried(samples, end, log.source, carrying, parameters, hand, gravity)


def trace_of_wrench(
    log: WrenchLog,
    carrying: Carrying,
    parameters: Sequence[Parameter],
    base: Pose,
    gravity: float,
    empty: WrenchLog | None = None,
) -> Trace:
    """Build the trace of a sensor's wrench and pose; its TCP is the origin of the sensor, and it has no joints.

    `base` is the pose in the world of the frame in which the sensor's pose is logged.
    Raises InputError: A window is not in the log.
    """
    end = float(log.t[-1])
    every = log if empty is None else joined(log, empty, APART)
    # Poses and wrench in the world.
    pose = np.array([(base @ Pose.of(one[:3], one[3:])).vector for one in every.pose])
    turned = rotations(pose[:, 3:])
    parts = np.split(every.wrench, 2, axis=1)
    wrench = np.hstack([(turned @ part[:, :, None])[:, :, 0] for part in parts])
    none, still = np.empty((len(every), 0)), np.zeros((len(every), 6))
    samples = Samples(
        t=every.t,
        q=none,
        dq=none,
        tau_ext=none,
        wrench=wrench,
        pose_world_tcp=pose,
        twist=still,
        target_world_tcp=pose,
        width=np.zeros(len(every)),
        wrench_sensor=every.wrench,
    )
    sensor = WrenchSensor(log.label, gain=log.gain)
    hand = NominalHand(0.0, 0.0, 0.0, 0.0, joints=(), fingers=("", ""), wrench_sensor=sensor)
    return _carried(samples, end, log.source, carrying, parameters, hand, gravity)


def _carried(
    samples: Samples,
    end: float,
    source: str,
    carrying: Carrying,
    parameters: Sequence[Parameter],
    hand: NominalHand,
    gravity: float,
) -> Trace:
    """Make the trace of samples in whose windows, until `end` s, a load is carried."""
    # Each window becomes a recording between a grasp and a release.
    windows = [_inside(window, end, source) for window in carrying.windows or [(0.0, end)]]
    held = Context("moving", "load", carrying.name, carrying.in_hand)
    free = Context("moving", "load")
    leaves: list[LeafRun] = []
    recordings: list[Recording] = []
    for i, (start, stop) in enumerate(windows):
        node = f"recording.windows[{i}]"
        taken = ("CloseGripper", "load taken", start - EDGE, start, held)
        given = ("OpenGripper", "load given", stop, stop + EDGE, free)
        for primitive, label, begins, ends, context in (taken, given):
            leaves.append(LeafRun(node, primitive, label, begins, ends, "SUCCESS", "", context))
        recordings.append(Recording(FORCES, start, stop, held, node))
    # The last window represents each parameter.
    last = recordings[-1]
    conversions = [
        Conversion(RECORDED, parameter.object, parameter.quantity, last, last.end)
        for parameter in parameters
    ]
    return Trace(samples, tuple(leaves), tuple(recordings), tuple(conversions), hand, gravity)


def _inside(window: Window, end: float, source: str) -> Window:
    """Clip a window to the log; raise InputError if it lies outside or is too short."""
    start, stop = max(window[0], 0.0), min(window[1], end)
    is_inside = window[0] >= -EDGE and window[1] <= end + EDGE
    if not is_inside or stop - start < SHORTEST:
        raise InputError(
            f"loaded={window[0]:g}-{window[1]:g}: {source} lasts {end:.1f} s; give windows within it, of "
            f"{SHORTEST:g} s or more"
        )
    return start, stop


def average_bins(log: ArmLog) -> ArmLog:
    """Average a log over bins of `PERIOD` from 0 s."""
    # Time stamps are multiples of a period up to rounding.
    bins = np.floor((log.t - log.t[0]) / PERIOD + 1e-3).astype(int)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    count = np.diff(np.append(starts, len(bins)))

    # Means over the rows of each bin.
    def mean(values: Array) -> Array:
        sums = np.add.reduceat(values, starts, axis=0)
        return sums / count.reshape(-1, *[1] * (values.ndim - 1))

    return replace(
        log,
        t=mean(log.t - log.t[0]),
        q=mean(log.q),
        dq=mean(log.dq),
        tau=mean(log.tau),
        tau_ext=None,
    )


def hand_links(arm: RobotDescription) -> set[int]:
    """Indices of the links of the arm's hand in its chain."""
    model = arm.spec(np.zeros(3)).compile()
    hinges = [int(model.joint(name).id) for name in arm.joints]
    hand = model.body(arm.hand.body).id
    found: list[bool] = []
    # The chain has every body with mass that a joint moves; it belongs to the hand if it descends from it.
    for body in range(1, model.nbody):
        if model.body_mass[body] > 0.0 and any(carries(model, hinge, body) for hinge in hinges):
            part = body
            while part > hand:
                part = int(model.body_parentid[part])
            found.append(part == hand)
    return {place for place, is_hand in enumerate(found) if is_hand}


def hand_share(arm: RobotDescription, hand: float | str | None) -> float:
    """Fraction of the described hand's mass that counts as known."""
    if hand is None:
        return 1.0
    chain = arm.nominal.chain
    assert chain is not None
    whole = sum(chain.links[place].mass for place in hand_links(arm))
    return 0.0 if isinstance(hand, str) else hand / whole


def samples_of(
    log: ArmLog, arm: RobotDescription, base: Pose, gravity: float, carrying: Carrying
) -> Samples:
    """Samples of a log; the external torques are the sensed ones minus gravity torques of the nominal arm."""
    seen = NominalArm(arm, base, np.array([0.0, 0.0, -gravity])).kinematics(log.q)
    external = log.tau - seen.gravity_torque
    # Gravity of the unknown part of the hand stays in the external torques.
    share = hand_share(arm, carrying.hand)
    if share != 1.0:
        chain = arm.nominal.chain
        assert chain is not None
        anchor = np.array(chain.anchors[-1])
        known = parameters([chain.links[place] for place in hand_links(arm)], anchor)
        still, pull = np.zeros_like(log.q), base.rotation.T @ [0.0, 0.0, -gravity]
        weight = regressor(chain, log.q, still, still, pull)[:, :, -1] @ known
        external += (1.0 - share) * weight
    # The wrench is that of the external torques at the TCP; the log has no commands.
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
