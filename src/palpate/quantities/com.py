"""Centre of mass of a held object, from the torque it puts on the hand at several grasps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation.estimate import Estimate
from palpate.estimation.load import Contrast, fit_load, segments
from palpate.estimation.windows import load_of, mean_pose
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.mass import estimate_mass
from palpate.scene.scene import Scene
from palpate.trace.recording import Conversion, Recording
from palpate.trace.samples import FORCES, Trace

TORQUE_X, TORQUE_Y, FORCE_Z = 3, 4, 2

GRASP_ACCURACY = 7e-4
"""m (1 sigma): how far a grasp may shift the object from where it is believed to be in the hand."""

GAIN_LEVER = 0.3
"""m: unequal gains of the joints' torque sensors make a pure force look as if it acted off the TCP,
by the gain's standard deviation times about so much; the same at all grasps."""

PRIOR = 0.25
"""Part of the object's extent that is the 1 sigma of a coordinate of the centre of mass before
measuring."""


@dataclass(frozen=True, slots=True, eq=False)
class _Grasp:
    """What one still recording says.

    Attributes:
        recording, weight: the evidence, and the load's vertical force, N.
        torque: N m, magnitude of the load's horizontal moment about the TCP.
        rows: (2, 3) and right: (2,): linear equations for the centre of mass in the body frame, m.
        std: (2,) m, of each.
    """

    recording: Recording
    weight: Contrast
    torque: float
    rows: Array
    right: Array
    std: Array


def estimate_com(trace: Trace, parameter: Parameter, scene: Scene) -> Estimate:
    """Centre of mass in the body frame, m, from all recordings of the object held still in the air.

    A still grasp tells where the centre of mass is horizontally, not along gravity: that coordinate
    keeps the geometric centre with its prior spread, and the method says so. `components` holds
    `mass` from the grasp with the least torque, and `least torque` in N m.
    """
    body = scene.body(parameter.object)
    held = [
        r
        for r in trace.recordings
        if r.buffer == FORCES
        and r.context.activity == "still"
        and r.context.holding == parameter.object
    ]
    if not held:
        return _prior(parameter, body)
    grasps = [_grasp(trace, recording, body) for recording in held]
    centre, covariance = _solve(grasps, body)
    common = GAIN_LEVER * trace.hand.torque_gain / np.sqrt(3.0)
    std = np.sqrt(np.diag(covariance) + common**2)
    best = min(grasps, key=lambda grasp: grasp.torque)
    mass = estimate_mass(
        trace,
        Conversion("Force2Mass", parameter.object, "mass", best.recording, best.recording.end),
    )
    components = {"mass": (mass.value[0], mass.std[0]), "least torque": (best.torque, 0.0)}
    return _estimate(parameter, centre, std, grasps, body, components)


def _grasp(trace: Trace, recording: Recording, body: Body) -> _Grasp:
    found = segments(trace, recording)
    weight, torque_x, torque_y = (
        fit_load(found, axis, trace.gravity, trace.hand) for axis in (FORCE_Z, TORQUE_X, TORQUE_Y)
    )
    pose_world_tcp = mean_pose(trace.of(recording))
    pose_world_body = pose_world_tcp @ _pose_tcp_body(trace, recording, body)
    # torque = r x (0, 0, F) with r from the TCP to the centre of mass, so r = (-torque_y, torque_x)
    # / F.
    offset = np.array([-torque_y.value, torque_x.value]) / weight.value
    relative = weight.std / weight.value
    std = np.hypot(
        [torque_y.std / weight.value, torque_x.std / weight.value], np.abs(offset) * relative
    )
    right = pose_world_tcp.position[:2] + offset - pose_world_body.position[:2]
    return _Grasp(
        recording,
        weight,
        float(np.hypot(torque_x.value, torque_y.value)),
        pose_world_body.rotation[:2],
        right,
        np.hypot(std, GRASP_ACCURACY),
    )


def _pose_tcp_body(trace: Trace, recording: Recording, body: Body) -> Pose:
    """The object in the hand: where it was believed to stand when the measured hand closed on
    it."""
    before = [time for time in load_of(trace, body.name).grasps if time <= recording.start]
    if not before:
        return mean_pose(trace.of(recording)).inverse() @ body.pose_world
    at_grasp = trace.samples.between(before[-1] - 0.05, before[-1] + 0.05)
    return mean_pose(at_grasp).inverse() @ body.pose_world


def _solve(grasps: Sequence[_Grasp], body: Body) -> tuple[Array, Array]:
    """The centre of mass (3,) m and its covariance, around a prior at the geometric centre."""
    rows = np.vstack([grasp.rows for grasp in grasps])
    right = np.concatenate([grasp.right for grasp in grasps])
    weight = np.concatenate([grasp.std for grasp in grasps]) ** -2.0
    prior: Array = np.diag((PRIOR * np.maximum(body.size, 1e-3)) ** -2.0).astype(np.float64)
    information: Array = (rows.T * weight) @ rows + prior
    covariance: Array = np.linalg.inv(information).astype(np.float64)
    centre = covariance @ ((rows.T * weight) @ right + prior @ body.centre)
    misfit = float(np.sqrt(np.mean((right - rows @ centre) ** 2 * weight)))
    inflated: Array = covariance * max(1.0, misfit) ** 2
    return centre, inflated


def _estimate(
    parameter: Parameter,
    centre: Array,
    std: Array,
    grasps: Sequence[_Grasp],
    body: Body,
    components: dict[str, tuple[float, float]],
) -> Estimate:
    blind = std > 0.5 * PRIOR * body.size
    value = np.where(blind, body.centre, centre)
    axes = " and ".join(axis for axis, unseen in zip("xyz", blind, strict=True) if unseen)
    method = (
        f"Horizontal moment over weight of the object held still at {len(grasps)} "
        f"grasp{'s' * (len(grasps) > 1)}, each against the empty hand"
    )
    if axes:
        method += f"; {axes} lies along gravity in every grasp and keeps the geometric centre (prior-dominated)"
    return Estimate(
        parameter,
        tuple(float(v) for v in value),
        tuple(float(s) for s in std),
        tuple((float(v - 1.96 * s), float(v + 1.96 * s)) for v, s in zip(value, std, strict=True)),
        method + ".",
        tuple(grasp.recording for grasp in grasps),
        "prior-dominated" if bool(blind.all()) else "identified",
        components,
    )


def _prior(parameter: Parameter, body: Body) -> Estimate:
    std = PRIOR * body.size
    return Estimate(
        parameter,
        tuple(float(v) for v in body.centre),
        tuple(float(s) for s in std),
        tuple(
            (float(v - 1.96 * s), float(v + 1.96 * s))
            for v, s in zip(body.centre, std, strict=True)
        ),
        "No recording shows the object held still in the air; this is the geometric centre.",
        (),
        "not identified",
    )
